"""Single scans: the returns of a few rotations, assigned to surveyed planes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.geometry.planes import Patch
from velocal.reduction.assignment import NO_PLANE, Gates, assign
from velocal.scanner.beam import angle_from_ticks, distance_from_ticks
from velocal.scanner.models import Scanner
from velocal.scanner.parameters import LaserParameters

#: Columns of the table of returns that a scan needs.
COLUMNS = ["rotation", "azimuth", "laser_id", "distance"]

Columns = Mapping[str, NDArray[Any]]


def first_rotations(columns: Columns, rotations: int) -> dict[str, NDArray[Any]]:
    """Returns of the first rotations in a table of returns, without the empty shots."""
    first = np.unique(columns["rotation"])[:rotations]
    chosen = np.isin(columns["rotation"], first) & (columns["distance"] > 0)
    return {name: column[chosen] for name, column in columns.items()}


def assigned_scan(
    scan: Columns,
    scanner: Scanner,
    rotation_rate_hz: float,
    parameters: LaserParameters,
    patches: Sequence[Patch],
    gates: Gates,
) -> dict[str, NDArray[Any]]:
    """Returns (or medians) that lie on a plane, as columns of `schemas.ASSIGNED`.

    Parameters
    ----------
    scan : mapping of str to ndarray, shape (n,)
        Columns ``laser_id``, ``azimuth`` and ``distance`` in raw ticks.
    scanner : Scanner
    rotation_rate_hz : float
        For the angle at which late lasers of a firing fired.
    parameters : LaserParameters
        Factory parameters, which decide what hit which plane.
    patches : sequence of Patch
        Surveyed patches in the scanner frame.
    gates : Gates
        Limits of the assignment.
    """
    laser = scan["laser_id"]
    phi = angle_from_ticks(scan["azimuth"], laser, scanner, 2.0 * np.pi * rotation_rate_hz)
    distance = distance_from_ticks(scan["distance"], scanner.distance_tick_m)
    plane = assign(distance, phi, laser, parameters, patches, gates)
    hit = plane != NO_PLANE
    rows = {"laser_id": laser, "plane": plane, "phi_rad": phi, "distance_m": distance}
    return {name: column[hit] for name, column in rows.items()}
