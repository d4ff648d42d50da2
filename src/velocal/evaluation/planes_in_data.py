"""Recordings without a survey: planes fitted to the data, and how flat each laser sees them.

Trimming compares a return with its own laser only, so that the errors of the lasers, which are
what is looked for, stay in. `plane_search` finds planes where nobody says where they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import misclosure
from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.evaluation.statistics import statistics_columns, summary_row
from velocal.geometry.planes import Plane, PlaneFit, fit_plane
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.parameters import LaserParameters
from velocal.study.planes import Box, PanelFit, PlaneSearch

Rows = NDArray[np.int64]

#: Lasers that must see a plane: two or three lines do not determine one.
MIN_LASERS = 4
#: Trimming: limit in robust standard deviations, largest number of rounds.
TRIM_AT, ROUNDS = 3.0, 10
#: Standard deviations of normal noise in its median absolute deviation.
STD_PER_MAD = 1.4826
#: Statistics of a laser on a plane that are tabulated.
LASER_COLUMNS = ("rms_cm", "mean_cm", "std_cm", "within_1sigma_pct", "within_3sigma_pct")
#: Returns that an azimuth bin must have before its spread tells anything of single returns.
MIN_SPREAD_COUNT = 5


@dataclass(frozen=True)
class Cloud(Beams):
    """Returns, or medians of them, with the points that a calibration gives.

    Attributes
    ----------
    parameters : LaserParameters
        Calibration.
    xyz, direction : ndarray, shape (n, 3)
        Points, metres, and unit directions of their beams, scanner frame.
    """

    parameters: LaserParameters
    xyz: Array
    direction: Array

    @classmethod
    def from_beams(cls, beams: Beams, parameters: LaserParameters) -> Cloud:
        """Compute the points of returns, or of medians."""
        direction, origin = laser_beams(beams.phi, beams.laser_id, parameters)
        length = beams.distance_m + parameters.dl[beams.laser_id]
        xyz = length[:, None] * direction + origin
        return cls(
            beams.distance_m, beams.phi, beams.laser_id, beams.tick_m, parameters, xyz, direction
        )

    def s(self, rows: Rows, plane: Plane) -> Array:
        """Residuals of rows along their beams, metres; equation (5)."""
        return misclosure(
            self.distance_m[rows],
            self.phi[rows],
            self.laser_id[rows],
            self.parameters,
            np.broadcast_to(plane.normal, (len(rows), 3)),
            np.full(len(rows), plane.offset),
        )

    def incidence(self, rows: Rows, plane: Plane) -> Array:
        """Angles of incidence of rows, radians."""
        return np.arccos(np.minimum(np.abs(self.direction[rows] @ plane.normal), 1.0))


@dataclass(frozen=True, kw_only=True)
class PlaneLimits:
    """What counts as a plane.

    Attributes
    ----------
    min_points : int
        Points that a plane must have.
    incidence_rad : float
        Largest angle between beam and normal.
    min_lasers : int
        Lasers that must see a plane.
    """

    min_points: int
    incidence_rad: float
    min_lasers: int = MIN_LASERS

    @classmethod
    def from_fit(cls, fit: PanelFit) -> PlaneLimits:
        """Limits out of the configuration's `outdoor: fit`."""
        return PlaneLimits(
            min_points=fit.min_points,
            incidence_rad=float(np.deg2rad(fit.incidence_deg)),
            min_lasers=fit.min_lasers,
        )


@dataclass(frozen=True, kw_only=True)
class Search(PlaneLimits):
    """How planes are looked for, and what counts as one.

    Attributes
    ----------
    planes : int
        Planes to find at most.
    distance_m : float
        Points of a found plane lie within this distance of it.
    extent_m : float
        Largest diameter of a found plane; what is flat over metres is not over a whole street.
    seed : int
        Seed of the random search.
    """

    planes: int
    distance_m: float
    extent_m: float
    seed: int

    @classmethod
    def from_config(cls, search: PlaneSearch) -> Search:
        """Search out of the configuration's `unsurveyed: search`."""
        return cls(
            planes=search.planes,
            distance_m=search.distance_cm * 1e-2,
            extent_m=search.extent_m,
            min_points=search.min_points,
            incidence_rad=float(np.deg2rad(search.incidence_deg)),
            seed=search.seed,
        )


