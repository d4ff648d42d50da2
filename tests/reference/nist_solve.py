"""How NIST's sets are solved: linear ones as the library does it, nonlinear ones beside it.

Linear sets go through the library's own iteration, `core.gauss_newton`, and its own
`OrdinaryLeastSquares`. The library has no use for more: its start is near the solution. NIST's
nonlinear sets start far away. They need the Levenberg-Marquardt iteration below, of which every
linear system is reduced and solved by `OrdinaryLeastSquares` too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from reference import nist

from velocal.adjustment.core import Block, gauss_newton
from velocal.adjustment.linear import Step, System
from velocal.adjustment.solvers import OrdinaryLeastSquares

SOLVER = OrdinaryLeastSquares()
#: The longest way, MGH17 from its first start, takes some 800; SciPy may take as many.
MAX_ITERATIONS = 2000
#: Changes of the parameters, relative to them, that end the iteration. (The most ill-conditioned
#: linear set is Filip: by rounding alone its steps are longer than 1e-9.)
TOLERANCE, LINEAR_TOLERANCE = 1e-10, 1e-8
#: Sums of squares that differ by less than this, relatively, are equal.
ROUNDING = 1e-12
#: Share of the expected decrease below which the trust region shrinks, above which it may grow.
POOR, GOOD, SHRINK, GROW = 0.25, 0.75, 0.25, 2.0
#: Damped steps are as long as the radius of the trust region within this share of it.
NEAR_RADIUS = 0.1
#: Damping lies between these, in units of the largest singular value.
LEAST_DAMPING, MOST_DAMPING = 1e-14, 1e14


class LinearSet:
    """A set of NIST as the one block of an adjustment; see `core.Problem`."""

    def __init__(self, problem: nist.Problem) -> None:
        self.problem = problem

    def at(self, block: int, x: nist.Array) -> System:
        """Linearise at parameters `x`."""
        n, u = len(self.problem.y), len(x)
        return System(
            self.problem.jacobian(x), self.problem.misclosure(x), np.ones(n), np.full(u, np.inf), x
        )

    def corrections(self, blocks: Sequence[int], states: Sequence[System]) -> list[nist.Array]:
        """Solve, and refine the solutions."""
        return [refined(SOLVER.step(state), state) for state in states]

    def objective(self, here: System, there: System) -> float:
        """Sum of squares."""
        return SOLVER.objective(there)


def linear(problem: nist.Problem) -> tuple[Block[System], Step]:
    """Solve a linear set from its start; the step is that of the final parameters."""
    start = problem.starts[0][None]
    size = np.zeros(start.shape[1])
    block = gauss_newton(LinearSet(problem), start, size, tolerance=LINEAR_TOLERANCE)[0]
    return block, SOLVER.step(block.state)


def refined(step: Step, system: System) -> nist.Array:
    """Correct a solution by what its normal equations leave, in extended precision.

    Residuals far larger than what the columns reach otherwise cost digits: three of the set
    Wampler5. (Where the platform has no extended precision nothing is gained or lost.)
    """
    matrix, w = system.matrix.astype(np.longdouble), system.w.astype(np.longdouble)
    delta = step.delta
    for _ in range(2):
        left_over = matrix.T @ (w + matrix @ delta.astype(np.longdouble))
        delta = delta - step.cofactor @ left_over.astype(np.float64)
    return delta


def levenberg_marquardt(problem: nist.Problem, start: nist.Array) -> tuple[Block[System], Step]:
    """Solve a nonlinear set; the step is that of the final parameters, without damping.

    The units of the trust region are the inverse column norms, the smallest so far, and it begins
    as long as the initial parameters: the only hint at how far a linearisation may reach.
    """
    at = LinearSet(problem).at
    block = Block(start.copy(), at(0, start))
    scale, radius, shortest = np.full(len(start), np.inf), np.inf, np.inf
    while not block.message:
        system, block.iterations = block.state, block.iterations + 1
        norm = np.linalg.norm(system.matrix, axis=0)
        scale = np.minimum(scale, 1.0 / np.where(norm > 0.0, norm, 1.0))
        if block.iterations == 1:
            radius = float(np.linalg.norm(block.x / scale)) or np.inf
        delta = refined(SOLVER.step(system), system)
        plain = bool(np.linalg.norm(delta / scale) <= radius * (1.0 + NEAR_RADIUS))
        if not plain:
            delta = damped(system, scale, radius)
        ahead = at(0, block.x + delta)
        with np.errstate(all="ignore"):  # a step may go anywhere
            change = float(np.nanmax(np.abs(delta / block.x)))
            before, after = SOLVER.objective(system), SOLVER.objective(ahead)
            moved = system.w + system.matrix @ delta
            expected = before - float(moved @ moved)
            ratio = (before - after) / expected if expected > 0.0 else 0.0
        flat = expected <= ROUNDING * before
        # Small steps that become smaller go to the solution, whatever rounding does to the sum.
        nearing = plain and change < min(1e-6, shortest / 2)
        if (nearing or after <= before * (1.0 + ROUNDING)) and np.isfinite(ahead.matrix).all():
            block.x, block.state = ahead.shift, ahead
        elif not flat:
            ratio = -np.inf
        if plain and (change <= TOLERANCE or (flat and shortest <= change < 1e-6)):
            block.converged, block.message = True, "converged"
        elif block.iterations >= MAX_ITERATIONS:
            block.message = f"not converged after {block.iterations} linearisations"
        if not flat and ratio < POOR and not nearing:
            radius = SHRINK * min(radius, float(np.linalg.norm(delta / scale)))
        elif ratio > GOOD and not plain:
            radius *= GROW
        shortest = min(shortest, change) if plain else shortest
    return block, SOLVER.step(block.state)


def damped(system: System, scale: nist.Array, radius: float) -> nist.Array:
    """Step as long as the radius: the damping is rows of zero misclosures, found by bisection."""
    small, u = SOLVER.reduced(system), len(scale)
    largest = np.linalg.norm(small.matrix * scale, ord=2)
    low, high = np.log(LEAST_DAMPING), np.log(MOST_DAMPING)
    while True:
        middle = (low + high) / 2
        more = np.exp(middle) * largest * np.diag(1.0 / scale)
        delta = SOLVER.step(
            replace(
                small,
                matrix=np.vstack([small.matrix, more]),
                w=np.concatenate([small.w, np.zeros(u)]),
                size=None,
            )
        ).delta
        excess = np.linalg.norm(delta / scale) / radius - 1.0
        if abs(excess) <= NEAR_RADIUS or high - low < 1e-3:
            return delta
        low, high = (middle, high) if excess > 0.0 else (low, middle)
