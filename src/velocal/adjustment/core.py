"""Iteration of a linearised adjustment to convergence, for one or many independent blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.linear import Step, System
from velocal.adjustment.solvers import Solver, steps

Array = NDArray[np.float64]

#: Share of the expected decrease of the sum of squares below which the trust region shrinks, above
#: which it may grow, and by how much.
POOR, GOOD, SHRINK, GROW = 0.25, 0.75, 0.25, 2.0
#: A trust region that has shrunk to this share of the longest step is given up.
LAST_RADIUS = 1e-14
#: Restricted steps are as long as the radius within this share of it.
NEAR_RADIUS = 0.1
#: Levenberg-Marquardt damping lies between these, in units of the largest singular value.
LEAST_DAMPING, MOST_DAMPING = 1e-14, 1e14
#: An unrestricted step of this relative size that lowers nothing more is a matter of rounding.
ROUNDING = 1e-6
#: So many steps that do not become smaller any more show the same.
IDLE = 3
#: Sums of squares that differ by less, relatively, are equal.
ROUNDING_OF_SUM = 1e-12


@dataclass(frozen=True)
class Evaluation:
    """A functional model at some parameters; rows of one block after those of another.

    Attributes
    ----------
    w : ndarray, shape (n,)
        Misclosures.
    matrix : ndarray, shape (n, u)
        Their derivatives by the parameters of the row's block.
    row_std : ndarray, shape (n,)
        A-priori standard deviations of the misclosures.
    """

    w: Array
    matrix: Array
    row_std: Array


#: Evaluates all blocks at parameters of shape (blocks, u).
Model = Callable[[Array], Evaluation]


@dataclass
class Block:
    """State, and in the end result, of one block.

    Attributes
    ----------
    rows : slice
        Its rows in the evaluations.
    step : Step or None
        Last linear solution; None for a block without rows.
    basis : ndarray, shape (u, k), or None
        Space of the corrections, decided by the first linearisation; without priors by each.
    scale : ndarray, shape (u,)
        Units of the corrections in which the length of a step is measured.
    radius : float
        Of the trust region, in these units.
    longest : float
        Longest step so far, in these units.
    plain : bool
        Whether the last step was not restricted.
    iterations : int
    converged : bool
    message : str
        Empty while the iteration goes on.
    shortest : float
        Relative size of the smallest unrestricted step.
    idle : int
        Unrestricted steps since that one which expected nothing.
    """

    rows: slice
    step: Step | None = None
    basis: Array | None = None
    scale: Array = field(default_factory=lambda: np.zeros(0))
    radius: float = np.inf
    longest: float = 0.0
    plain: bool = True
    iterations: int = 0
    converged: bool = False
    message: str = ""
    shortest: float = np.inf
    idle: int = 0


def iterate(
    model: Model,
    start: Array,
    sizes: Sequence[int],
    solver: Solver,
    prior_std: Array,
    *,
    max_iterations: int = 50,
    tolerance: float = 1e-10,
) -> tuple[Array, Evaluation, list[Block]]:
    """Adjust the parameters of every block until they stand still.

    Gauss-Newton steps, restricted to a trust region by Levenberg-Marquardt damping. Its units are
    the prior standard deviations, and it is boundless until a step fails to lower the weighted
    sum of squares. Without any prior its units are the inverse column norms, the largest so far
    as Moré has them, and it begins as long as the initial parameters: the only hint at how far
    a linearisation may reach. A step is small enough when no parameter changes by more
    than `tolerance` times its size or, where that is larger, its prior standard deviation.

    Parameters
    ----------
    model : callable
        Evaluates all blocks at once.
    start : ndarray, shape (blocks, u)
        Initial parameters.
    sizes : sequence of int
        Rows of every block.
    solver : Solver
        Solves the linearised systems.
    prior_std : ndarray, shape (u,)
        A-priori standard deviations of the corrections; infinite for none.
    max_iterations : int
        Largest number of linearisations.
    tolerance : float
        See above.

    Returns
    -------
    parameters : ndarray, shape (blocks, u)
    evaluation : Evaluation
        At these parameters.
    blocks : list of Block
        With status and message of each.
    """
    ends = np.cumsum(sizes)
    blocks = [Block(slice(end - size, end)) for end, size in zip(ends, sizes, strict=True)]
    x = start.astype(np.float64, copy=True)
    here = model(x)
    open_ = []
    for number, block in enumerate(blocks):
        if sizes[number]:
            open_.append(number)
        else:
            block.message = "no observations"
    free = bool(np.all(np.isinf(prior_std)))
    while open_:
        deltas, systems = np.zeros_like(x), {}
        for number in open_:
            shift = x[number] - start[number]
            systems[number] = solver.reduced(_system(here, blocks[number], prior_std, shift))
        found = steps(solver, list(systems.values()), [blocks[number].basis for number in open_])
        for number, step in zip(open_, found, strict=True):
            block, system = blocks[number], systems[number]
            _rescale(block, system, x[number], free)
            block.step = _restricted(solver, system, block, step, free)
            # Were the space to change on the way, a direction at the limit could go back and
            # forth for ever. Without a prior none is held for good: a column may vanish at the
            # start only.
            block.basis = None if free else block.step.basis
            block.iterations += 1
            deltas[number] = block.step.delta
        trial = x + deltas
        there = model(trial)
        closed, rejected = [], []
        with np.errstate(divide="ignore", invalid="ignore"):
            # Size of every step by that of its parameter; no size is no measure.
            largest = np.maximum(np.abs(x), np.where(np.isinf(prior_std), 0.0, prior_std))
            relatives = np.abs(deltas) / largest
        for number in open_:
            block, system = blocks[number], systems[number]
            assert block.step is not None
            relative = float(np.nanmax(relatives[number]))
            if block.plain and relative <= tolerance:
                x[number] = trial[number]
                block.converged, block.message = True, "converged"
                closed.append(number)
                continue
            # Weights are those of the linearisation, or another sum would be compared.
            moved = Evaluation(there.w, there.matrix, here.row_std)
            ahead = _system(moved, block, prior_std, trial[number] - start[number])
            with np.errstate(over="ignore", invalid="ignore"):  # a step may go anywhere
                before, after = solver.objective(system), solver.objective(ahead)
                expected = before - solver.objective(_moved(system, block.step.delta))
            flat = expected <= ROUNDING_OF_SUM * before
            # Small steps that become smaller go to the solution, whatever rounding does to the sum.
            nearing = block.plain and relative < min(ROUNDING, block.shortest / 2)
            accepted = nearing or after <= before * (1.0 + ROUNDING_OF_SUM)
            accepted &= bool(np.all(np.isfinite(there.matrix[block.rows])))
            length = _length(block.step, block)
            block.longest = max(block.longest, length)
            ratio = (before - after) / expected if expected > 0.0 else 0.0
            if block.plain:
                block.idle = block.idle + 1 if flat and relative >= block.shortest else 0
                block.shortest = min(block.shortest, relative)
            # Near the solution rounding alone can keep the steps from shrinking; restricting
            # them would not help.
            rounding = block.shortest < ROUNDING
            if not (flat and rounding) and (not accepted or not (flat or ratio >= POOR)):
                block.radius = SHRINK * min(block.radius, length)
            elif not flat and ratio > GOOD and not block.plain:
                block.radius *= GROW
            if accepted:
                x[number] = trial[number]
            else:
                rejected.append(block.rows)
            if rounding and block.idle >= IDLE:
                block.converged, block.message = True, "converged to rounding"
            elif block.radius < LAST_RADIUS * block.longest:
                block.converged = rounding
                block.message = (
                    "converged to rounding"
                    if block.converged
                    else "stalled: no step lowers the sum of squares"
                )
            elif block.iterations >= max_iterations:
                block.message = f"not converged after {block.iterations} linearisations"
            if block.message:
                closed.append(number)
        here = _mixed(there, here, rejected) if rejected else there
        open_ = [number for number in open_ if number not in closed]
    # Quality belongs to the final parameters, undamped.
    ended = [number for number, size in enumerate(sizes) if size]
    last = [
        solver.reduced(
            _system(here, blocks[number], prior_std, x[number] - start[number]), keep=True
        )
        for number in ended
    ]
    found = steps(solver, last, [blocks[number].basis for number in ended])
    for number, system, step in zip(ended, last, found, strict=True):
        blocks[number].step = step.unreduced(system)
    return x, here, blocks


def _system(evaluation: Evaluation, block: Block, prior_std: Array, shift: Array) -> System:
    rows = block.rows
    return System(
        evaluation.matrix[rows], evaluation.w[rows], evaluation.row_std[rows], prior_std, shift
    )


def _mixed(there: Evaluation, here: Evaluation, blocks: Sequence[slice]) -> Evaluation:
    """`there`, but `here` in some blocks."""
    mixed = Evaluation(there.w.copy(), there.matrix.copy(), there.row_std.copy())
    for rows in blocks:
        mixed.w[rows], mixed.matrix[rows] = here.w[rows], here.matrix[rows]
        mixed.row_std[rows] = here.row_std[rows]
    return mixed


def _moved(system: System, delta: Array) -> System:
    """What the linearisation expects after a step."""
    return replace(system, w=system.w + system.matrix @ delta, shift=system.shift + delta)


def _rescale(block: Block, system: System, x: Array, free: bool) -> None:
    """Bring the units of the trust region up to date."""
    if not free:
        block.scale = np.where(np.isinf(system.prior_std), 1.0, system.prior_std)
        return
    norm = np.sqrt(np.sum((system.matrix / system.row_std[:, None]) ** 2, axis=0))
    if not len(block.scale):
        block.scale = 1.0 / np.where(norm > 0.0, norm, 1.0)
        block.radius = float(np.linalg.norm(x / block.scale)) or np.inf
    block.scale = np.minimum(block.scale, 1.0 / np.maximum(norm, np.finfo(float).tiny))


def _length(step: Step, block: Block) -> float:
    return float(np.linalg.norm(step.delta / block.scale))


def _restricted(solver: Solver, system: System, block: Block, step: Step, free: bool) -> Step:
    """Return a step, or a damped one of the same system where it leaves the trust region."""
    block.plain = _length(step, block) <= block.radius * (1.0 + NEAR_RADIUS)
    if block.plain:
        return step
    basis = np.diag(block.scale) if free else step.basis
    low, high = np.log(LEAST_DAMPING), np.log(MOST_DAMPING)
    while high - low > 1e-3:
        middle = (low + high) / 2
        step = solver.step(system, basis, float(np.exp(middle)))
        excess = _length(step, block) / block.radius - 1.0
        if abs(excess) <= NEAR_RADIUS:
            break
        low, high = (middle, high) if excess > 0.0 else (low, middle)
    return step
