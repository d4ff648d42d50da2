"""A surveyed position: the pose of the scanner, and the planes of the site in its frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.adjustment.stochastic import SurveyUncertainty
from velocal.adjustment.unit.station import UnitStation
from velocal.arrays import Array
from velocal.errors import StorageError, SurveyError
from velocal.geometry.planes import Patch, Plane, fit_plane, hull_patch
from velocal.geometry.rigid import RigidTransformation, adjust_rigid
from velocal.io import storage
from velocal.survey.targets import (
    Targets,
    check_covariance,
    common,
    read_covariances,
    read_targets,
    shifted_plane,
)


@dataclass(frozen=True)
class SurveyedPlane:
    """A wall or the floor in the scanner frame, and how well its targets fit it.

    Attributes
    ----------
    patch : Patch
        The adjusted plane, bounded by the hull of its targets.
    targets : int
        Number of targets.
    flatness_mean_m, flatness_max_m : float
        Mean and largest absolute deviation of the targets from the plane, metres.
    variance_factor : float
        Of the standard deviations of the targets; NaN if there are three targets only.
    """

    patch: Patch
    targets: int
    flatness_mean_m: float
    flatness_max_m: float
    variance_factor: float

    @property
    def flatness_std_m(self) -> float:
        """Standard deviation of the surface about its plane, metres.

        Targets deviate from a plane by their own errors and by those of the surface. The variance
        factor tells by how much the deviations exceed the errors of the targets: the excess is
        flatness. The root mean square follows from the mean deviation of a normal distribution,
        corrected for the three parameters of the plane that were fitted to the n targets. Three
        targets show no flatness.
        """
        excess = max(self.variance_factor, 1.0) if np.isfinite(self.variance_factor) else 1.0
        dof = max(self.targets - 3.0, 1.0)
        deviation = self.flatness_mean_m * np.sqrt(self.targets / dof)
        return float(deviation * np.sqrt(np.pi / 2.0 * (1.0 - 1.0 / excess)))

    def to_json(self) -> dict[str, Any]:
        """Content of one entry of ``planes`` in the file of a station."""
        plane = self.patch.plane
        return {
            "name": self.patch.name,
            "normal": plane.normal,
            "offset_m": plane.offset,
            "covariance": plane.covariance,
            "abc_per_m": plane.general_form() if plane.offset else None,
            "corners_m": self.patch.corners,
            "targets": self.targets,
            "flatness_mean_m": self.flatness_mean_m,
            "flatness_max_m": self.flatness_max_m,
            "variance_factor": self.variance_factor,
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> SurveyedPlane:
        """Plane out of the content that `to_json` gave."""
        plane = Plane(
            np.array(content["normal"]), content["offset_m"], np.array(content["covariance"])
        )
        return cls(
            Patch(content["name"], plane, np.array(content["corners_m"])),
            content["targets"],
            content["flatness_mean_m"],
            content["flatness_max_m"],
            _number(content["variance_factor"]),
        )


@dataclass(frozen=True)
class Station:
    """Result of the survey of one position of a scanner.

    Attributes
    ----------
    position, scanner : str
        Name of the position, and of the scanner that stands there.
    pose : RigidTransformation
        ``T_scanner_site``; its covariance follows from the a-priori standard deviations.
    base_targets : tuple of str
        Targets of the scanner's base that the pose was adjusted from.
    residuals_m : ndarray, shape (n, 3)
        Residuals of these targets in the scanner frame, metres.
    variance_factor : float
        Of the adjustment of the pose.
    redundancy : int
        Of the adjustment of the pose.
    planes : tuple of SurveyedPlane
        In the scanner frame; the rows of assigned returns count them in this order.
    site_origin_m : ndarray, shape (3,)
        Was subtracted from all coordinates of the site before the adjustment; zero unless they are
        large (`Targets.reduction`). `pose` belongs to the reduced coordinates.
    """

    position: str
    scanner: str
    pose: RigidTransformation
    base_targets: tuple[str, ...]
    residuals_m: Array
    variance_factor: float
    redundancy: int
    planes: tuple[SurveyedPlane, ...]
    site_origin_m: Array = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def adjust(
        cls,
        planes: Targets,
        base_scanner: Targets,
        base_site: Targets,
        names: Sequence[str],
        *,
        covariances: Mapping[str, Array] | None = None,
        where: str,
        where_base: str | None = None,
    ) -> Station:
        """Adjust pose and planes of a position.

        Parameters
        ----------
        planes : Targets
            Targets of walls and floor in the site frame, grouped by plane.
        base_scanner : Targets
            Targets of the scanner's base in the scanner frame; their group is the scanner.
        base_site : Targets
            Targets of the scanner's base in the site frame; their group is the position.
        names : sequence of str
            Planes to use.
        covariances : mapping of str to ndarray, shape (4, 4), optional
            Covariance of normal and offset of planes in the site frame
            (`Targets.plane_covariances`). For a plane that is missing here, it follows from the
            standard deviations of its targets alone.
        where : str
            Survey file of the planes, for errors.
        where_base : str, optional
            Survey files of the base, for errors; `where` if left out.

        Raises
        ------
        SurveyError
            If targets are too few or lie on a line.
        """
        where_base = where_base or where
        origin = planes.reduction()
        planes, base_site = planes.reduced(origin), base_site.reduced(origin)
        site, scanner = common(base_site, base_scanner, where=where_base)
        with _placed(where_base):
            adjusted = adjust_rigid(site.xyz, scanner.xyz, site.covariance(), scanner.covariance())
        pose = adjusted.transformation
        surveyed = []
        for name in names:
            targets = planes.of(name, where=where)
            points = pose.apply(targets.xyz)
            with _placed(f"{where}, plane {name!r}"):
                fit = fit_plane(points, targets.isotropic_std())
            if covariances and name in covariances:
                moved = pose.plane_matrix() @ shifted_plane(origin)
                known = moved @ covariances[name] @ moved.T
                fit = replace(fit, plane=replace(fit.plane, covariance=known))
            surveyed.append(
                SurveyedPlane(
                    hull_patch(name, fit, points),
                    len(points),
                    fit.flatness_mean_m,
                    fit.flatness_max_m,
                    fit.variance_factor,
                )
            )
        return cls(
            position=site.group[0],
            scanner=scanner.group[0],
            pose=pose,
            base_targets=site.name,
            residuals_m=adjusted.residuals,
            variance_factor=adjusted.variance_factor,
            redundancy=adjusted.redundancy,
            planes=tuple(surveyed),
            site_origin_m=origin,
        )

    @property
    def patches(self) -> list[Patch]:
        """The planes, bounded by the hulls of their targets."""
        return [plane.patch for plane in self.planes]

    def uncertainty(self) -> SurveyUncertainty:
        """Covariances of pose and planes, and the flatness of the surfaces.

        A plane follows the level and the slope of its surface, so that flatness does not enter the
        covariance of the plane.
        """
        return SurveyUncertainty(
            translation=self.pose.translation,
            pose=self.pose.covariance,
            planes=np.array([patch.plane.covariance for patch in self.patches]),
            flatness_m=np.array([plane.flatness_std_m for plane in self.planes]),
        )

    def observations(self, rows: Mapping[str, NDArray[Any]]) -> Observations:
        """Observations of returns that are assigned to the planes of this station.

        Parameters
        ----------
        rows : mapping of str to ndarray, shape (n,)
            Columns of `schemas.ASSIGNED`.
        """
        normals = np.stack([patch.plane.normal for patch in self.patches])
        offsets = np.array([patch.plane.offset for patch in self.patches])
        plane = rows["plane"].astype(np.int64)
        return Observations(
            rows["distance_m"],
            rows["phi_rad"],
            rows["laser_id"],
            normals[plane],
            offsets[plane],
            plane,
        )

    def of_unit(self, observations: Observations, expected: Array | None = None) -> UnitStation:
        """Put observations and the uncertainty of the survey together for the whole unit.

        Parameters
        ----------
        observations : Observations
            Of all windows and recordings at this position.
        expected : ndarray, shape (lasers,), optional
            Number of observations that every laser should have.
        """
        return UnitStation(
            self.position,
            observations,
            self.uncertainty(),
            tuple(patch.name for patch in self.patches),
            self.pose,
            expected,
        )

    def to_json(self) -> dict[str, Any]:
        """Content of the file ``survey/{position}.json``."""
        reduced = {"site_origin_m": self.site_origin_m} if self.site_origin_m.any() else {}
        return {
            "position": self.position,
            "scanner": self.scanner,
            **reduced,
            "pose": {
                # The name of the site frame in files.
                "name": "T_scanner_field",
                "rotation": self.pose.rotation,
                "translation_m": self.pose.translation,
                "covariance_rad_m": self.pose.covariance,
                "targets": list(self.base_targets),
                "residuals_m": self.residuals_m,
                "variance_factor": self.variance_factor,
                "redundancy": self.redundancy,
            },
            "planes": [plane.to_json() for plane in self.planes],
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Station:
        """Station out of the content that `to_json` gave."""
        pose = content["pose"]
        return cls(
            position=content["position"],
            scanner=content["scanner"],
            pose=RigidTransformation(
                np.array(pose["rotation"]),
                np.array(pose["translation_m"]),
                np.array(pose["covariance_rad_m"]),
            ),
            base_targets=tuple(pose["targets"]),
            residuals_m=np.array(pose["residuals_m"]),
            variance_factor=_number(pose["variance_factor"]),
            redundancy=pose["redundancy"],
            planes=tuple(SurveyedPlane.from_json(plane) for plane in content["planes"]),
            site_origin_m=np.array(content.get("site_origin_m", np.zeros(3))),
        )


def adjust_station(
    planes: str | Path,
    base_scanner: str | Path,
    base_site: str | Path,
    *,
    position: str,
    scanner: str,
    names: Sequence[str] | None = None,
    covariance: str | Path | None = None,
) -> Station:
    """Adjust pose and planes of a position from the files of a survey.

    Parameters
    ----------
    planes : str or Path
        CSV of the targets on walls and floor, in the site frame; column ``plane``.
    base_scanner : str or Path
        CSV of the targets on the scanner's base, in the scanner frame; column ``scanner``.
    base_site : str or Path
        CSV of the same targets in the site frame, surveyed at every position; column ``position``.
    position : str
        Position of the scanner, as in `base_site`.
    scanner : str
        Scanner that stands there, as in `base_scanner`.
    names : sequence of str, optional
        Planes that are used, in this order; all planes of the file if left out.
    covariance : str or Path, optional
        JSON with the covariances that the survey's own adjustment gave.

    Returns
    -------
    Station

    Raises
    ------
    SurveyError
        If a file is missing or faulty, or targets are too few or lie on a line.

    Examples
    --------
    >>> files = "planes.csv", "base_scanner.csv", "base_field.csv"
    >>> station = velocal.adjust_station(*files, position="P5", scanner="HDL-32E")
    >>> [plane.patch.name for plane in station.planes]
    ['short_wall', 'long_wall', 'floor']
    """
    known = read_covariances(covariance) if covariance else None
    on_planes = read_targets(Path(planes), "plane")
    return Station.adjust(
        on_planes,
        read_targets(Path(base_scanner), "scanner").of(scanner, where=str(base_scanner)),
        read_base(base_site, position, covariance),
        list(dict.fromkeys(on_planes.group)) if names is None else names,
        covariances=known.planes if known else None,
        where=str(planes),
        where_base=f"{base_scanner} and {base_site}, position {position!r}",
    )


@contextmanager
def _placed(where: str) -> Iterator[None]:
    """Say in an error of the geometry, which knows no files, where its points stand."""
    try:
        yield
    except SurveyError as error:
        raise SurveyError(error.what, where=where, allowed=error.allowed, hint=error.hint) from None


def read_base(
    base_site: str | Path, position: str, covariance: str | Path | None = None
) -> Targets:
    """Read the targets of a scanner's base at a position.

    Parameters
    ----------
    base_site : str or Path
        CSV of the targets in the site frame; column ``position``.
    position : str
    covariance : str or Path, optional
        JSON with the covariances that the survey's own adjustment gave.

    Returns
    -------
    Targets

    Raises
    ------
    SurveyError
        If a file is missing or faulty, or has no such position.
    """
    found = read_targets(Path(base_site), "position").of(position, where=str(base_site))
    if covariance is None:
        return found
    known = read_covariances(covariance)
    return known.of_base(found, position, where=str(covariance))


def read_station(path: str | Path) -> Station:
    """Read the file of a station.

    Parameters
    ----------
    path : str or Path
        JSON that `Station.to_json` gave.

    Returns
    -------
    Station

    Raises
    ------
    StorageError
        If the file is missing, is no JSON, or lacks a value.
    SurveyError
        If a matrix in it is no covariance.

    Examples
    --------
    >>> velocal.read_station("station.json").position
    'P5'
    """
    content = storage.read_json(Path(path))
    try:
        found = Station.from_json(content)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StorageError(
            f"is not the survey of a position: {error}",
            where=str(path),
            hint="Delete the file, and run the rule adjust_survey again.",
        ) from None
    check_covariance(found.pose.covariance, 6, f"{path}, pose")
    for patch in found.patches:
        check_covariance(patch.plane.covariance, 4, f"{path}, plane {patch.name!r}")
    return found


def _number(value: float | None) -> float:
    """Number out of JSON, where NaN is null."""
    return float("nan") if value is None else value
