"""Panels outdoors, at 10 to 35 m: how flat every calibration sees them.

Nobody surveys outdoors: the user says about where the panels stand, and a plane is fitted to the
returns of each, with every calibration anew. A plane absorbs what the errors of its lasers have in
common, and a tilt. With the few lasers that meet a distant panel this is a good part of the errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.evaluation.candidates import Candidate
from velocal.evaluation.planes_in_data import (
    Cloud,
    FieldPlane,
    PlaneLimits,
    fit_robustly,
    patch_points,
)
from velocal.evaluation.statistics import laser_rms
from velocal.geometry.planes import fit_plane
from velocal.scanner.beam import Beams
from velocal.scanner.parameters import LaserParameters
from velocal.study.planes import Box, Panel


@dataclass(frozen=True)
class Panels:
    """Where the panels of a sample stand, as the user knows it.

    Attributes
    ----------
    distance_m : float
        Horizontal distance of the panels from the scanner.
    azimuth_rad : float
        Direction of the middle between them, clockwise from the scanner's Y axis.
    boxes : mapping of str to Panel
        By panel, spans to the right of that direction and above the origin of the scanner.
    depth_m : float
        Points may lie so far before or behind the distance.
    """

    distance_m: float
    azimuth_rad: float
    boxes: Mapping[str, Panel]
    depth_m: float

    def possible(self, beams: Beams, parameters: LaserParameters) -> Beams:
        """Returns that may lie in one of the boxes, by their azimuth: few of all returns.

        Parameters
        ----------
        beams : Beams
            Returns.
        parameters : LaserParameters

        Returns
        -------
        Beams
            Some of them, in their order.
        """
        aside = float(np.max(np.abs(parameters.hoff)))
        nearest = self.distance_m - self.depth_m - aside
        if nearest <= 0.0:  # a box may be all around
            return beams
        widest = max(max(map(abs, box.across_m)) for box in self.boxes.values()) + aside
        off = beams.phi - parameters.alpha[beams.laser_id] - self.azimuth_rad
        return beams[np.cos(off) >= np.cos(np.arctan2(widest, nearest))]

    def rows(self, xyz: Array, name: str) -> NDArray[np.int64]:
        """Rows of the points, shape (n, 3) in the scanner frame, inside a panel's box."""
        sine, cosine = np.sin(self.azimuth_rad), np.cos(self.azimuth_rad)
        low, high = self.distance_m - self.depth_m, self.distance_m + self.depth_m
        ahead = xyz[:, 0] * sine + xyz[:, 1] * cosine
        near = np.flatnonzero((ahead >= low) & (ahead <= high))  # few of all points
        x, y, z = xyz[near].T
        turned = np.column_stack([x * cosine - y * sine, ahead[near], z])
        box = self.boxes[name]
        return near[patch_points(turned, Box(x_m=box.across_m, y_m=(low, high), z_m=box.up_m))]


def fit_panels(cloud: Cloud, panels: Panels, limits: PlaneLimits, where: str) -> list[FieldPlane]:
    """Fit a plane to the returns of every panel, without people, fog and other outliers.

    Parameters
    ----------
    cloud : Cloud
        Points with the factory's parameters.
    panels : Panels
    limits : PlaneLimits
        What counts as a plane.
    where : str
        Sample, for errors.

    Returns
    -------
    list of FieldPlane
        One per panel.

    Raises
    ------
    SurveyError
        If a panel has too few returns or too few lasers.
    """
    planes = []
    for name in panels.boxes:
        try:
            rows = panels.rows(cloud.xyz, name)
            planes.append(fit_robustly(name, cloud, rows, limits))
        except SurveyError as error:
            raise SurveyError(
                f"no plane can be fitted to panel {name!r} at {panels.distance_m:g} m, "
                f"{np.rad2deg(panels.azimuth_rad):g} deg: {error.what}",
                where=where,
                allowed=error.allowed,
                hint="Look at the sample's distance_m and azimuth_deg, and at outdoor.panels.",
            ) from None
    return planes


def panel_rows(
    cloud: Cloud, planes: Sequence[FieldPlane], candidates: Sequence[Candidate]
) -> list[dict[str, Any]]:
    """How flat every calibration makes every panel.

    The returns of a panel are the same for all; the plane is fitted to them with each.

    Parameters
    ----------
    cloud : Cloud
        Points with the factory's parameters.
    planes : sequence of FieldPlane
        What `fit_panels` found in it.
    candidates : sequence of Candidate
        The factory's calibration and the parameter sets.

    Returns
    -------
    list of dict
        Per panel and calibration: ``role`` and ``parameter_set``; ``distance_m``, the mean range;
        ``incidence_deg``; ``points``; ``trimmed``, returns left out as outliers; ``lasers``;
        ``rms_cm``, mean over the lasers of the root mean square of s about the plane, as in the
        tables; ``pooled_rms_cm``, of all s.
    """
    rows = []
    for plane in planes:
        chosen = plane.rows
        laser_id = cloud.laser_id[chosen]
        for each in (shown for candidate in candidates for shown in candidate.shown()):
            seen = Cloud.from_beams(each.observed(cloud[chosen]), each.parameters)
            fitted = fit_plane(seen.xyz).plane
            s = seen.s(np.arange(len(chosen)), fitted)
            lasers_m = laser_rms(s, laser_id, len(each.parameters))
            rows.append(
                {
                    "panel": plane.name,
                    **each.identity,
                    "distance_m": float(np.mean(np.linalg.norm(seen.xyz, axis=1))),
                    "incidence_deg": float(np.rad2deg(plane.incidence_rad)),
                    "points": len(chosen),
                    "trimmed": plane.trimmed,
                    "lasers": int(np.count_nonzero(np.isfinite(lasers_m))),
                    "rms_cm": float(np.nanmean(lasers_m)) * 1e2,
                    "pooled_rms_cm": float(np.sqrt(np.mean(s**2))) * 1e2,
                }
            )
    return rows
