"""Functional model of a network: its observations, its unknowns, and the equations between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from velocal.arrays import Array
from velocal.geometry.rigid import rotation_from_vector, skew


@dataclass(frozen=True)
class SetupObservations:
    """Observations from set-ups to targets, one row per set-up and target.

    Attributes
    ----------
    setup, target : tuple of str
        Names of the set-up (of an instrument or of a camera) and of the target.
    value, std : ndarray, shape (n, k)
        Observed values and their standard deviations; NaN where a value was not observed.
    """

    #: Names of the k observations of a row, in the order of the columns of `value`.
    KINDS: ClassVar[tuple[str, ...]]

    setup: tuple[str, ...]
    target: tuple[str, ...]
    value: Array
    std: Array

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """All rows of some parts, one part after the other; without parts it has no rows."""
        none = np.zeros((0, len(cls.KINDS)))
        return cls(
            tuple(name for part in parts for name in part.setup),
            tuple(name for part in parts for name in part.target),
            np.concatenate([none, *(part.value for part in parts)]),
            np.concatenate([none, *(part.std for part in parts)]),
        )

    def label(self, number: int) -> str:
        """Name of an observed value by its number; values that were not observed do not count."""
        rows, kinds = np.nonzero(np.isfinite(self.value))
        row = rows[number]
        return f"{self.KINDS[kinds[number]]} {self.setup[row]}-{self.target[row]}"


class PolarObservations(SetupObservations):
    """Observations of levelled total stations: direction, zenith angle, slope distance.

    The angles are in radians and the distance is in metres.
    """

    KINDS = ("direction", "zenith angle", "distance")


class ImageObservations(SetupObservations):
    """Image coordinates x and y of calibrated cameras, over the principal distance."""

    KINDS = ("image x", "image y")


@dataclass(frozen=True)
class ControlPoints:
    """Control points: they define the datum, and may be known already.

    Attributes
    ----------
    name : tuple of str
    xyz : ndarray, shape (n, 3)
        Metres; approximate if there is no covariance.
    covariance : ndarray, shape (3n, 3n), or None
        Of an earlier adjustment in the same datum, square metres; None for a free network.
    """

    name: tuple[str, ...]
    xyz: Array
    covariance: Array | None = None


@dataclass(frozen=True)
class Unknowns:
    """Unknowns of a network, in the order of the columns of the design matrix.

    Attributes
    ----------
    points : ndarray, shape (p, 3)
        Metres.
    instruments : ndarray, shape (s, 4)
        Places of the total stations (metres), and the azimuths of their direction zero (radians).
    cameras : ndarray, shape (c, 3)
        Projection centres, metres.
    rotations : ndarray, shape (c, 3, 3)
        From the site frame into the camera frames, whose third axes look forward.
    """

    points: Array
    instruments: Array
    cameras: Array
    rotations: Array

    def moved(self, step: Array) -> Unknowns:
        """Unknowns after a correction.

        Parameters
        ----------
        step : ndarray, shape (3 p + 4 s + 6 c,)
            Corrections of points and instruments, then per camera of its place and its rotation
            vector, which acts from the left.
        """
        p, s = self.points.size, self.instruments.size
        cameras = step[p + s :].reshape(-1, 6)
        turns = [rotation_from_vector(vector) for vector in cameras[:, 3:]]
        return Unknowns(
            self.points + step[:p].reshape(-1, 3),
            self.instruments + step[p : p + s].reshape(-1, 4),
            self.cameras + cameras[:, :3],
            np.array(turns).reshape(-1, 3, 3) @ self.rotations,
        )


def polar_equations(points: Array, instruments: Array) -> tuple[Array, Array, Array]:
    """Direction, zenith angle and slope distance to points, and their derivatives.

    Directions run clockwise from the Y axis of the site, less the azimuth of the instrument's
    direction zero.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    instruments : ndarray, shape (n, 4)
        Of every row; see `Unknowns`.

    Returns
    -------
    computed : ndarray, shape (n, 3)
    by_point : ndarray, shape (n, 3, 3)
    by_instrument : ndarray, shape (n, 3, 4)
    """
    d = points - instruments[:, :3]
    flat2 = d[:, 0] ** 2 + d[:, 1] ** 2
    flat, length = np.sqrt(flat2), np.sqrt(flat2 + d[:, 2] ** 2)
    azimuth = np.arctan2(d[:, 0], d[:, 1])
    computed = np.column_stack([azimuth - instruments[:, 3], np.arctan2(flat, d[:, 2]), length])
    by_direction = np.column_stack([d[:, 1], -d[:, 0], np.zeros(len(d))]) / flat2[:, None]
    by_zenith = np.column_stack([d[:, 0] * d[:, 2], d[:, 1] * d[:, 2], -flat2])
    by_zenith /= (flat * length**2)[:, None]
    by_point = np.stack([by_direction, by_zenith, d / length[:, None]], axis=1)
    by_zero = np.zeros((len(d), 3, 1))
    by_zero[:, 0] = -1.0
    return computed, by_point, np.concatenate([-by_point, by_zero], axis=2)


def image_equations(points: Array, cameras: Array, rotations: Array) -> tuple[Array, Array, Array]:
    """Image coordinates over the principal distance (collinearity), and their derivatives.

    Parameters
    ----------
    points, cameras : ndarray, shape (n, 3)
    rotations : ndarray, shape (n, 3, 3)

    Returns
    -------
    computed : ndarray, shape (n, 2)
    by_point : ndarray, shape (n, 2, 3)
    by_camera : ndarray, shape (n, 2, 6)
        By the place, and by a turn of the rotation from the left.
    """
    p = np.einsum("nij,nj->ni", rotations, points - cameras)
    projected = np.zeros((len(p), 2, 3))
    projected[:, 0, 0] = projected[:, 1, 1] = 1.0 / p[:, 2]
    projected[:, :, 2] = -p[:, :2] / p[:, 2:] ** 2
    by_point = projected @ rotations
    turned = -np.array([skew(point) for point in p]).reshape(-1, 3, 3)
    by_camera = np.concatenate([-by_point, projected @ turned], axis=2)
    return p[:, :2] / p[:, 2:], by_point, by_camera
