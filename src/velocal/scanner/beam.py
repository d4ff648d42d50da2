"""Scanner model: raw range, rotational angle and parameters to points (equations 1-3).

All functions work on arrays of one element per return; parameters are those of its laser.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.scanner.models import AZIMUTH_TICK_DEG, Scanner
from velocal.scanner.parameters import LaserParameters


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
    return _beams(phi - alpha, np.cos(v), np.sin(v), voff, hoff)


def _beams(
    theta: Array, flat: Array, steep: Array, voff: Array, hoff: Array
) -> tuple[Array, Array]:
    """Direction and origin, with cosine and sine of the vertical angles."""
    sine, cosine = np.sin(theta), np.cos(theta)
    direction = np.empty((*sine.shape, 3))
    direction[..., 0], direction[..., 1], direction[..., 2] = flat * sine, flat * cosine, steep
    origin = np.empty_like(direction)
    origin[..., 0], origin[..., 1], origin[..., 2] = -hoff * cosine, hoff * sine, voff
    return direction, origin


def laser_beams(
    phi: Array, laser_id: int | NDArray[np.integer], parameters: LaserParameters
) -> tuple[Array, Array]:
    """Unit direction and origin of the beams of lasers; equation (3).

    Parameters
    ----------
    phi : ndarray, shape (n,)
        Rotational angle, radians.
    laser_id : int or ndarray of int, shape (n,)
    parameters : LaserParameters

    Returns
    -------
    direction, origin : ndarray, shape (n, 3)
        As `beams` gives them.
    """
    # Every laser has one vertical angle: its cosine and sine are needed once.
    return _beams(
        phi - parameters.alpha[laser_id],
        np.cos(parameters.v)[laser_id],
        np.sin(parameters.v)[laser_id],
        parameters.voff[laser_id],
        parameters.hoff[laser_id],
    )


def points(
    distance_m: Array, phi: Array, laser_id: NDArray[np.integer], parameters: LaserParameters
) -> Array:
    """Points of returns; equations (1) and (2).

    Parameters
    ----------
    distance_m, phi : ndarray, shape (n,)
        Raw distance, metres, and rotational angle, radians.
    laser_id : ndarray of int, shape (n,)
    parameters : LaserParameters

    Returns
    -------
    ndarray, shape (n, 3)
        Scanner frame, metres.
    """
    direction, origin = laser_beams(phi, laser_id, parameters)
    length = distance_m + parameters.dl[laser_id]
    return np.asarray(length[:, None] * direction + origin)


def distance_from_ticks(ticks: NDArray[np.generic], tick_m: float) -> Array:
    """Convert raw distances.

    Parameters
    ----------
    ticks : ndarray
        Raw distances, of any shape.
    tick_m : float
        One tick of the scanner (`Scanner.distance_tick_m`), metres.

    Returns
    -------
    ndarray
        Metres, of the same shape.
    """
    return ticks.astype(np.float64) * tick_m


def angle_from_ticks(
    ticks: NDArray[np.generic],
    laser_id: NDArray[np.integer],
    scanner: Scanner,
    rotation_rate_rad_s: float,
) -> Array:
    """Rotational angle of returns at the instant at which their laser fired.

    The raw azimuth belongs to the start of the firing; until a laser fires, the head has
    rotated further by the rate times its delay (`Scanner.azimuth_delay_s`).

    Parameters
    ----------
    ticks : ndarray, shape (n,)
        Raw azimuths of the firings, 0.01 degree.
    laser_id : ndarray of int, shape (n,)
    scanner : Scanner
    rotation_rate_rad_s : float
        Radians per second.

    Returns
    -------
    ndarray, shape (n,)
        Radians.
    """
    start = np.deg2rad(ticks.astype(np.float64) * AZIMUTH_TICK_DEG)
    return np.asarray(start + rotation_rate_rad_s * scanner.azimuth_delay_s[laser_id])


@dataclass(frozen=True)
class Beams:
    """Returns, or medians of them, after they have left raw ticks behind.

    Attributes
    ----------
    distance_m : ndarray, shape (n,)
        Raw distance, before any correction, metres.
    phi : ndarray, shape (n,)
        Rotational angle at which the laser fired, radians.
    laser_id : ndarray of int, shape (n,)
    tick_m : float
        One tick of the raw distance, metres: no distance is finer than that.
    """

    distance_m: Array
    phi: Array
    laser_id: NDArray[np.integer]
    tick_m: float

    @classmethod
    def from_ticks(
        cls, columns: Mapping[str, NDArray[Any]], scanner: Scanner, rotation_rate_hz: float
    ) -> Beams:
        """Convert rows of a recording.

        Parameters
        ----------
        columns : mapping of str to ndarray, shape (n,)
            ``laser_id``, ``azimuth`` (0.01 degree) and ``distance`` (ticks) of returns that are
            not empty, or of medians.
        scanner : Scanner
        rotation_rate_hz : float
            Decides the angle at which the later lasers of a firing fired.

        Returns
        -------
        Beams
            In the order of the rows.
        """
        laser_id = columns["laser_id"]
        rate = 2.0 * np.pi * rotation_rate_hz
        return Beams(
            distance_from_ticks(columns["distance"], scanner.distance_tick_m),
            angle_from_ticks(columns["azimuth"], laser_id, scanner, rate),
            laser_id,
            scanner.distance_tick_m,
        )

    def __len__(self) -> int:
        return len(self.distance_m)

    def __getitem__(self, rows: NDArray[Any] | slice) -> Beams:
        """Some of the rows, chosen by number, mask or slice."""
        return Beams(self.distance_m[rows], self.phi[rows], self.laser_id[rows], self.tick_m)

    def points(self, parameters: LaserParameters) -> Array:
        """Points that a calibration gives.

        Parameters
        ----------
        parameters : LaserParameters

        Returns
        -------
        ndarray, shape (n, 3)
            Scanner frame, metres.
        """
        return points(self.distance_m, self.phi, self.laser_id, parameters)
