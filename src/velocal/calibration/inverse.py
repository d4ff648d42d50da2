"""The inverse of the point formulas: from points back to the raw values that a program used.

Of a laser that is known, a point has two unknowns and three coordinates. Without near-point
corrections the formula of every dialect is solved directly. With R = sqrt(X^2 + Y^2 - hoff^2),

    theta = atan2(X, Y) + atan2(hoff, R)      azimuth = theta + alpha
    L = (R - reach voff sin v) cos v + (Z - voff) sin v      distance = L - dl

(voff cos v in Z, where the offset is orthogonal). With near-point corrections a point of this
formula is computed, and moved until the program's formula gives the point that is wanted: the
corrections change by millimetres per metre, so that a few steps are enough.

What remains between the point that is given and the point of the raw values is the third
coordinate: it tells whether the laser, the calibration and the dialect are the right ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.calibration.dialects import Dialect
from velocal.scanner.parameters import LaserParameters

#: Steps of the iteration; each leaves about a hundredth of the error, at any range.
_STEPS = 8


@dataclass(frozen=True)
class RawValues:
    """What a program made points of.

    Attributes
    ----------
    distance_m : ndarray, shape (n,)
        Raw distance, before any correction, metres.
    azimuth : ndarray, shape (n,)
        Azimuth at which the program computed the point, radians, from 0 to 2 pi.
    residual_m : ndarray, shape (n,)
        Distance between the given point and that of these values; NaN where there are none.
    """

    distance_m: Array
    azimuth: Array
    residual_m: Array


def raw_values(
    dialect: Dialect, xyz: Array, laser_id: NDArray[np.integer], parameters: LaserParameters
) -> RawValues:
    """Invert the point formula of a program.

    Parameters
    ----------
    dialect : Dialect
    xyz : ndarray, shape (n, 3)
        Points in the scanner frame of this project, metres.
    laser_id : ndarray of int, shape (n,)
    parameters : LaserParameters
        Numbers of this dialect that take effect (`Dialect.effective`).

    Returns
    -------
    RawValues
        Where a program changes its formula with the range (the near-point corrections of `manual`
        and of velodyne_decoder end at 25 m), two raw values may give one point. The nearer one is
        taken then, which differs by the near-point correction at this place.
    """
    two_point = dialect.two_point
    without = replace(dialect, two_point=None)
    if two_point is None or not dialect.has_near(parameters):
        return _checked(
            dialect, xyz, laser_id, parameters, _direct(without, xyz, laser_id, parameters)
        )
    always = replace(dialect, two_point=replace(two_point, limit_m=np.inf))
    near = _checked(
        dialect, xyz, laser_id, parameters, _iterated(always, xyz, laser_id, parameters)
    )
    far = _checked(dialect, xyz, laser_id, parameters, _direct(without, xyz, laser_id, parameters))
    # Comparisons with NaN are false: a near value that is none is never taken.
    use_near = (near.distance_m <= two_point.limit_m) & ~(far.residual_m < near.residual_m - 1e-9)
    return RawValues(
        *(
            np.where(use_near, getattr(near, name), getattr(far, name))
            for name in ("distance_m", "azimuth", "residual_m")
        )
    )


def _direct(
    dialect: Dialect, xyz: Array, laser_id: NDArray[np.integer], parameters: LaserParameters
) -> tuple[Array, Array]:
    """Raw distance and azimuth by a formula without near-point corrections; NaN where none."""
    dl, alpha, v, voff, hoff = (
        getattr(parameters, name)[laser_id] for name in ("dl", "alpha", "v", "voff", "hoff")
    )
    x, y, z = xyz.T
    flat, steep = np.cos(v), np.sin(v)
    with np.errstate(invalid="ignore"):
        reach = np.sqrt(x**2 + y**2 - hoff**2)
    theta = np.arctan2(x, y) + np.arctan2(hoff, reach)
    up = z - voff * (flat if dialect.orthogonal else 1.0)
    length = (reach - dialect.reach * voff * steep) * flat + up * steep
    azimuth = theta + alpha if dialect.alpha else theta
    return length - dl, np.asarray(azimuth)


def _iterated(
    dialect: Dialect, xyz: Array, laser_id: NDArray[np.integer], parameters: LaserParameters
) -> tuple[Array, Array]:
    """Raw distance and azimuth by a formula with near-point corrections at all ranges."""
    without = replace(dialect, two_point=None)
    wanted = xyz
    distance_m, azimuth = _direct(without, wanted, laser_id, parameters)
    for _ in range(_STEPS):
        missing = xyz - dialect.points(distance_m, azimuth, laser_id, parameters)
        wanted = without.points(distance_m, azimuth, laser_id, parameters) + missing
        distance_m, azimuth = _direct(without, wanted, laser_id, parameters)
    return distance_m, azimuth


def _checked(
    dialect: Dialect,
    xyz: Array,
    laser_id: NDArray[np.integer],
    parameters: LaserParameters,
    values: tuple[Array, Array],
) -> RawValues:
    """Raw values with their residuals by the program's own formula."""
    distance_m, azimuth = values
    again = dialect.points(distance_m, azimuth, laser_id, parameters)
    residual = np.sqrt(((xyz - again) ** 2).sum(axis=1))
    return RawValues(distance_m, np.mod(azimuth, 2.0 * np.pi), residual)
