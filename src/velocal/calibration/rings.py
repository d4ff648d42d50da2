"""Which laser a point is of, where a cloud does not say, and the geometry of the lasers from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.scanner.parameters import LaserParameters

#: A new ring begins where the azimuth goes back by more than this, radians, and where the ring has
#: as many points: offsets of the lasers let single points lie on either side of its begin.
_BACK_RAD, _LEAST_POINTS = np.deg2rad(5.0), 20
#: Horizontal distances of the points of a laser that determine both its angle and its offset differ
#: by this much, metres.
_SPREAD_M = 3.0
#: Points that are compared with all lasers together.
_POINTS = 1 << 16


def orders(v: Array) -> dict[str, NDArray[np.int64]]:
    """Ways in which programs number lasers: `laser_id` of every number.

    Parameters
    ----------
    v : ndarray, shape (n,)
        Vertical angles.

    Returns
    -------
    dict of str to ndarray of int64, shape (n,)
        As on the wire (VeloView, velocal), from the lowest up (the ring of the ROS driver and of
        velodyne_decoder), and from the highest down.
    """
    upward = np.argsort(v, kind="stable")
    return {
        "in the order of the wire": np.arange(len(v)),
        "from the lowest up": upward,
        "from the highest down": upward[::-1],
    }


def rings_by_turns(xyz: Array) -> NDArray[np.int64]:
    """Rings of a cloud that is stored one ring after the other, as those of KITTI are.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        In the order of the file.

    Returns
    -------
    ndarray of int64, shape (n,)
        Number of the turn that a point belongs to: a new one begins where the azimuth goes back. A
        few points at its begin may be given to the ring before it.
    """
    forward, left = xyz[:, 1], -xyz[:, 0]
    azimuth = np.arctan2(left, forward)
    if np.median(np.mod(np.diff(azimuth) + np.pi, 2.0 * np.pi)) < np.pi:
        azimuth = -azimuth  # rings are stored clockwise
    azimuth = np.mod(azimuth, 2.0 * np.pi)
    found: list[int] = []
    last = len(xyz) - _LEAST_POINTS
    for place in np.flatnonzero(np.diff(azimuth) < -_BACK_RAD) + 1:
        if place - (found[-1] if found else 0) >= _LEAST_POINTS and place <= last:
            found.append(int(place))
    return np.searchsorted(np.array(found, np.int64), np.arange(len(xyz)), side="right")


def nearest_lasers(xyz: Array, parameters: LaserParameters) -> NDArray[np.int64]:
    """Laser whose cone passes nearest to every point.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        Scanner frame.
    parameters : LaserParameters
        Their vertical angles and offsets must be right by half of the step between two lasers.

    Returns
    -------
    ndarray of int64, shape (n,)
    """
    reach = np.hypot(xyz[:, 0], xyz[:, 1])
    found = np.empty(len(xyz), np.int64)
    flat, steep = np.cos(parameters.v), np.sin(parameters.v)
    for begin in range(0, len(xyz), _POINTS):
        part = slice(begin, begin + _POINTS)
        above = (xyz[part, 2, None] - parameters.voff) * flat - reach[part, None] * steep
        found[part] = np.abs(above).argmin(axis=1)
    return found


def lasers_of_rings(
    ring: NDArray[np.int64], xyz: Array, parameters: LaserParameters
) -> NDArray[np.int64] | None:
    """Laser of every point out of its ring, by the order of the elevations.

    Parameters
    ----------
    ring : ndarray of int64, shape (n,)
        See `rings_by_turns`.
    xyz : ndarray, shape (n, 3)
    parameters : LaserParameters
        Only the order of their vertical angles is used.

    Returns
    -------
    ndarray of int64, shape (n,), or None
        None if there are not as many rings as lasers.
    """
    numbers = np.unique(ring)
    if len(numbers) != len(parameters):
        return None
    elevation = np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1]))
    median = np.array([np.median(elevation[ring == number]) for number in numbers])
    laser = np.empty(len(numbers), np.int64)
    laser[np.argsort(median)] = np.argsort(parameters.v, kind="stable")
    return laser[np.searchsorted(numbers, ring)]


def lasers_of_numbers(
    number: NDArray[np.int64], xyz: Array, parameters: LaserParameters
) -> NDArray[np.int64]:
    """Laser of every point out of the number that a file gives it; see `orders`.

    Parameters
    ----------
    number : ndarray of int64, shape (n,)
    xyz : ndarray, shape (n, 3)
    parameters : LaserParameters
        Their vertical angles decide which of the orders fits best.

    Returns
    -------
    ndarray of int64, shape (n,)
    """
    elevation = np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1]))
    ways = [laser_of[number] for laser_of in orders(parameters.v).values()]
    return min(ways, key=lambda laser: float(np.median(np.abs(elevation - parameters.v[laser]))))


def geometry_of(
    xyz: Array, laser_id: NDArray[np.integer], parameters: LaserParameters
) -> LaserParameters:
    """Vertical angles and offsets with which the points of every laser were computed.

    The points of a laser lie on a cone, ``Z = R tan v + voff`` with the horizontal distance R,
    whatever was measured: only v and voff decide. Everything else is zero in the result, as a
    cloud does not tell it: distance and azimuth are those of the points themselves.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        Scanner frame.
    laser_id : ndarray of int, shape (n,)
    parameters : LaserParameters
        Offsets relative to each other for lasers whose points are at one distance only, such as
        those that see nothing but the road; values for lasers without points.

    Returns
    -------
    LaserParameters
        Of equations (1) to (3).
    """
    v, voff = parameters.v.copy(), parameters.voff.copy()
    reach, lasers = np.hypot(xyz[:, 0], xyz[:, 1]), range(len(parameters))
    rows = [np.flatnonzero(laser_id == laser) for laser in lasers]
    known = [k for k in lasers if len(rows[k]) >= 10 and np.ptp(reach[rows[k]]) >= _SPREAD_M]
    for laser in known:
        slope, voff[laser] = _line(reach[rows[laser]], xyz[rows[laser], 2])
        v[laser] = np.arctan(slope)
    # Where the origin of the cloud is, the lasers have in common: so it is for the others too.
    raised = np.median((voff - parameters.voff)[known]) if known else 0.0
    for laser in (k for k in lasers if k not in known):
        voff[laser] += raised
        if len(rows[laser]):
            up = xyz[rows[laser], 2] - voff[laser]
            v[laser] = np.median(np.arctan2(up, reach[rows[laser]]))
    zero = np.zeros(len(parameters))
    return LaserParameters(dl=zero, alpha=zero.copy(), v=v, voff=voff, hoff=zero.copy())


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and intercept of a line that a few points do not lie on."""
    weight = np.ones(len(x))
    for _ in range(10):
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        spread = np.average((x - mean_x) ** 2, weights=weight)
        slope = np.average((x - mean_x) * (y - mean_y), weights=weight) / spread
        residual = np.abs(y - mean_y - slope * (x - mean_x))
        # Weights of the sum of absolute values, bounded at the rounding of files.
        weight = 1.0 / np.maximum(residual, 1e-3)
    return float(slope), float(mean_y - slope * mean_x)
