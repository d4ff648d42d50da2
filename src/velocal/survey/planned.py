"""Stations that nobody has surveyed yet, with the accuracy that their survey will have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from velocal.arrays import Array
from velocal.geometry.rigid import RigidTransformation, rotation_from_vector
from velocal.scanner.models import Scanner
from velocal.study.sketch import Sketch, Stand
from velocal.survey.station import Station
from velocal.survey.targets import Targets

#: Targets on sketched surfaces lie this share of the way from the edge to the middle.
_INSIDE = 0.02
_MM = 1e-3


@dataclass(frozen=True)
class PlannedSurvey:
    """What a survey will measure at every station.

    Attributes
    ----------
    planes : Targets
        On the surfaces, site frame.
    names : tuple of str
        Surfaces that are used.
    base : Targets
        On the base of the scanner, in its frame.
    base_site_std_m : float
        Standard deviation of their coordinates in the site frame.
    covariances : mapping of str to ndarray, shape (4, 4), or None
        Of planes, as in `Station.adjust`.
    flatness_m : float or None
        Of every surface; as the targets show it if None.
    """

    planes: Targets
    names: tuple[str, ...]
    base: Targets
    base_site_std_m: float
    covariances: Mapping[str, Array] | None = None
    flatness_m: float | None = None

    def station(self, name: str, stand: Stand, scanner: Scanner) -> Station:
        """Adjust a station on targets that are where the plan says.

        Parameters
        ----------
        name : str
        stand : Stand
        scanner : Scanner

        Returns
        -------
        Station
            Its covariances are those that the survey will have.

        Raises
        ------
        SurveyError
            If targets are too few or lie on a line.
        """
        site = pose_of(stand, scanner).apply(self.base.xyz)
        n = len(site)
        std = np.full((n, 3), self.base_site_std_m)
        return Station.adjust(
            self.planes,
            self.base,
            Targets(self.base.name, (name,) * n, site, std),
            self.names,
            covariances=self.covariances,
            where=f"plan of station {name!r}",
        )


def pose_of(stand: Stand, scanner: Scanner) -> RigidTransformation:
    """``T_site_scanner`` of a planned station, without covariance.

    Parameters
    ----------
    stand : Stand
    scanner : Scanner
        Says how high the origin of its frame lies above its bottom.
    """
    turn = rotation_from_vector(np.array([0.0, 0.0, -np.deg2rad(stand.heading_deg)]))
    towards, tilt = np.deg2rad(stand.towards_deg), np.deg2rad(stand.tilt_deg)
    # The top moves along (sin, cos): the axis is that direction turned by a right angle.
    axis = np.array([-np.cos(towards), np.sin(towards), 0.0])
    rotation = rotation_from_vector(tilt * axis) @ turn
    bottom = np.array([stand.x_m, stand.y_m, stand.height_m])
    return RigidTransformation(
        rotation, bottom + scanner.origin_height_m * rotation[:, 2], np.zeros((6, 6))
    )


def sketched_survey(sketch: Sketch) -> PlannedSurvey:
    """Spread targets over the surfaces of a sketch and around the base.

    Parameters
    ----------
    sketch : Sketch

    Returns
    -------
    PlannedSurvey
    """
    how = sketch.survey
    corners = {
        name: np.array(
            [
                [*wall.from_m, wall.bottom_m],
                [*wall.to_m, wall.bottom_m],
                [*wall.to_m, wall.top_m],
                [*wall.from_m, wall.top_m],
            ]
        )
        for name, wall in sketch.walls.items()
    } | {name: np.array(surface.corners_m) for name, surface in sketch.surfaces.items()}
    places = {name: _spread(each, how.targets) for name, each in corners.items()}
    xyz = np.concatenate(list(places.values()))
    group = tuple(name for name, each in places.items() for _ in each)
    names = tuple(
        f"{name}{number + 1}" for name, each in places.items() for number in range(len(each))
    )
    n = how.base_targets
    angle = 2.0 * np.pi * np.arange(n) / n
    # Two heights, so that four targets and more do not lie in one plane.
    ring = np.column_stack([np.sin(angle), np.cos(angle), 0.3 * (np.arange(n) % 2)])
    return PlannedSurvey(
        planes=Targets(names, group, xyz, np.full(xyz.shape, how.targets_mm * _MM)),
        names=tuple(places),
        base=Targets(
            tuple(f"B{number + 1}" for number in range(n)),
            (sketch.scanner,) * n,
            how.base_radius_m * ring,
            np.full((n, 3), how.base_scanner_mm * _MM),
        ),
        base_site_std_m=how.base_site_mm * _MM,
        flatness_m=how.flatness_mm * _MM,
    )


def _spread(corners: Array, count: int) -> Array:
    """Targets near the corners of a surface, and the others along rings inside, (n, 3)."""
    centre = corners.mean(axis=0)
    found = [*(corners + _INSIDE * (centre - corners))]
    edges = np.roll(corners, -1, axis=0)
    middles = 0.5 * (corners + edges)
    for share in (_INSIDE, 0.5, 0.25, 0.75):
        ring = middles if share == _INSIDE else corners
        found += [*(ring + share * (centre - ring))]
    while len(found) < count:
        found += [*(0.5 * (np.array(found) + centre))]
    return np.array(found[: max(count, len(corners))])
