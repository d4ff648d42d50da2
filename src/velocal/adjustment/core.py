"""Iteration of a linearised adjustment to convergence, for one or many independent blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.solvers import Solver, Step, System

Array = NDArray[np.float64]

#: Damping that a rejected step begins with, what it is multiplied by, and where it is given up.
FIRST_DAMPING, DAMPING_FACTOR, LAST_DAMPING = 1e-4, 5.0, 1e8
#: An undamped step of this relative size that lowers nothing more is a matter of rounding.
ROUNDING = 1e-6
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
    basis : ndarray, shape (u, rank), or None
        Space of the corrections, decided by the first linearisation.
    damping : float
    iterations : int
    converged : bool
    message : str
        Empty while the iteration goes on.
    last_plain : float
        Relative size of the last undamped step.
    """

    rows: slice
    step: Step | None = None
    basis: Array | None = None
    damping: float = 0.0
    iterations: int = 0
    converged: bool = False
    message: str = ""
    last_plain: float = np.inf


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

    Plain Gauss-Newton steps while they lower the weighted sum of squares; where one does not, it
    is damped (Levenberg-Marquardt). A step is small enough when no parameter changes by more
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
    while open_:
        trial = x.copy()
        for number in open_:
            block = blocks[number]
            block.step = solver.step(
                _system(here, block, prior_std, x[number] - start[number]),
                block.basis,
                block.damping,
            )
            # Were the space to change on the way, a direction at the limit could go back and
            # forth for ever.
            block.basis = block.step.basis
            block.iterations += 1
            trial[number] = x[number] + block.step.delta
        there = model(trial)
        closed = []
        for number in open_:
            block = blocks[number]
            assert block.step is not None
            size = np.maximum(np.abs(x[number]), np.where(np.isinf(prior_std), 0.0, prior_std))
            with np.errstate(divide="ignore", invalid="ignore"):
                relative = float(np.nanmax(np.abs(block.step.delta) / size))
            plain = block.damping == 0.0
            if plain:
                block.last_plain = relative
            before = solver.objective(_system(here, block, prior_std, x[number] - start[number]))
            # Weights are those of the linearisation, or another sum would be compared.
            moved = Evaluation(there.w, there.matrix, here.row_std)
            after = solver.objective(
                _system(moved, block, prior_std, trial[number] - start[number])
            )
            accepted = after <= before * (1.0 + ROUNDING_OF_SUM) or (
                plain and relative <= tolerance
            )
            if accepted:
                x[number] = trial[number]
                block.damping = 0.0 if block.damping <= FIRST_DAMPING else block.damping / 10.0
            else:
                block.damping = max(FIRST_DAMPING, block.damping * DAMPING_FACTOR)
            if plain and relative <= tolerance:
                block.converged, block.message = True, "converged"
            elif block.damping > LAST_DAMPING:
                # Near the solution rounding alone can keep the sum from falling.
                block.converged = block.last_plain < ROUNDING
                block.message = (
                    "converged to rounding"
                    if block.converged
                    else "stalled: no step lowers the sum of squares"
                )
            elif block.iterations >= max_iterations:
                block.message = f"not converged after {block.iterations} linearisations"
            if block.message:
                closed.append(number)
        here = there if np.array_equal(trial, x) else model(x)
        open_ = [number for number in open_ if number not in closed]
    for number, block in enumerate(blocks):
        if sizes[number]:
            # Quality belongs to the final parameters, undamped.
            shift = x[number] - start[number]
            block.step = solver.step(_system(here, block, prior_std, shift), block.basis)
    return x, here, blocks


def _system(evaluation: Evaluation, block: Block, prior_std: Array, shift: Array) -> System:
    rows = block.rows
    return System(
        evaluation.matrix[rows], evaluation.w[rows], evaluation.row_std[rows], prior_std, shift
    )
