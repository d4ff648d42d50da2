"""Lasers and planes adjusted together, as with a test field that nobody surveyed.

After Glennie and Lichti (2010): every plane is unknown, and all lasers that hit it share it. The
planes that are handed in only start the iteration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import ADJUSTABLE
from velocal.adjustment.lasers import Observations, split
from velocal.adjustment.stochastic import Stochastic
from velocal.errors import VelocalError
from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import LaserParameters

Array = NDArray[np.float64]

#: Corrections whose mean over the observed lasers is kept at zero: the datum. A common alpha is a
#: turn of all planes, a common range scale their size.
DATUM = ("alpha", "scale")
#: Unknowns of a plane: two of the direction of its normal (rad) and the offset (m), and units in
#: which they are so large that no plane is ever held.
_PLANE, _PLANE_UNIT = 3, 1.0
#: Weight of a datum condition: its sum in units of the prior, to this standard deviation.
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
    """Planes as they start, and what their unknowns do to them."""

    group: NDArray[np.int64]
    normal: Array
    tangent: Array
    offset: Array

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
    """Normal equations A' M A and A' M w, misclosures w, and the diagonal of M."""

    matrix: Array
    right: Array
    w: Array
    weight: Array


def adjust_joint(
    observations: Observations,
    group: NDArray[np.integer],
    initial: LaserParameters,
    names: Sequence[str],
    stochastic: Stochastic,
    *,
    truncate_at: float = 1.0,
    max_iterations: int = 30,
    tolerance: float = 1e-6,
) -> JointAdjustment:
    """Adjust all lasers together with the planes that they hit.

    A Gauss-Helmert adjustment, ``min sum (s / sigma)^2`` over the parameters of all lasers and
    three unknowns per plane, by normal equations of all of them. What neither data nor datum
    determine (posterior standard deviation above `truncate_at` prior ones) is held.

    Parameters
    ----------
    observations : Observations
        Their planes are where the planes start.
    group : ndarray of int, shape (n,)
        Plane of every observation, 0, 1, ... over all stations: stations of one set-up share
        their planes, others do not, because their poses are unknown as well.
    initial : LaserParameters
    names : sequence of str
        Parameters to adjust, out of `functional.ADJUSTABLE`.
    stochastic : Stochastic
        Weights; its prior only decides what is held, and forms the datum.
    truncate_at : float
    max_iterations : int
        Largest number of linearisations.
    tolerance : float
        The iteration ends when no unknown changes by more, in units of its prior.

    Raises
    ------
    VelocalError
        If there are no observations.
    """
    if not len(observations.phi):
        raise VelocalError("no observations to adjust lasers and planes on", where="adjustment")
    lasers, u = len(initial), len(names)
    groups = int(group.max()) + 1
    first = np.unique(group, return_index=True)[1]
    normal = observations.normal[first]
    # Two directions across each normal: the axes that it is least along.
    axes = np.eye(3)[np.argsort(np.abs(normal), axis=1)[:, :2]]
    tangent = axes - np.einsum("gki,gi->gk", axes, normal)[:, :, None] * normal[:, None, :]
    planes = _Planes(group.astype(np.int64), normal, tangent, observations.offset[first])
    prior = np.array([stochastic.prior_std[name] for name in names])
    unit = np.concatenate([np.tile(prior, lasers), np.full(groups * _PLANE, _PLANE_UNIT)])
    datum = np.zeros((len(unit), sum(name in DATUM for name in names)))
    seen = np.bincount(observations.laser_id, minlength=lasers) > 0
    free = np.concatenate([np.repeat(seen, u), np.ones(groups * _PLANE, dtype=bool)])
    for column, name in enumerate(name for name in names if name in DATUM):
        datum[list(names).index(name) : lasers * u : u, column] = seen / _DATUM_STD

    def linearised(x: Array) -> _Linearised:
        """Linearise in units of the prior, with the datum as further observations."""
        there = _normal_equations(observations, planes, x * unit, initial, names, stochastic)
        condition = datum.T @ x
        return _Linearised(
            there.matrix * np.outer(unit, unit) + datum @ datum.T,
            there.right * unit + datum @ condition,
            np.concatenate([there.w, condition]),
            np.concatenate([there.weight, np.ones_like(condition)]),
        )

    x, basis, converged, iterations = np.zeros(len(unit)), None, False, 0
    here = linearised(x)
    while not converged and iterations < max_iterations:
        iterations += 1
        if basis is None:
            values, vectors = np.linalg.eigh(here.matrix[np.ix_(free, free)])
            basis = np.zeros((len(unit), len(values)))
            basis[free] = vectors
            basis = basis[:, values > 1.0 / truncate_at**2]
        delta = -basis @ np.linalg.solve(basis.T @ here.matrix @ basis, basis.T @ here.right)
        before = float(here.weight @ here.w**2)
        for half in range(12):
            trial = x + delta * 0.5**half
            there = linearised(trial)
            # Weights are those of the linearisation, or another sum would be compared.
            after = float(here.weight @ there.w**2)
            if after <= before * (1.0 + 1e-12) or np.max(np.abs(delta)) < tolerance:
                break
        x, here = trial, there
        converged = bool(np.max(np.abs(delta)) < tolerance)
    assert basis is not None
    solution = x * unit
    adjusted = planes.at(solution[lasers * u :].reshape(groups, _PLANE))
    return JointAdjustment(
        corrections=solution[: lasers * u].reshape(lasers, u),
        normal=adjusted[0],
        offset=adjusted[1],
        unknowns=len(unit),
        rank=basis.shape[1],
        iterations=iterations,
        converged=converged,
    )


def _normal_equations(
    data: Observations,
    planes: _Planes,
    unknowns: Array,
    initial: LaserParameters,
    names: Sequence[str],
    stochastic: Stochastic,
) -> _Linearised:
    """Normal equations with M the inverse variances of the misclosures."""
    lasers, u = len(initial), len(names)
    x = unknowns[: lasers * u].reshape(lasers, u)
    normal, offset, slope = planes.at(unknowns[lasers * u :].reshape(-1, _PLANE))
    group, laser = planes.group, data.laser_id.astype(np.int64)
    here = Observations(
        data.distance_m, data.phi, data.laser_id, normal[group], offset[group]
    )  # fmt: skip
    parameters, scale = split(x, names, initial)
    s, design = here.design(parameters, scale)
    direction, origin = laser_beams(data.phi, data.laser_id, parameters)
    raw = data.distance_m if scale is None else data.distance_m * (1 + scale[laser])
    towards = np.einsum("ni,ni->n", direction, here.normal)
    # Where the beam meets the plane; ds/dn = that point / G, ds/d(offset) = 1 / G.
    foot = origin + (raw + parameters.dl[laser] - s)[:, None] * direction
    across = np.einsum("nki,ni->nk", slope[group], foot)
    own = design[:, [ADJUSTABLE.index(name) for name in names]]
    rows = np.column_stack([own, across / towards[:, None], 1.0 / towards])
    weight = 1.0 / stochastic.row_std(design[:, ADJUSTABLE.index("alpha")]) ** 2
    # Every row has the unknowns of one laser and one plane: sums by pair of both, then spread.
    pair = laser * len(offset) + group
    pairs, pair = np.unique(pair, return_inverse=True)
    place = np.hstack(
        [
            (pairs // len(offset))[:, None] * u + np.arange(u),
            lasers * u + (pairs % len(offset))[:, None] * _PLANE + np.arange(_PLANE),
        ]
    )
    matrix, right = np.zeros((len(unknowns), len(unknowns))), np.zeros(len(unknowns))
    for i in range(u + _PLANE):
        weighted = weight * rows[:, i]
        np.add.at(right, place[:, i], np.bincount(pair, weighted * s, minlength=len(pairs)))
        for j in range(i + 1):
            sums = np.bincount(pair, weighted * rows[:, j], minlength=len(pairs))
            np.add.at(matrix, (place[:, i], place[:, j]), sums)
            if i != j:
                np.add.at(matrix, (place[:, j], place[:, i]), sums)
    return _Linearised(matrix, right, s, weight)
