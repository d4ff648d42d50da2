"""The calibration of a scanner: five parameters per laser, and what drivers carry along."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.scanner.models import Scanner

#: The parameters of the scanner model (equations 1-3), in the order of every matrix.
PARAMETERS = ("dl", "alpha", "v", "voff", "hoff")
#: Unit of each.
UNITS = {"dl": "m", "alpha": "rad", "v": "rad", "voff": "m", "hoff": "m"}
#: Carried values of the two-point distance correction: near-point corrections along X and Y, and
#: the flag of ROS YAML that says whether they are used (1 or 0).
NEAR_POINT = ("dist_correction_x", "dist_correction_y")
TWO_POINT = "two_pt_correction_available"
#: Range at which the factory finds the distance correction of a two-point file, metres.
FAR_POINT_M = 25.04


@dataclass(frozen=True)
class LaserParameters:
    """Parameters of every laser, by `laser_id`.

    Attributes
    ----------
    dl : ndarray, shape (n,)
        Distance correction, metres, added to the raw distance.
    alpha : ndarray, shape (n,)
        Rotational angle correction, radians, subtracted from the rotational angle.
    v : ndarray, shape (n,)
        Vertical angle, radians, positive up.
    voff, hoff : ndarray, shape (n,)
        Vertical and horizontal offset of the beam's origin, metres.
    carried : mapping of str to ndarray, shape (n,)
        Values that the model does not use but that a driver's file holds (focal distance and
        slope, near-point distance corrections, intensity bounds), by their name in ROS YAML.
    """

    dl: Array
    alpha: Array
    v: Array
    voff: Array
    hoff: Array
    carried: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that all arrays belong to the same lasers."""
        for name in PARAMETERS:
            if getattr(self, name).shape != self.dl.shape or self.dl.ndim != 1:
                raise VelocalError(f"parameter {name!r} has shape {getattr(self, name).shape}")

    def __len__(self) -> int:
        return len(self.dl)

    def corrected(self, corrections: Mapping[str, Array]) -> LaserParameters:
        """Add corrections to some of the parameters.

        A correction of `dl` moves the near-point corrections of two-point files by the same
        amount, so that a driver that interpolates between them sees the same change.

        Parameters
        ----------
        corrections : mapping of str to ndarray, shape (n,)
            By parameter, in its unit.

        Returns
        -------
        LaserParameters
        """
        # Not by `replace`, which is slow: each linearisation of each laser calls this.
        values = {name: getattr(self, name) for name in PARAMETERS}
        values |= {name: values[name] + value for name, value in corrections.items()}
        carried = dict(self.carried)
        if "dl" in corrections:
            for near in NEAR_POINT:
                if near in carried:
                    carried[near] = carried[near] + corrections["dl"]
        return LaserParameters(**values, carried=carried)


def nominal(scanner: Scanner) -> LaserParameters:
    """Make the parameters of the design: nominal angles and offsets, no distance correction.

    Parameters
    ----------
    scanner : Scanner

    Returns
    -------
    LaserParameters
        Its arrays are copies.
    """
    return LaserParameters(
        dl=np.zeros(scanner.n_lasers),
        alpha=scanner.rotational_rad.copy(),
        v=scanner.vertical_rad.copy(),
        voff=scanner.vertical_offset_m.copy(),
        hoff=scanner.horizontal_offset_m.copy(),
    )
