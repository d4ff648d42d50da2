"""Lasers and planes adjusted together, as with a test field that nobody surveyed.

After Glennie and Lichti (2010): every plane is unknown, and all lasers that hit it share it. The
planes of the observations are only the start of the iteration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.core import gauss_newton
from velocal.adjustment.functional import ADJUSTABLE, scaled, split
from velocal.adjustment.observations import Observations
from velocal.adjustment.stochastic import Stochastic
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import LaserParameters

#: The datum: corrections whose mean over the observed lasers is kept at zero, because a common
#: alpha cannot be told from a rotation of all planes, nor a common range scale from their size.
DATUM = ("alpha", "scale")
#: Unknowns of a plane: two of the direction of its normal (rad) and the offset (m), and units in
#: which any data determine them.
_PLANE, _PLANE_UNIT = 3, 1.0
#: A combination of unknowns stays at its initial value where its posterior standard deviation
#: exceeds this many prior ones.
TRUNCATE_AT = 1.0
#: Largest number of linearisations. They end before, when no unknown changes by more than the
#: tolerance times its prior standard deviation (or itself, if that is larger).
MAX_ITERATIONS, TOLERANCE = 30, 1e-6
#: Standard deviation of a datum condition: of the sum of a correction in units of its prior.
_DATUM_STD = 1e-6


@dataclass(frozen=True)
class JointAdjustment:
    """Lasers and planes from one adjustment.

    Attributes
    ----------
    corrections : ndarray, shape (lasers, u)
        To be added to the initial parameters; zero for a laser without observations.
    normal : ndarray, shape (groups, 3)
        Unit normals of the adjusted planes, by group.
    offset : ndarray, shape (groups,)
        Their offsets, metres.
    unknowns, rank : int
        Number of unknowns, and of combinations of them that the data and the datum determine.
    iterations : int
    converged : bool
    """

    corrections: Array
    normal: Array
    offset: Array
    unknowns: int
    rank: int
    iterations: int
    converged: bool


@dataclass(frozen=True)
class _Planes:
    """Planes at the start, and how their unknowns change them.

    Attributes
    ----------
    group : ndarray of int, shape (n,)
        Plane of every observation.
    normal : ndarray, shape (groups, 3)
        Unit normals at the start.
    tangent : ndarray, shape (groups, 2, 3)
        Two directions across each normal, in which it can turn.
    offset : ndarray, shape (groups,)
        Offsets at the start, metres.
    """

    group: NDArray[np.int64]
    normal: Array
    tangent: Array
    offset: Array

    @classmethod
    def at_start(cls, observations: Observations, group: NDArray[np.integer]) -> _Planes:
        """Planes that the observations come with."""
        first = np.unique(group, return_index=True)[1]
        normal = observations.normal[first]
        # The coordinate axes that are nearest to the plane, projected into it.
        axes = np.eye(3)[np.argsort(np.abs(normal), axis=1)[:, :2]]
        along = np.einsum("gki,gi->gk", axes, normal)
        tangent = axes - along[:, :, None] * normal[:, None, :]
        return cls(group.astype(np.int64), normal, tangent, observations.offset[first])

    def at(self, y: Array) -> tuple[Array, Array, Array]:
        """Normals, offsets, and derivatives (groups, 2, 3) of the normals at the unknowns."""
        raw = self.normal + np.einsum("gk,gki->gi", y[:, :2], self.tangent)
        length = np.linalg.norm(raw, axis=1)
        normal = raw / length[:, None]
        along = np.einsum("gki,gi->gk", self.tangent, normal)
        slope = (self.tangent - along[:, :, None] * normal[:, None, :]) / length[:, None, None]
        return normal, self.offset + y[:, 2], slope


@dataclass(frozen=True)
class _Linearised:
    """A linearisation of all unknowns, A the design matrix and M the weights.

    Attributes
    ----------
    matrix : ndarray, shape (unknowns, unknowns)
        Normal equations A' M A.
    right : ndarray, shape (unknowns,)
        A' M w.
    w : ndarray, shape (n,)
        Misclosures.
    weight : ndarray, shape (n,)
        Diagonal of M.
    """

    matrix: Array
    right: Array
    w: Array
    weight: Array


class JointProblem:
    """All lasers and planes as the one block of an adjustment; see `core.Problem`.

    Unknowns are the parameters of all lasers, laser by laser, then those of all planes; they are
    in units of their prior standard deviations.

    Parameters
    ----------
    observations, group, initial, names, stochastic
        As for `adjust_joint`.
    """

    def __init__(
        self,
        observations: Observations,
        group: NDArray[np.integer],
        initial: LaserParameters,
        names: Sequence[str],
        stochastic: Stochastic,
    ) -> None:
        self.data, self.initial, self.names = observations, initial, tuple(names)
        self.stochastic = stochastic
        self.planes = _Planes.at_start(observations, group)
        lasers, u, planes = len(initial), len(names), len(self.planes.offset)
        prior = stochastic.prior_of(names)
        self.unit = np.concatenate([np.tile(prior, lasers), np.full(planes * _PLANE, _PLANE_UNIT)])
        seen = np.bincount(observations.laser_id, minlength=lasers) > 0
        #: Unknowns of which there are observations.
        self.observed = np.concatenate([np.repeat(seen, u), np.ones(planes * _PLANE, dtype=bool)])
        fixed = [column for column, name in enumerate(names) if name in DATUM]
        self.datum = np.zeros((len(self.unit), len(fixed)))
        for number, column in enumerate(fixed):
            self.datum[column : lasers * u : u, number] = seen / _DATUM_STD
        # A row depends on one laser and one plane; this is the number of the pair of each row.
        pair = observations.laser_id.astype(np.int64) * planes + self.planes.group
        pairs, self.pair = np.unique(pair, return_inverse=True)
        #: Unknowns of every pair: those of the laser, then those of the plane.
        self.place = np.hstack(
            [
                (pairs // planes)[:, None] * u + np.arange(u),
                lasers * u + (pairs % planes)[:, None] * _PLANE + np.arange(_PLANE),
            ]
        )
        self._basis: Array | None = None

    @property
    def rank(self) -> int:
        """Number of combinations of the unknowns that data and datum determine."""
        assert self._basis is not None
        return int(self._basis.shape[1])

    def split(self, x: Array) -> tuple[Array, Array]:
        """Corrections of the lasers (lasers, u) and changes of the planes (groups, 3)."""
        ends = len(self.initial) * len(self.names)
        physical = x * self.unit
        return physical[:ends].reshape(-1, len(self.names)), physical[ends:].reshape(-1, _PLANE)

    def at(self, block: int, x: Array) -> _Linearised:
        """Linearise in units of the prior, with the datum as further observations."""
        there = self._normal_equations(*self.split(x))
        condition = self.datum.T @ x
        return _Linearised(
            there.matrix * np.outer(self.unit, self.unit) + self.datum @ self.datum.T,
            there.right * self.unit + self.datum @ condition,
            np.concatenate([there.w, condition]),
            np.concatenate([there.weight, np.ones_like(condition)]),
        )

    def _normal_equations(self, x: Array, y: Array) -> _Linearised:
        """Normal equations with M the inverse variances of the misclosures."""
        data, group, u = self.data, self.planes.group, len(self.names)
        normal, offset, slope = self.planes.at(y)
        here = Observations(data.distance_m, data.phi, data.laser_id, normal[group], offset[group])
        parameters, scale = split(x, self.names, self.initial)
        s, design = here.design(parameters, scale)
        direction, origin = laser_beams(data.phi, data.laser_id, parameters)
        towards = np.einsum("ni,ni->n", direction, here.normal)
        # The foot is where the beam meets the plane: ds/dn = foot / G, ds/d(offset) = 1 / G.
        length = scaled(data.distance_m, data.laser_id, scale) + parameters.dl[data.laser_id] - s
        foot = origin + length[:, None] * direction
        across = np.einsum("nki,ni->nk", slope[group], foot)
        own = design.T[[ADJUSTABLE.index(name) for name in self.names]]
        columns = np.vstack([own, across.T / towards, 1.0 / towards])
        weight = 1.0 / self.stochastic.sigma_misclosure(design[:, ADJUSTABLE.index("alpha")]) ** 2
        # Sum the rows of every pair first, then add the sums to the elements of the matrix.
        size, place, pairs = len(self.unit), self.place, len(self.place)
        matrix, right = np.zeros((size, size)), np.zeros(size)
        for i in range(u + _PLANE):
            weighted = weight * columns[i]
            np.add.at(right, place[:, i], np.bincount(self.pair, weighted * s, minlength=pairs))
            for j in range(i + 1):
                sums = np.bincount(self.pair, weighted * columns[j], minlength=pairs)
                np.add.at(matrix, (place[:, i], place[:, j]), sums)
                if i != j:
                    np.add.at(matrix, (place[:, j], place[:, i]), sums)
        return _Linearised(matrix, right, s, weight)

    def corrections(self, blocks: Sequence[int], states: Sequence[_Linearised]) -> list[Array]:
        """Solve the normal equations in the space that the first of them determine."""
        (here,) = states
        if self._basis is None:
            values, vectors = np.linalg.eigh(here.matrix[np.ix_(self.observed, self.observed)])
            basis = np.zeros((len(self.unit), len(values)))
            basis[self.observed] = vectors
            self._basis = basis[:, values > 1.0 / TRUNCATE_AT**2]
        matrix = self._basis.T @ here.matrix @ self._basis
        return [-self._basis @ np.linalg.solve(matrix, self._basis.T @ here.right)]

    def objective(self, here: _Linearised, there: _Linearised) -> float:
        """Weighted sum of squared misclosures, with the weights of `here`."""
        return float(here.weight @ there.w**2)


def adjust_joint(
    observations: Observations,
    group: NDArray[np.integer],
    initial: LaserParameters,
    names: Sequence[str],
    stochastic: Stochastic,
) -> JointAdjustment:
    """Adjust all lasers together with the planes that they hit.

    A Gauss-Helmert adjustment, ``min sum (s / sigma)^2`` over the parameters of all lasers and
    three unknowns per plane, by normal equations of all of them. Combinations of the unknowns
    that neither data nor datum determine (posterior standard deviation above `TRUNCATE_AT` prior
    ones) stay at their initial values.

    Parameters
    ----------
    observations : Observations
        Their planes are where the planes start.
    group : ndarray of int, shape (n,)
        Plane of every observation, 0, 1, ... over all stations: stations of one set-up share
        their planes, others do not, because their poses are unknown as well.
    initial : LaserParameters
        Where the lasers start.
    names : sequence of str
        Parameters to adjust, out of `functional.ADJUSTABLE`.
    stochastic : Stochastic
        Weights. Its prior does not enter the sum of squares; it only decides on the rank, and
        gives the parameters of the datum their units.

    Returns
    -------
    JointAdjustment
        Lasers and planes.

    Raises
    ------
    VelocalError
        If there are no observations, or a parameter has no prior standard deviation.
    """
    if not len(observations.phi):
        raise VelocalError("no observations to adjust lasers and planes on", where="adjustment")
    problem = JointProblem(observations, group, initial, names, stochastic)
    n = len(problem.unit)
    block = gauss_newton(
        problem,
        np.zeros((1, n)),
        np.ones(n),
        max_iterations=MAX_ITERATIONS,
        tolerance=TOLERANCE,
    )[0]
    corrections, planes = problem.split(block.x)
    normal, offset, _ = problem.planes.at(planes)
    return JointAdjustment(
        corrections=corrections,
        normal=normal,
        offset=offset,
        unknowns=n,
        rank=problem.rank,
        iterations=block.iterations,
        converged=block.converged,
    )
