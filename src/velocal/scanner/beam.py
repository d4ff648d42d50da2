"""Scanner model: raw range, rotational angle and parameters to points (equations 1-3).

All functions work on arrays of one element per return; parameters are those of its laser.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from velocal.scanner.models import AZIMUTH_TICK_DEG, Scanner
from velocal.scanner.parameters import LaserParameters

Array = NDArray[np.float64]


def beams(phi: Array, alpha: Array, v: Array, voff: Array, hoff: Array) -> tuple[Array, Array]:
    """Unit direction and origin of beams, each of shape (n, 3); equation (3).

    Parameters
    ----------
    phi : ndarray, shape (n,)
        Rotational angle, radians, clockwise seen from above, zero along Y.
    alpha, v, voff, hoff : ndarray, shape (n,)
        Parameters of each beam's laser.

    Returns
    -------
    direction, origin : ndarray, shape (n, 3)
        Scanner frame; the point at range L is ``L * direction + origin``.
    """
    theta = phi - alpha
    sine, cosine = np.sin(theta), np.cos(theta)
    flat = np.cos(v)
    direction = np.stack([flat * sine, flat * cosine, np.sin(v)], axis=-1)
    origin = np.stack([-hoff * cosine, hoff * sine, voff], axis=-1)
    return direction, origin


def laser_beams(
    phi: Array, laser_id: NDArray[np.integer], parameters: LaserParameters
) -> tuple[Array, Array]:
    """Direction and origin of the beams of lasers `laser_id` at rotational angles `phi`."""
    return beams(
        phi,
        parameters.alpha[laser_id],
        parameters.v[laser_id],
        parameters.voff[laser_id],
        parameters.hoff[laser_id],
    )


def points(
    distance_m: Array, phi: Array, laser_id: NDArray[np.integer], parameters: LaserParameters
) -> Array:
    """Points of returns in the scanner frame, metres, shape (n, 3); equations (1) and (2)."""
    direction, origin = laser_beams(phi, laser_id, parameters)
    length = distance_m + parameters.dl[laser_id]
    return np.asarray(length[:, None] * direction + origin)


def distance_from_ticks(ticks: NDArray[np.generic], tick_m: float) -> Array:
    """Metres of raw distances; `tick_m` is that of the scanner."""
    return ticks.astype(np.float64) * tick_m


def angle_from_ticks(
    ticks: NDArray[np.generic],
    laser_id: NDArray[np.integer],
    scanner: Scanner,
    rotation_rate_rad_s: float,
) -> Array:
    """Rotational angle of returns in radians, at the instant at which their laser fired.

    The raw azimuth belongs to the start of the firing; until a laser fires, the head has
    rotated further by the rate times its delay (`Scanner.azimuth_delay_s`).
    """
    start = np.deg2rad(ticks.astype(np.float64) * AZIMUTH_TICK_DEG)
    return np.asarray(start + rotation_rate_rad_s * scanner.azimuth_delay_s[laser_id])
