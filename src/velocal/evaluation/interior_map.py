"""Map of an interior: scans of surveyed positions in one frame, and sections of its walls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.geometry.rigid import RigidTransformation, adjust_rigid
from velocal.scanner.beam import Beams
from velocal.scanner.parameters import LaserParameters
from velocal.study.planes import Box
from velocal.survey.targets import Targets, common

#: The two calibrations that a map has.
STATES = ("factory", "refined")


def scanner_pose(base_map: Targets, base_scanner: Targets, *, where: str) -> RigidTransformation:
    """``T_map_scanner`` of a position from the targets on the scanner's base, in both frames.

    Parameters
    ----------
    base_map, base_scanner : Targets
        Targets on the base of the scanner, in the frame of the map and in that of the scanner.
    where : str
        File, for errors.

    Returns
    -------
    RigidTransformation

    Raises
    ------
    SurveyError
        If fewer than three targets are common, or they lie on a line.
    """
    there, here = common(base_map, base_scanner, where=where)
    adjusted = adjust_rigid(here.xyz, there.xyz, here.covariance(), there.covariance())
    return adjusted.transformation


def first_complete(complete: NDArray[np.bool_], where: str) -> NDArray[np.int64]:
    """Number of the first complete rotation of a recording, as an array of one.

    Raises
    ------
    VelocalError
        If no rotation is complete.
    """
    first = np.flatnonzero(complete)[:1]
    if not len(first):
        raise VelocalError(
            "no rotation is complete",
            where=where,
            hint="A scan of a position needs two rotations of recording.",
        )
    return first


def rows(
    number: int,
    beams: Beams,
    calibrations: Sequence[LaserParameters],
    pose: RigidTransformation,
) -> dict[str, NDArray[Any]]:
    """Points of the returns of a scan.

    Parameters
    ----------
    number : int
        Of the position.
    beams : Beams
    calibrations : sequence of LaserParameters
        In the order of `STATES`.
    pose : RigidTransformation
        ``T_map_scanner``.

    Returns
    -------
    dict of str to ndarray
        Columns of `schemas.MAP`.
    """
    columns: dict[str, NDArray[Any]] = {
        "position": np.full(len(beams), number, dtype=np.uint8),
        "laser_id": beams.laser_id,
    }
    for state, parameters in zip(STATES, calibrations, strict=True):
        xyz = pose.apply(beams.points(parameters))
        columns |= {f"{axis}_{state}_m": xyz[:, i] for i, axis in enumerate("xyz")}
    return columns


def clouds(columns: Mapping[str, NDArray[Any]]) -> dict[str, Array]:
    """Points of a map by calibration, shape (n, 3), out of the columns of `schemas.MAP`."""
    return {
        state: np.column_stack([columns[f"{axis}_{state}_m"].astype(float) for axis in "xyz"])
        for state in STATES
    }


@dataclass(frozen=True)
class Section:
    """A stretch of one wall: the returns within a box, with both calibrations.

    Attributes
    ----------
    rows : ndarray of int, shape (n,)
        Returns whose points lie in the box with both calibrations.
    along : dict of str to ndarray, shape (n,)
        Coordinate along the wall by calibration, metres.
    across : dict of str to ndarray, shape (n,)
        Distance from the straight line fitted to the points of that calibration, metres.
    """

    rows: NDArray[np.int64]
    along: dict[str, Array]
    across: dict[str, Array]

    def thickness(self, state: str) -> float:
        """Root mean square distance from the fitted line, metres."""
        return float(np.sqrt(np.mean(self.across[state] ** 2)))


def section(xyz: Mapping[str, Array], box: Box, name: str) -> Section:
    """Cut a stretch of an upright wall out of a map.

    Parameters
    ----------
    xyz : mapping of str to ndarray, shape (n, 3)
        The same returns with each of `STATES`.
    box : Box
        The wall runs along the longer horizontal side;
        the box must hold nothing but the wall, and be wide enough across for its points.
    name : str
        For the error.

    Returns
    -------
    Section

    Raises
    ------
    VelocalError
        If the box holds fewer than ten points.
    """
    limits = np.array([box.x_m, box.y_m, box.z_m], dtype=float)
    inside = np.all(
        [np.all((p >= limits[:, 0]) & (p <= limits[:, 1]), axis=1) for p in xyz.values()], axis=0
    )
    rows = np.flatnonzero(inside)
    if len(rows) < 10:
        raise VelocalError(
            f"section {name!r} of the map holds {len(rows)} points",
            where="figures",
            allowed="10 or more",
            hint="Move the box to a wall that a position sees.",
        )
    extent = limits[:, 1] - limits[:, 0]
    run = int(np.argmax(extent[:2]))
    along, across = {}, {}
    for state, p in xyz.items():
        t, d = p[rows, run], p[rows, 1 - run]
        slope, level = np.polyfit(t - t.mean(), d, 1)
        along[state] = t
        across[state] = (d - level - slope * (t - t.mean())) / np.hypot(1.0, slope)
    return Section(rows, along, across)


def summary_table(
    columns: Mapping[str, NDArray[Any]], sections: Mapping[str, Section]
) -> dict[str, list[str]]:
    """What is to be read of a map, columns ``item`` and ``value``.

    Items are ``map_points``, ``map_positions`` and, for every section, ``{section}_points`` and
    ``{section}_{factory,refined}_rms_cm``.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Of `schemas.MAP`.
    sections : mapping of str to Section

    Returns
    -------
    dict of str to list of str
    """
    # As text: counts have no decimals.
    values = {
        "map_points": str(len(columns["laser_id"])),
        "map_positions": str(len(np.unique(columns["position"]))),
    }
    for name, part in sections.items():
        values[f"{name}_points"] = str(len(part.rows))
        for state in STATES:
            values[f"{name}_{state}_rms_cm"] = f"{100.0 * part.thickness(state):.3f}"
    return {"item": list(values), "value": list(values.values())}