@dataclass(frozen=True)
class FieldPlane:
    """A plane fitted to points of a recording.

    Attributes
    ----------
    name : str
        Name of the patch, or plane1, plane2, ...
    fit : PlaneFit
        The plane with the orthogonal distances of its points.
    rows : ndarray of int, shape (n,)
        Points that it was fitted to, rows of the cloud.
    s : ndarray, shape (n,)
        Their residuals along the beam, metres.
    trimmed : int
        Points left out as outliers.
    range_m, incidence_rad : float
        Mean range and mean angle of incidence.
    """

    name: str
    fit: PlaneFit
    rows: Rows
    s: Array
    trimmed: int
    range_m: float
    incidence_rad: float

    @property
    def tilt_rad(self) -> float:
        """Angle between normal and vertical: 0 for a level plane, pi/2 for an upright one."""
        return float(np.arccos(min(1.0, abs(self.fit.plane.normal[2]))))


#: Planes, and messages that say why there is none.
Found = tuple[list[FieldPlane], list[str]]


def patch_points(xyz: Array, box: Box) -> Rows:
    """Rows of the points, shape (n, 3), inside a box."""
    inside = np.ones(len(xyz), dtype=bool)
    for axis, (low, high) in enumerate((box.x_m, box.y_m, box.z_m)):
        inside &= (xyz[:, axis] >= low) & (xyz[:, axis] <= high)
    return np.flatnonzero(inside)


def fit_patches(cloud: Cloud, patches: Mapping[str, Box], limits: PlaneLimits) -> Found:
    """Fit a plane to the points in each box; a box without a plane becomes a finding.

    Parameters
    ----------
    cloud : Cloud
    patches : mapping of str to Box
        Boxes by name, as in `patch_points`.
    limits : PlaneLimits

    Returns
    -------
    Found
    """
    planes, findings = [], []
    for name, box in patches.items():
        try:
            planes.append(fit_robustly(name, cloud, patch_points(cloud.xyz, box), limits))
        except SurveyError as error:
            findings.append(f"{name}: {error}")
    return planes, findings


def fit_robustly(name: str, cloud: Cloud, rows: Rows, limits: PlaneLimits) -> FieldPlane:
    """Fit a plane to rows of a cloud without its outliers and without grazing returns.

    A return is an outlier if it is further from the median of its laser than three robust
    standard deviations, of that laser or of all lasers, whichever is larger: neither a laser that
    is off as a whole nor a noisy one is made to look like the others.

    Raises
    ------
    SurveyError
        If too few points or lasers are left.
    """
    keep = steep = np.ones(len(rows), dtype=bool)
    _, laser = np.unique(cloud.laser_id[rows], return_inverse=True)
    for _ in range(ROUNDS):
        _check_size(cloud, rows[keep], limits)
        plane = fit_plane(cloud.xyz[rows[keep]]).plane
        steep = cloud.incidence(rows, plane) <= limits.incidence_rad
        used = keep & steep
        s = cloud.s(rows, plane)
        centre = _medians(s, laser, used)[laser]
        size = np.where(np.isfinite(centre), np.abs(s - centre), np.inf)
        own = _medians(size, laser, used)[laser]
        common = _medians(size, np.zeros_like(laser), used)[0]
        # Never finer than half a tick: noise-free medians would trim themselves away.
        sigma = np.maximum(STD_PER_MAD * np.fmax(own, common), cloud.tick_m / 2)
        changed = steep & np.isfinite(size) & (size <= TRIM_AT * sigma)
        if np.array_equal(changed, keep):
            break
        keep = changed
    chosen = rows[keep]
    _check_size(cloud, chosen, limits)
    return plane_of(name, cloud, chosen, trimmed=int(np.count_nonzero(steep & ~keep)))


def plane_of(name: str, cloud: Cloud, rows: Rows, trimmed: int = 0) -> FieldPlane:
    """Fit a plane to rows of a cloud, all of which belong to it.

    Parameters
    ----------
    name : str
    cloud : Cloud
    rows : ndarray of int, shape (n,)
    trimmed : int
        Points that were left out before.
    """
    fit = fit_plane(cloud.xyz[rows])
    return FieldPlane(
        name,
        fit,
        rows,
        cloud.s(rows, fit.plane),
        trimmed=trimmed,
        range_m=float(np.mean(cloud.distance_m[rows])),
        incidence_rad=float(np.mean(cloud.incidence(rows, fit.plane))),
    )


