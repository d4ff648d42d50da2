"""Time of the paper's n x n pseudo-inverse against the fast form, for n rows and 3 parameters.

Usage: python benchmarks/paper_model.py [n ...]      (default 200 500 1000; 2000 takes a while)
"""

import sys
import time

import numpy as np

from velocal.adjustment.linear import System
from velocal.adjustment.solvers import PaperModel, Solver
from velocal.paper.residual_form import PaperLiteral

LITERAL, FAST = PaperLiteral(), PaperModel(truncate_at=None)


def system(n: int) -> System:
    """Well-conditioned random system."""
    rng = np.random.default_rng(n)
    prior = np.array([0.02, 0.0035, 0.0035])
    matrix = np.column_stack([np.ones(n), rng.normal(0.0, 3.0, (n, 2))])
    return System(matrix, rng.normal(0.0, 0.02, n), np.full(n, 0.02), prior, np.zeros(3))


def seconds(solver: Solver, case: System, least: float = 0.2) -> float:
    """Best time of one step."""
    best, spent = np.inf, 0.0
    while spent < least:
        start = time.perf_counter()
        solver.step(case)
        took = time.perf_counter() - start
        best, spent = min(best, took), spent + took
    return best


def main(sizes: list[int]) -> None:
    """Print times, their ratio, and the relative difference of the solutions."""
    print(f"{'n':>6} {'literal':>12} {'fast':>12} {'ratio':>10} {'difference':>12}")
    for n in sizes:
        case = system(n)
        literal, fast = seconds(LITERAL, case), seconds(FAST, case)
        one, other = LITERAL.step(case).delta, FAST.step(case).delta
        relative = np.linalg.norm(one - other) / np.linalg.norm(other)
        print(
            f"{n:6d} {literal * 1e3:9.2f} ms {fast * 1e3:9.4f} ms {literal / fast:10.0f} "
            f"{relative:12.1e}"
        )


if __name__ == "__main__":
    main([int(n) for n in sys.argv[1:]] or [200, 500, 1000])
