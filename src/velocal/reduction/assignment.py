"""Which surveyed plane a return hit, and the returns of a scan that hit one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import blocks
from velocal.geometry.planes import Patch
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.parameters import LaserParameters

#: Index of no plane.
NO_PLANE = 255


@dataclass(frozen=True)
class Limits:
    """What a return must satisfy to belong to a plane.

    Attributes
    ----------
    distance_m : float
        Largest difference between measured and expected range.
    edge_m : float
        The beam must meet the plane this far inside the hull of its targets.
    incidence_rad : float
        Largest angle between beam and normal.
    """

    distance_m: float = 0.25
    edge_m: float = 0.05
    incidence_rad: float = float(np.deg2rad(80.0))


def assign(
    beams: Beams, parameters: LaserParameters, patches: Sequence[Patch], limits: Limits
) -> NDArray[np.uint8]:
    """Assign returns to the patches that their beams meet first.

    Parameters
    ----------
    beams : Beams
        The n returns, or medians of them.
    parameters : LaserParameters
        Parameters before the adjustment; they need only be good to the limits.
    patches : sequence of Patch
        Surveyed patches in the scanner frame.
    limits : Limits

    Returns
    -------
    ndarray of uint8, shape (n,)
        Index of the patch, `NO_PLANE` for none.
    """
    return _assign(beams, parameters, patches, limits)[0]


def _assign(
    beams: Beams, parameters: LaserParameters, patches: Sequence[Patch], limits: Limits
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Index of the patch of every return, and whether its beam meets any, whatever it measured."""
    plane, meets = np.empty(len(beams), dtype=np.uint8), np.empty(len(beams), dtype=bool)
    for rows in blocks(len(beams)):
        plane[rows], meets[rows] = _assign_block(beams[rows], parameters, patches, limits)
    return plane, meets


def _assign_block(
    beams: Beams, parameters: LaserParameters, patches: Sequence[Patch], limits: Limits
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    direction, origin = laser_beams(beams.phi, beams.laser_id, parameters)
    length = beams.distance_m + parameters.dl[beams.laser_id]
    nearest = np.full(len(beams), np.inf)
    plane = np.full(len(beams), NO_PLANE, dtype=np.uint8)
    meets = np.zeros(len(beams), dtype=bool)
    for index, patch in enumerate(patches):
        towards = direction @ patch.plane.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = -(origin @ patch.plane.normal + patch.plane.offset) / towards
        candidates = np.flatnonzero(
            (np.abs(towards) >= np.cos(limits.incidence_rad)) & (expected > 0)
        )
        hit = origin[candidates] + expected[candidates, None] * direction[candidates]
        inside = candidates[patch.contains(hit, limits.edge_m)]
        meets[inside] = True
        near = np.abs(length[inside] - expected[inside]) <= limits.distance_m
        chosen = inside[near & (expected[inside] < nearest[inside])]
        nearest[chosen] = expected[chosen]
        plane[chosen] = index
    return plane, meets


def assigned_rows(
    beams: Beams, parameters: LaserParameters, patches: Sequence[Patch], limits: Limits
) -> dict[str, NDArray[Any]]:
    """Choose the returns, or medians, that lie on a plane.

    Parameters
    ----------
    beams : Beams
    parameters : LaserParameters
        Factory parameters, which decide what hit which plane.
    patches : sequence of Patch
        Surveyed patches in the scanner frame.
    limits : Limits

    Returns
    -------
    dict of str to ndarray, shape (m,)
        Columns of `schemas.ASSIGNED`: ``laser_id``, ``plane``, ``phi_rad``, ``distance_m``.
    """
    return _rows(beams, assign(beams, parameters, patches, limits))


def assigned_and_expected(
    beams: Beams, parameters: LaserParameters, patches: Sequence[Patch], limits: Limits
) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """Choose the returns on a plane, and count those that should have been.

    Parameters
    ----------
    beams : Beams
    parameters : LaserParameters
    patches : sequence of Patch
    limits : Limits

    Returns
    -------
    rows : dict of str to ndarray, shape (m,)
        See `assigned_rows`.
    expected : ndarray of int, shape (lasers,)
        Returns of every laser whose beam meets a plane inside its hull, whatever it measured.
    """
    plane, meets = _assign(beams, parameters, patches, limits)
    expected = np.bincount(beams.laser_id[meets], minlength=len(parameters))
    return _rows(beams, plane), expected


def _rows(beams: Beams, plane: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
    hit = plane != NO_PLANE
    rows = {
        "laser_id": beams.laser_id,
        "plane": plane,
        "phi_rad": beams.phi,
        "distance_m": beams.distance_m,
    }
    return {name: column[hit] for name, column in rows.items()}
