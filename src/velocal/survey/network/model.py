"""Parts of a network: observations, their equations, and the normal equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from velocal.errors import SurveyError
from velocal.geometry.rigid import rotation_from_vector, skew

Array = NDArray[np.float64]

#: Freedoms that levelled stations leave to the frame.
DEFECT = 4
#: Share of an unknown's own information that is left beside the others: 0 if it is undetermined.
LEAST_DETERMINED = 1e-11
#: Observations of a sight and of a ray, in the order of their columns.
KINDS = ("direction", "zenith angle", "distance"), ("image x", "image y")


@dataclass(frozen=True)
class Observed:
    """Observations from set-ups (stations or images) to targets.

    Attributes
    ----------
    setup, target : tuple of str
        Names, one per row.
    value, std : ndarray, shape (n, k)
        Of a total station direction, zenith angle (radians) and slope distance (metres), NaN
        where one was not observed; of an image x and y over the principal distance.
    """

    setup: tuple[str, ...] = ()
    target: tuple[str, ...] = ()
    value: Array = field(default_factory=lambda: np.zeros((0, 3)))
    std: Array = field(default_factory=lambda: np.zeros((0, 3)))


NO_RAYS = Observed(value=np.zeros((0, 2)), std=np.zeros((0, 2)))


@dataclass(frozen=True)
class Control:
    """Control points: they define the datum, and may be known already.

    Attributes
    ----------
    name : tuple of str
    xyz : ndarray, shape (n, 3)
        Metres; approximate if there is no covariance.
    covariance : ndarray, shape (3n, 3n), or None
        Of an earlier adjustment in the same datum; None for a free network.
    """

    name: tuple[str, ...]
    xyz: Array
    covariance: Array | None = None


@dataclass(frozen=True)
class Unknowns:
    """Unknowns of a network.

    Attributes
    ----------
    points : ndarray, shape (p, 3)
        Metres.
    stations : ndarray, shape (s, 4)
        Places of total stations, and the azimuths of their direction zero (radians).
    cameras : ndarray, shape (c, 3)
        Projection centres.
    rotations : ndarray, shape (c, 3, 3)
        From the field into the cameras, whose third axes look forward.
    """

    points: Array
    stations: Array
    cameras: Array
    rotations: Array

    def moved(self, step: Array) -> Unknowns:
        """Apply a correction: points, stations, and of cameras place and turn from the left."""
        p, s = self.points.size, self.stations.size
        cameras = step[p + s :].reshape(-1, 6)
        turns = [rotation_from_vector(vector) for vector in cameras[:, 3:]]
        return Unknowns(
            self.points + step[:p].reshape(-1, 3),
            self.stations + step[p : p + s].reshape(-1, 4),
            self.cameras + cameras[:, :3],
            np.array(turns).reshape(-1, 3, 3) @ self.rotations,
        )


def sight_equations(points: Array, stations: Array) -> tuple[Array, Array, Array]:
    """Direction, zenith angle and slope distance of sights, and their derivatives.

    Directions run clockwise from the field's Y axis, less the azimuth of the station's zero.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    stations : ndarray, shape (n, 4)

    Returns
    -------
    computed : ndarray, shape (n, 3)
    by_point : ndarray, shape (n, 3, 3)
    by_station : ndarray, shape (n, 3, 4)
    """
    d = points - stations[:, :3]
    flat2 = d[:, 0] ** 2 + d[:, 1] ** 2
    flat, length = np.sqrt(flat2), np.sqrt(flat2 + d[:, 2] ** 2)
    azimuth = np.arctan2(d[:, 0], d[:, 1])
    computed = np.column_stack([azimuth - stations[:, 3], np.arctan2(flat, d[:, 2]), length])
    by_direction = np.column_stack([d[:, 1], -d[:, 0], np.zeros(len(d))]) / flat2[:, None]
    by_zenith = np.column_stack([d[:, 0] * d[:, 2], d[:, 1] * d[:, 2], -flat2])
    by_zenith /= (flat * length**2)[:, None]
    by_point = np.stack([by_direction, by_zenith, d / length[:, None]], axis=1)
    by_zero = np.zeros((len(d), 3, 1))
    by_zero[:, 0] = -1.0
    return computed, by_point, np.concatenate([-by_point, by_zero], axis=2)


def ray_equations(points: Array, cameras: Array, rotations: Array) -> tuple[Array, Array, Array]:
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


class Bordered:
    """Normal equations bordered by the datum, in units that make their diagonal 1.

    Parameters
    ----------
    design : sparse array, shape (n, u)
        Rows divided by the standard deviations of the observations.
    weight : ndarray, shape (c, c)
        Weights of the first unknowns, observed themselves.
    border : ndarray, shape (u, DEFECT)
        Inner constraints; see `adjust_network`.
    where : str
        File, for errors.

    Raises
    ------
    SurveyError
        If the equations are singular.
    """

    def __init__(
        self, design: sparse.csr_array, weight: Array, border: Array, *, where: str
    ) -> None:
        self.design, self.weight, self.where = design, weight, where
        known = sparse.coo_array(weight)
        normal = design.T @ design + sparse.coo_array(
            (known.data, known.coords), shape=(design.shape[1],) * 2
        )
        own = normal.diagonal()
        self.scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
        unit = sparse.diags_array(self.scale)
        self.border = border / np.median(self.scale)
        side = unit @ sparse.csr_array(self.border)
        try:
            self.factors = splu(
                sparse.block_array([[unit @ normal @ unit, side], [side.T, None]], format="csc")
            )
        except RuntimeError:
            raise SurveyError(
                "the observations do not determine the network",
                where=where,
                hint="Add distances, or sights from another place.",
            ) from None

    def step(self, misclosure: Array, difference: Array) -> Array:
        """Corrections; the datum holds the control points where they are on average."""
        right = self.design.T @ misclosure
        right[: len(difference)] += self.weight @ difference
        datum = self.border[: len(difference)].T @ difference
        solved = self.factors.solve(np.concatenate([right * self.scale, datum]))
        return np.asarray(solved[: len(right)] * self.scale)

    def inverse(self) -> Array:
        """Cofactors of all unknowns."""
        n = len(self.scale)
        inverse = self.factors.solve(np.eye(n + DEFECT))[:n, :n]
        return np.asarray(inverse * self.scale[:, None] * self.scale)

    def check(self, names: Sequence[str]) -> None:
        """Check that every unknown is determined; `names` of the points, the first unknowns.

        Raises
        ------
        SurveyError
            If one is not.
        """
        freedom = np.diag(self.inverse()) / self.scale**2
        bad = np.flatnonzero(~((freedom > 0.0) & (freedom < 1.0 / LEAST_DETERMINED)))
        if len(bad):
            point = bad[0] // 3
            raise SurveyError(
                "the observations do not determine "
                + (f"point {names[point]!r}" if point < len(names) else "the place of a set-up"),
                where=self.where,
                hint="Add distances, or sights from another place.",
            )
