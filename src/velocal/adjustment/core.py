"""Gauss-Newton iteration of a linearised adjustment, for one or many independent blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from velocal.arrays import Array

#: Sums of squares that differ by less than this, relatively, count as equal.
ROUNDING = 1e-12
#: A step that raises the sum of squares is halved at most this many times.
HALVINGS = 12

S = TypeVar("S")


class Problem(Protocol[S]):
    """One or several independent adjustments, as `gauss_newton` sees them.

    A state is whatever the problem needs to know of one block linearised at some parameters.
    """

    def at(self, block: int, x: Array) -> S:
        """Linearise one block at the parameters `x`, shape (u,)."""
        ...

    def corrections(self, blocks: Sequence[int], states: Sequence[S]) -> Sequence[Array]:
        """Solve the linearised blocks: what the solution adds to the parameters of each."""
        ...

    def objective(self, here: S, there: S) -> float:
        """What is minimised, at the parameters of `there` but with the weights of `here`."""
        ...


@dataclass
class Block(Generic[S]):
    """How the iteration of one block went.

    Attributes
    ----------
    x : ndarray, shape (u,)
        Parameters.
    state : object
        The block linearised at `x`.
    iterations : int
        Linear systems solved.
    converged : bool
    message : str
        What happened, in words; empty while the iteration goes on.
    """

    x: Array
    state: S
    iterations: int = 0
    converged: bool = False
    message: str = ""


def gauss_newton(
    problem: Problem[S],
    start: Array,
    size: Array,
    *,
    blocks: Sequence[int] | None = None,
    max_iterations: int = 50,
    tolerance: float = 1e-10,
) -> dict[int, Block[S]]:
    """Adjust the parameters of every block until they no longer change.

    A step that raises the weighted sum of squares is halved until it lowers it. That is a guard
    against a bad start: close to the solution full steps are taken.

    Parameters
    ----------
    problem : Problem
        The blocks.
    start : ndarray, shape (blocks, u)
        Initial parameters.
    size : ndarray, shape (u,)
        Sizes that changes of the parameters are compared with, for instance their prior standard
        deviations; zero where the only measure is the parameter itself.
    blocks : sequence of int, optional
        Which blocks to adjust; all if omitted.
    max_iterations : int
        Largest number of linear systems per block.
    tolerance : float
        A block has converged when no parameter changes by more than this times its value or,
        where that is larger, its size.

    Returns
    -------
    dict of int to Block
        Result of every block that was adjusted.
    """
    found = {
        number: Block(start[number].copy(), problem.at(number, start[number]))
        for number in (range(len(start)) if blocks is None else blocks)
    }
    running = list(found)
    while running:
        steps = problem.corrections(running, [found[number].state for number in running])
        for number, step in zip(running, steps, strict=True):
            _move(problem, number, found[number], step, size, tolerance)
            block = found[number]
            if not block.message and block.iterations >= max_iterations:
                block.message = f"not converged after {block.iterations} linearisations"
        running = [number for number in running if not found[number].message]
    return found


def _move(
    problem: Problem[S], number: int, block: Block[S], step: Array, size: Array, tolerance: float
) -> None:
    """Bring one block to its next parameters."""
    block.iterations += 1
    with np.errstate(divide="ignore", invalid="ignore"):  # a parameter of no size has no measure
        change = float(np.nanmax(np.abs(step) / np.maximum(np.abs(block.x), size)))
    x = block.x + step
    state = problem.at(number, x)
    if change <= tolerance:
        block.x, block.state = x, state
        block.converged, block.message = True, "converged"
        return
    before = problem.objective(block.state, block.state)
    for half in range(HALVINGS):
        if half:
            x = block.x + step * 0.5**half
            state = problem.at(number, x)
        if problem.objective(block.state, state) <= before * (1.0 + ROUNDING):
            block.x, block.state = x, state
            return
    block.message = "stalled: no step lowers the sum of squares"
