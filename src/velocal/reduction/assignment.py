"""Which surveyed plane a return hit, and the residual of the returns that hit one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.geometry.planes import Patch
from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import LaserParameters

Array = NDArray[np.float64]
#: Index of no plane.
NO_PLANE = 255


@dataclass(frozen=True)
class Gates:
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

    distance_m: float
    edge_m: float
    incidence_rad: float


def assign(
    distance_m: Array,
    phi: Array,
    laser_id: NDArray[np.integer],
    parameters: LaserParameters,
    patches: Sequence[Patch],
    gates: Gates,
) -> NDArray[np.uint8]:
    """Assign returns to the patches that their beams meet first.

    Parameters
    ----------
    distance_m, phi, laser_id : ndarray, shape (n,)
        Raw distance (metres), rotational angle (radians), laser.
    parameters : LaserParameters
        Parameters before the adjustment; they need only be good to the gate.
    patches : sequence of Patch
        Surveyed patches in the scanner frame.
    gates : Gates
        Limits.

    Returns
    -------
    ndarray of uint8, shape (n,)
        Index of the patch, `NO_PLANE` for none.
    """
    direction, origin = laser_beams(phi, laser_id, parameters)
    length = distance_m + parameters.dl[laser_id]
    nearest = np.full(len(phi), np.inf)
    plane = np.full(len(phi), NO_PLANE, dtype=np.uint8)
    for index, patch in enumerate(patches):
        towards = direction @ patch.plane.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = -(origin @ patch.plane.normal + patch.plane.offset) / towards
        candidates = np.flatnonzero(
            (np.abs(towards) >= np.cos(gates.incidence_rad))
            & (expected > 0)
            & (expected < nearest)
            & (np.abs(length - expected) <= gates.distance_m)
        )
        hit = origin[candidates] + expected[candidates, None] * direction[candidates]
        chosen = candidates[patch.contains(hit, gates.edge_m)]
        nearest[chosen] = expected[chosen]
        plane[chosen] = index
    return plane