def _check_size(cloud: Cloud, rows: Rows, limits: PlaneLimits) -> None:
    lasers = len(np.unique(cloud.laser_id[rows]))
    if len(rows) < limits.min_points or lasers < limits.min_lasers:
        raise SurveyError(
            f"{len(rows)} points of {lasers} lasers",
            allowed=f"{limits.min_points} points of {limits.min_lasers} lasers, or more",
        )


def _medians(values: Array, group: Rows, chosen: NDArray[np.bool_]) -> Array:
    """Median of the chosen values of each group; NaN for a group without any."""
    medians = np.full(int(group.max(initial=0)) + 1, np.nan)
    order = np.lexsort((values[chosen], group[chosen]))
    ordered = values[chosen][order]
    present, begin, count = np.unique(group[chosen][order], return_index=True, return_counts=True)
    below, above = ordered[begin + (count - 1) // 2], ordered[begin + count // 2]
    medians[present] = 0.5 * (below + above)
    return medians


def laser_columns(plane: FieldPlane, cloud: Cloud, sigma_m: float) -> dict[str, NDArray[Any]]:
    """Statistics of s on a plane, one element per laser that sees it, in cm and per cent.

    Parameters
    ----------
    plane : FieldPlane
    cloud : Cloud
        The points that it was fitted in.
    sigma_m : float
        Standard deviation of the datasheet, metres.

    Returns
    -------
    dict of str to ndarray, shape (lasers that see the plane,)
    """
    laser_id, n_lasers = cloud.laser_id[plane.rows], len(cloud.parameters)
    heading = {"plane": plane.name}
    columns = statistics_columns(heading, plane.s, laser_id, n_lasers, sigma_m)
    seen = columns["count"] > 0
    return {name: column[seen] for name, column in columns.items()}


def geometry(plane: Plane) -> dict[str, Any]:
    """Where a plane is, scanner frame, for JSON."""
    return {
        "normal": plane.normal,
        "offset_m": plane.offset,
        "abc_per_m": plane.general_form() if abs(plane.offset) > 1e-6 else None,
        "covariance": plane.covariance,
    }


def tabulate(
    planes: Sequence[FieldPlane],
    cloud: Cloud,
    medians: Mapping[str, NDArray[Any]],
    heading: Mapping[str, str],
    sigma_m: float,
) -> tuple[list[dict[str, Any]], dict[str, NDArray[Any]]]:
    """Everything that is reported of planes.

    Parameters
    ----------
    planes : sequence of FieldPlane
    cloud : Cloud
        The points that they were fitted in.
    medians : mapping of str to ndarray
        Columns ``spread`` (raw ticks) and ``count`` of the cloud's medians.
    heading : mapping of str to str
        Columns that are the same in every row of the table of lasers.
    sigma_m : float
        Standard deviation of the datasheet, metres.

    Returns
    -------
    rows : list of dict
        What is known of every plane in metres, degrees and centimetres, with its `geometry`.
    lasers : dict of str to ndarray
        `laser_columns` of all planes below each other.
    """
    parts = [laser_columns(plane, cloud, sigma_m) for plane in planes]
    rows = []
    for plane, part in zip(planes, parts, strict=True):
        summary = summary_row(part)
        often = plane.rows[medians["count"][plane.rows] >= MIN_SPREAD_COUNT]
        spread = medians["spread"][often] * cloud.tick_m * 1e2
        row = {
            "plane": plane.name,
            "points": len(plane.rows),
            "trimmed": plane.trimmed,
            "lasers": summary["lasers"],
            "range_m": plane.range_m,
            "incidence_deg": float(np.rad2deg(plane.incidence_rad)),
            "tilt_deg": float(np.rad2deg(plane.tilt_rad)),
            **{name: summary[name] for name in ("rms_cm", "std_cm", "pooled_rms_cm")},
            "spread_cm": float(np.median(spread)) if len(spread) else float("nan"),
            "flatness_mean_cm": plane.fit.flatness_mean_m * 1e2,
            "flatness_max_cm": plane.fit.flatness_max_m * 1e2,
        }
        rows.append(row | geometry(plane.fit.plane))
    names = ("plane", "laser_id", "count", *LASER_COLUMNS)
    table = {
        name: np.concatenate([part[name] for part in parts]) if parts else np.empty(0)
        for name in names
    }
    same = {name: np.full(len(table["plane"]), value) for name, value in heading.items()}
    return rows, same | table
