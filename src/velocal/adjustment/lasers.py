"""Adjustment of all lasers of a scanner, each on its own, at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment import nuisance, quality
from velocal.adjustment.core import Block, gauss_newton
from velocal.adjustment.functional import ADJUSTABLE, Towards
from velocal.adjustment.linear import Step, System
from velocal.adjustment.observations import Observations
from velocal.adjustment.result import Adjustment
from velocal.adjustment.solvers import Solver, solve
from velocal.adjustment.stochastic import Stochastic, block_numbers
from velocal.arrays import Array, rows_of
from velocal.scanner.beam import beams
from velocal.scanner.parameters import PARAMETERS, LaserParameters


@dataclass(frozen=True)
class LaserState:
    """One laser at some parameters.

    Attributes
    ----------
    w : ndarray, shape (n,)
        Misclosures.
    shift : ndarray, shape (u,)
        Current minus initial parameters.
    linearise : callable
        Makes the linearised system, which a step that is refused does not need.
    """

    w: Array
    shift: Array
    linearise: Callable[[], System]

    @cached_property
    def system(self) -> System:
        """The model linearised at these parameters."""
        return self.linearise()


class LaserProblem:
    """The lasers of a scanner as independent blocks of one adjustment; see `core.Problem`.

    The state of a block is a `LaserState`. The first linearisation decides on the space
    of the corrections of every block. It is fixed from then on; otherwise a direction at the limit
    could be left out and taken back in turn, and the iteration would not converge.

    Parameters
    ----------
    observations : Observations
        Of all lasers.
    initial : LaserParameters
        Where to start.
    names : sequence of str
        Parameters to adjust, out of `functional.ADJUSTABLE`.
    solver : Solver
        Method.
    stochastic : Stochastic
        A-priori knowledge.
    """

    def __init__(
        self,
        observations: Observations,
        initial: LaserParameters,
        names: Sequence[str],
        solver: Solver,
        stochastic: Stochastic,
    ) -> None:
        # The rows of a laser become a slice; within it, those of a station follow the angle.
        order = np.lexsort((observations.phi, observations.station_number, observations.laser_id))
        data = observations.take(order)
        self.data = replace(data, normal=np.asfortranarray(data.normal))
        self.names, self.solver, self.stochastic = tuple(names), solver, stochastic
        self.prior_std = stochastic.prior_of(names)
        sizes = np.bincount(data.laser_id, minlength=len(initial))
        self.observed = [int(laser) for laser in np.flatnonzero(sizes)]
        ends = np.cumsum(sizes)
        self.rows = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
        self._own = [self.data.take(rows) for rows in self.rows]
        self._turned = [(np.sin(own.phi), np.cos(own.phi)) for own in self._own]
        start = [getattr(initial, name) for name in PARAMETERS]
        self._start = np.column_stack([*start, np.zeros(len(initial))])
        self._columns = [ADJUSTABLE.index(name) for name in names]
        self._basis: dict[int, Array] = {}

    def at(self, block: int, x: Array) -> LaserState:
        """Misclosures of one laser at corrections `x`, shape (u,)."""
        dl, alpha, v, voff, hoff, scale = self._values(block, x)
        own, (sine, cosine) = self._own[block], self._turned[block]
        # Addition theorems: sines of all angles once, not in every iteration.
        sine_a, cosine_a = np.sin(alpha), np.cos(alpha)
        towards = Towards(
            sine * cosine_a - cosine * sine_a,
            cosine * cosine_a + sine * sine_a,
            own.normal,
            own.offset,
            np.cos(v),
            np.sin(v),
            voff,
            hoff,
        )
        w = own.distance_m * (1.0 + scale) + dl - towards.to_plane
        return LaserState(w, x, lambda: self._system(block, x, towards, w))

    def _values(self, block: int, x: Array) -> Array:
        """Parameters of one laser and its range scale, in the order of `ADJUSTABLE`."""
        values: Array = self._start[block].copy()
        values[self._columns] += x
        return values

    def _system(self, block: int, x: Array, towards: Towards, w: Array) -> System:
        matrix = towards.derivatives(self._own[block].distance_m)
        sigma = self.stochastic.sigma_misclosure(matrix[:, ADJUSTABLE.index("alpha")])
        return System(matrix.T[self._columns].T, w, sigma, self.prior_std, x)

    def corrections(self, blocks: Sequence[int], states: Sequence[LaserState]) -> list[Array]:
        """Solve the linearised systems of some lasers."""
        steps = self._steps(blocks, [self.solver.reduced(state.system) for state in states])
        self._basis |= {block: step.basis for block, step in zip(blocks, steps, strict=True)}
        return [step.delta for step in steps]

    def objective(self, here: LaserState, there: LaserState) -> float:
        """What the solver minimises, at `there` with the weights of `here`."""
        if not np.isfinite(there.w).all():
            return np.inf
        weights = here.system
        with np.errstate(over="ignore"):
            return self.solver.objective(
                System(
                    weights.matrix,
                    there.w,
                    weights.sigma_misclosure,
                    weights.prior_std,
                    there.shift,
                )
            )

    def solutions(self, blocks: Mapping[int, Block[LaserState]]) -> dict[int, Step]:
        """Solve the systems at the final parameters, for all their rows."""
        systems = [self.solver.reduced(block.state.system, keep=True) for block in blocks.values()]
        steps = self._steps(list(blocks), systems)
        return {
            block: step.unreduced(system)
            for block, step, system in zip(blocks, steps, systems, strict=True)
        }

    def derivatives(self, blocks: Mapping[int, Block[LaserState]]) -> nuisance.Derivatives:
        """Derivatives of all misclosures by what is not adjusted, at the final parameters."""
        n = len(self.data.phi)
        point, towards = np.empty((3, n)).T, np.empty(n)
        for laser, block in blocks.items():
            own, rows = self._own[laser], self.rows[laser]
            values = self._values(laser, block.x)
            direction, origin = beams(own.phi, *values[1:5])
            length = own.distance_m * (1.0 + values[5]) + values[0] - block.state.w
            point[rows] = origin + length[:, None] * direction
            towards[rows] = np.einsum("ni,ni->n", direction, own.normal)
        return nuisance.derivatives(
            self.stochastic,
            point=point,
            normal=self.data.normal,
            towards=towards,
            distance_m=self.data.distance_m,
            phi=self.data.phi,
            laser_id=self.data.laser_id,
            station=self.data.station_number,
            plane=self.data.plane_number,
        )

    def block_covariance(
        self, blocks: Mapping[int, Block[LaserState]], steps: Mapping[int, Step]
    ) -> tuple[Array, Array] | None:
        """`quality.block_covariance` of all lasers; None where rows are independent, or none are.

        Returns
        -------
        covariance : ndarray, shape (lasers, u, u)
        dof : ndarray, shape (lasers, u)
        """
        width = self.stochastic.block_rad
        if width is None or not blocks:
            return None
        data, states = self.data, [block.state.system for block in blocks.values()]
        weights = [step.row_weight for step in steps.values() if step.row_weight is not None]
        laser, station, plane = data.laser_id.astype(int), data.station_number, data.plane_number
        group = (laser * (int(station.max()) + 1) + station) * (int(plane.max()) + 1) + plane
        return quality.block_covariance(
            np.concatenate([step.influence for step in steps.values()], axis=1),
            np.concatenate([state.w for state in states]),
            block_numbers(data.phi, group, width),
            np.concatenate([state.matrix for state in states]),
            np.concatenate([state.sigma_misclosure for state in states]),
            laser,
            np.array([steps[i].rank if i in steps else 0 for i in range(len(self.rows))]),
            np.concatenate(weights) if len(weights) == len(steps) else None,
        )

    def _steps(self, blocks: Sequence[int], systems: Sequence[System]) -> list[Step]:
        return solve(self.solver, systems, [self._basis.get(block) for block in blocks])


def adjust_all(
    observations: Observations,
    initial: LaserParameters,
    names: Sequence[str],
    solver: Solver,
    stochastic: Stochastic,
    *,
    max_iterations: int = 50,
    tolerance: float = 1e-4,
) -> list[Adjustment]:
    """Adjust the parameters `names` of every laser on its own observations.

    Parameters
    ----------
    observations : Observations
        Of all lasers.
    initial : LaserParameters
        Where to start.
    names : sequence of str
        Parameters to adjust, out of `functional.ADJUSTABLE`.
    solver : Solver
        Method.
    stochastic : Stochastic
        A-priori knowledge.
    max_iterations : int
        Largest number of linearisations.
    tolerance : float
        The iteration ends when no correction changes by more than this times its prior standard
        deviation (or itself, if that is larger).

    Returns
    -------
    list of Adjustment
        By laser. A laser without observations has rank 0, and all its parameters are weakly
        determined.

    Raises
    ------
    VelocalError
        If a parameter has no prior standard deviation.
    """
    problem = LaserProblem(observations, initial, names, solver, stochastic)
    blocks = _solved(problem, max_iterations, tolerance)
    steps = problem.solutions(blocks)
    by, noise = problem.derivatives(blocks), problem.block_covariance(blocks, steps)
    return [
        _quality(
            problem.names,
            blocks[laser],
            steps[laser],
            stochastic,
            rows_of(by, rows),
            None if noise is None else (noise[0][laser], noise[1][laser]),
        )
        if laser in blocks
        else _unobserved(problem.names, problem.prior_std)
        for laser, rows in enumerate(problem.rows)
    ]


def find_corrections(
    observations: Observations,
    initial: LaserParameters,
    names: Sequence[str],
    solver: Solver,
    stochastic: Stochastic,
    *,
    max_iterations: int = 50,
    tolerance: float = 1e-4,
) -> tuple[Array, NDArray[np.bool_]]:
    """Adjust as `adjust_all` does, without the quality, which takes as long as the adjustment.

    Parameters
    ----------
    observations, initial, names, solver, stochastic, max_iterations, tolerance
        As for `adjust_all`.

    Returns
    -------
    corrections : ndarray, shape (lasers, u)
        Zeros for a laser without observations.
    converged : ndarray of bool, shape (lasers,)

    Raises
    ------
    VelocalError
        If a parameter has no prior standard deviation.
    """
    problem = LaserProblem(observations, initial, names, solver, stochastic)
    blocks = _solved(problem, max_iterations, tolerance)
    corrections = np.zeros((len(initial), len(names)))
    converged = np.zeros(len(initial), dtype=bool)
    for laser, block in blocks.items():
        corrections[laser], converged[laser] = block.x, block.converged
    return corrections, converged


def _solved(
    problem: LaserProblem, max_iterations: int, tolerance: float
) -> dict[int, Block[LaserState]]:
    """Adjust every laser that has observations, by its number."""
    return gauss_newton(
        problem,
        np.zeros((len(problem.rows), len(problem.names))),
        problem.prior_std,
        blocks=problem.observed,
        max_iterations=max_iterations,
        tolerance=tolerance,
    )


def _quality(
    names: tuple[str, ...],
    block: Block[LaserState],
    step: Step,
    stochastic: Stochastic,
    by: nuisance.Derivatives,
    correlated: tuple[Array, Array] | None,
) -> Adjustment:
    """Result of one laser with its quality.

    `correlated` are covariance and degrees of freedom of correlated noise; None where the noise
    is independent.
    """
    system, weight = block.state.system, step.row_weight
    residuals, sigma = system.w, system.sigma_misclosure
    if weight is None:
        weight = np.ones(len(residuals))
    redundancy = int(np.count_nonzero(weight)) - step.rank
    squares = float(np.sum(weight * (residuals / sigma) ** 2))
    factor = squares / redundancy if redundancy > 0 else float("nan")
    if correlated is None or redundancy <= 0:
        known = factor if redundancy > 0 else 1.0
        noise = quality.independent_covariance(step, sigma, known)
        dof = np.full(len(names), float(max(redundancy, 1)))
    else:
        noise, dof = correlated
    parts = {"noise": noise, "prior": step.prior_part}
    parts |= dict(
        nuisance.contributions(step.influence, stochastic, by, scale_adjusted="scale" in names)
    )
    combinations = quality.non_estimable(names, step)
    variance = float(weight @ residuals**2) / redundancy if redundancy > 0 else float("nan")
    stated = np.sqrt(np.diag(sum(parts.values(), np.zeros_like(noise))))
    message = block.message
    if combinations:
        message += f"; rank {step.rank} of {len(names)}, left to the prior: "
        message += "; ".join(combinations)
    return Adjustment(
        names=names,
        corrections=block.x,
        parts=parts,
        dof=dof,
        rank=step.rank,
        weakly_determined=quality.weakly_determined(names, step),
        non_estimable=combinations,
        condition=quality.condition(step),
        singular_values=step.singular_values[step.singular_values > 0.0],
        residuals=residuals,
        redundancy_numbers=1.0 - step.leverage,
        least_redundancy_number=float(np.min(1.0 - step.leverage)),
        residual_std_m=float(np.sqrt(variance)),
        count=len(residuals),
        variance=variance,
        variance_factor=factor,
        redundancy=redundancy,
        iterations=block.iterations,
        converged=block.converged,
        message=message,
        std_above_prior=quality.above(names, stated, system.prior_std),
    )


def _unobserved(names: tuple[str, ...], prior_std: Array) -> Adjustment:
    """Result of a laser without observations."""
    u, nan = len(names), float("nan")
    zero = np.zeros((u, u))
    return Adjustment(
        names=names,
        corrections=np.zeros(u),
        parts={"noise": zero, "prior": np.diag(prior_std**2)},
        dof=np.ones(u),
        rank=0,
        weakly_determined=names,
        non_estimable=names,
        condition=float("inf"),
        singular_values=np.zeros(u),
        residuals=np.zeros(0),
        redundancy_numbers=np.zeros(0),
        least_redundancy_number=nan,
        residual_std_m=nan,
        count=0,
        variance=nan,
        variance_factor=nan,
        redundancy=0,
        iterations=0,
        converged=False,
        message="no observations",
    )
