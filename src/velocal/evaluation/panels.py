"""Outdoor validation: how flat panels are at 10 to 35 m, before and after calibration.

Nobody surveys outdoors: the user says about where the panels stand, and a plane is fitted to the
returns of each, with every calibration anew. A plane takes up what the errors of its lasers have
in common, and a tilt: with the few lasers that meet a distant panel, a good part of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.errors import SurveyError, VelocalError
from velocal.evaluation.planes_in_data import Cloud, FieldPlane, Search, fit_robustly, patch_points
from velocal.evaluation.statistics import laser_statistics
from velocal.geometry.planes import fit_plane
from velocal.scanner.models import scanner_named
from velocal.scanner.parameters import LaserParameters
from velocal.study.config import Box, Panel, PanelFit

Array = NDArray[np.float64]

#: Name of the calibration that the scanner came with.
BEFORE = "before"
#: Columns of a sample that are the same in all its rows.
HEADING = ("kind", "scanner", "sample")


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

    def rows(self, xyz: Array, name: str) -> NDArray[np.int64]:
        """Rows of the points, shape (n, 3) in the scanner frame, inside a panel's box."""
        sine, cosine = np.sin(self.azimuth_rad), np.cos(self.azimuth_rad)
        turned = np.column_stack(
            [
                xyz[:, 0] * cosine - xyz[:, 1] * sine,
                xyz[:, 0] * sine + xyz[:, 1] * cosine,
                xyz[:, 2],
            ]
        )
        ahead = (self.distance_m - self.depth_m, self.distance_m + self.depth_m)
        box = self.boxes[name]
        return patch_points(turned, Box(x_m=box.across_m, y_m=ahead, z_m=box.up_m))


def search(fit: PanelFit) -> Search:
    """What counts as a plane, out of the configuration's `outdoor: fit`; nothing is searched."""
    return Search(
        planes=0,
        distance_m=0.0,
        extent_m=0.0,
        min_points=fit.min_points,
        incidence_rad=float(np.deg2rad(fit.incidence_deg)),
        seed=0,
        min_lasers=fit.min_lasers,
    )


def fit_panels(cloud: Cloud, panels: Panels, search: Search, where: str) -> list[FieldPlane]:
    """Fit a plane to the returns of every panel, without people, fog and other outliers.

    Raises
    ------
    SurveyError
        If a panel has too few returns or too few lasers.
    """
    planes = []
    for name in panels.boxes:
        try:
            rows = panels.rows(cloud.xyz, name)
            planes.append(fit_robustly(name, cloud, rows, search))
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
    cloud: Cloud, planes: Sequence[FieldPlane], candidates: Mapping[str, LaserParameters]
) -> list[dict[str, Any]]:
    """How flat every calibration makes every panel.

    The returns of a panel are the same for all; the plane is fitted to them with each.

    Parameters
    ----------
    cloud : Cloud
        Points with the factory's parameters.
    planes : sequence of FieldPlane
        What `fit_panels` found in it.
    candidates : mapping of str to LaserParameters
        `BEFORE` and the parameter sets.

    Returns
    -------
    list of dict
        Per panel and calibration: ``distance_m``, the mean range; ``incidence_deg``; ``points``;
        ``trimmed``, returns left out as outliers; ``lasers``; ``std_cm``, mean over the lasers of
        the root mean square of s about the plane, as in the tables; ``pooled_rms_cm``, of all s.
    """
    rows = []
    for plane in planes:
        chosen = plane.rows
        laser_id = cloud.laser_id[chosen]
        for name, parameters in candidates.items():
            seen = Cloud.from_beams(cloud[chosen], parameters)
            fitted = fit_plane(seen.xyz).plane
            s = seen.s(np.arange(len(chosen)), fitted)
            lasers = laser_statistics(s, laser_id, len(parameters), 1.0)
            rows.append(
                {
                    "panel": plane.name,
                    "calibration": name,
                    "distance_m": float(np.mean(np.linalg.norm(seen.xyz, axis=1))),
                    "incidence_deg": float(np.rad2deg(plane.incidence_rad)),
                    "points": len(chosen),
                    "trimmed": plane.trimmed,
                    "lasers": int(np.count_nonzero(lasers.count)),
                    "std_cm": float(np.nanmean(lasers.rms_m)) * 1e2,
                    "pooled_rms_cm": float(np.sqrt(np.mean(s**2))) * 1e2,
                }
            )
    return rows


def sample_row(heading: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Reduce the rows of `panel_rows` of a sample to one: means over the panels.

    ``lasers`` is that of the panel that fewest see; ``{calibration}_cm`` is ``std_cm``.
    """
    before = [row for row in rows if row["calibration"] == BEFORE]
    names = dict.fromkeys(str(row["calibration"]) for row in rows)
    return {
        **heading,
        "distance_m": float(np.mean([row["distance_m"] for row in before])),
        "points": sum(int(row["points"]) for row in before),
        "trimmed": sum(int(row["trimmed"]) for row in before),
        "lasers": min(int(row["lasers"]) for row in before),
        **{
            f"{name}_cm": float(
                np.mean([row["std_cm"] for row in rows if row["calibration"] == name])
            )
            for name in names
        },
    }


def summarise(
    rows: Sequence[Mapping[str, Any]],
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Rows of all samples, `HEADING` included, to one per sample, and one per kind and scanner."""
    by_sample: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        by_sample.setdefault(tuple(str(row[key]) for key in HEADING), []).append(row)
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for key, of_sample in by_sample.items():
        heading = dict(zip(HEADING, key, strict=True))
        groups.setdefault(key[:2], []).append(sample_row(heading, of_sample))
    every = [with_after(group) for group in groups.values()]
    return [sample for group in every for sample in group], [means(group) for group in every]


def with_after(samples: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Samples of one kind and scanner with the columns ``parameters`` and ``after_cm``.

    After is the parameter set of least mean over the samples, the first of equals, as the tables
    of validation choose theirs.

    Raises
    ------
    VelocalError
        If the samples do not have the same sets, or none.
    """
    columns = {key for sample in samples for key in sample if key.endswith("_cm")}
    sets = [key for key in samples[0] if key in columns and key != f"{BEFORE}_cm"]
    if not sets or any(not columns <= set(sample) for sample in samples):
        raise VelocalError(
            f"samples {', '.join(str(sample['sample']) for sample in samples)} have "
            + ("different parameter sets" if sets else "no parameter set"),
            where="outdoor",
            allowed="one or more sets, the same for all samples of a scanner",
        )
    best = min(sets, key=lambda key: float(np.mean([sample[key] for sample in samples])))
    shown = {"parameters": best.removesuffix("_cm")}
    return [{**sample, **shown, "after_cm": sample[best]} for sample in samples]


def means(samples: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over the samples of one kind and scanner, as `with_after` gives them."""
    first = samples[0]
    return {
        "kind": first["kind"],
        "scanner": first["scanner"],
        "samples": len(samples),
        **{
            key: float(np.mean([sample[key] for sample in samples]))
            for key in first
            if key.endswith("_cm")
        },
        "parameters": first["parameters"],
    }


def facts(of_kinds: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Means as single numbers, ``item`` and ``value``: outdoor_real_after_32 and its like."""
    return [
        {
            "item": f"outdoor_{row['kind']}_{when}_{scanner_named(row['scanner']).short_name}",
            "value": row[f"{when}_cm"],
        }
        for row in of_kinds
        for when in ("before", "after")
    ]
