"""Adjustment of all lasers of a scanner, each on its own, at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from velocal.adjustment import nuisance, quality
from velocal.adjustment.core import Block, gauss_newton
from velocal.adjustment.functional import ADJUSTABLE, Towards, scaled, split
from velocal.adjustment.linear import Step, System
from velocal.adjustment.observations import Observations
from velocal.adjustment.result import Adjustment
from velocal.adjustment.solvers import Solver, solve
from velocal.adjustment.stochastic import Stochastic, block_numbers
from velocal.arrays import Array, rows_of
from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import PARAMETERS, LaserParameters


class LaserProblem:
    """The lasers of a scanner as independent blocks of one adjustment; see `core.Problem`.

    The state of a block is its linearised `System`. The first linearisation decides on the space
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
        self._initial = [
            LaserParameters(*(getattr(initial, name)[[laser]] for name in PARAMETERS))
            for laser in range(len(initial))
        ]
        self._columns = [ADJUSTABLE.index(name) for name in names]
        self._basis: dict[int, Array] = {}

    def at(self, block: int, x: Array) -> System:
        """Linearise the model of one laser at corrections `x`, shape (u,)."""
        own = self._own[block]
        beams, scale = self._towards(block, x)
        matrix = beams.derivatives(own.distance_m)
        sigma = self.stochastic.sigma_misclosure(matrix[:, ADJUSTABLE.index("alpha")])
        s = beams.misclosure(own.distance_m, scale)
        return System(matrix.T[self._columns].T, s, sigma, self.prior_std, x)

    def _towards(self, block: int, x: Array) -> tuple[Towards, Array | None]:
        """Beams of one laser at corrections `x`, and its range scale."""
        own, (sine, cosine) = self._own[block], self._turned[block]
        parameters, scale = split(x[None], self.names, self._initial[block])
        # Addition theorems: sines of all angles once, not in every iteration.
        sine_a, cosine_a = np.sin(parameters.alpha), np.cos(parameters.alpha)
        of_sine, of_cosine = sine * cosine_a - cosine * sine_a, cosine * cosine_a + sine * sine_a
        # The only laser of these parameters has number 0.
        return Towards(of_sine, of_cosine, 0, parameters, own.normal, own.offset), scale

    def corrections(self, blocks: Sequence[int], states: Sequence[System]) -> list[Array]:
        """Solve the linearised systems of some lasers."""
        steps = self._steps(blocks, [self.solver.reduced(state) for state in states])
        self._basis |= {block: step.basis for block, step in zip(blocks, steps, strict=True)}
        return [step.delta for step in steps]

    def objective(self, here: System, there: System) -> float:
        """What the solver minimises, at `there` with the weights of `here`."""
        if not np.isfinite(there.matrix).all():
            return np.inf
        with np.errstate(over="ignore"):
            return self.solver.objective(
                System(there.matrix, there.w, here.sigma_misclosure, there.prior_std, there.shift)
            )

    def solutions(self, blocks: Mapping[int, Block[System]]) -> dict[int, Step]:
        """Solve the systems at the final parameters, for all their rows."""
        systems = [self.solver.reduced(block.state, keep=True) for block in blocks.values()]
        steps = self._steps(list(blocks), systems)
        return {
            block: step.unreduced(system)
            for block, step, system in zip(blocks, steps, systems, strict=True)
        }

    def derivatives(self, blocks: Mapping[int, Block[System]]) -> nuisance.Derivatives:
        """Derivatives of all misclosures by what is not adjusted, at the final parameters."""
        n = len(self.data.phi)
        point, towards = np.empty((3, n)).T, np.empty(n)
        for laser, block in blocks.items():
            own, rows = self._own[laser], self.rows[laser]
            parameters, scale = split(block.x[None], self.names, self._initial[laser])
            zero = np.zeros(len(own.phi), dtype=np.int64)
            direction, origin = laser_beams(own.phi, zero, parameters)
            length = scaled(own.distance_m, 0, scale) + parameters.dl[0] - block.state.w
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
        self, blocks: Mapping[int, Block[System]], steps: Mapping[int, Step]
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
        data, states = self.data, [block.state for block in blocks.values()]
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
    blocks = gauss_newton(
        problem,
        np.zeros((len(initial), len(names))),
        problem.prior_std,
        blocks=problem.observed,
        max_iterations=max_iterations,
        tolerance=tolerance,
    )
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


def _quality(
    names: tuple[str, ...],
    block: Block[System],
    step: Step,
    stochastic: Stochastic,
    by: nuisance.Derivatives,
    correlated: tuple[Array, Array] | None,
) -> Adjustment:
    """Result of one laser with its quality.

    `correlated` are covariance and degrees of freedom of correlated noise; None where the noise
    is independent.
    """
    residuals, sigma, weight = block.state.w, block.state.sigma_misclosure, step.row_weight
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
        std_above_prior=quality.above(names, stated, block.state.prior_std),
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
