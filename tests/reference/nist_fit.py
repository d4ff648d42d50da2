"""Solutions of NIST's sets by the library's linear algebra and by SciPy, and their digits.

From the shell, after ``make nist``: ``python tests/reference/nist_fit.py`` prints the tables of
docs/nist.md; with ``--write`` it puts them there.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import curve_fit, least_squares

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from reference import nist, nist_solve
from reference.nist_solve import MAX_ITERATIONS

from velocal.io.markup import inserted

DOC = Path(__file__).parents[2] / "docs/nist.md"


@dataclass(frozen=True)
class Fit:
    """Matching digits of one solution."""

    parameter_digits: float
    std_digits: float
    evaluations: int
    message: str


def _fit(problem: nist.Problem, b: nist.Array, std: nist.Array, count: int, message: str) -> Fit:
    return Fit(nist.digits(b, problem.parameters), nist.digits(std, problem.std), count, message)


def ours(problem: nist.Problem, start: int) -> Fit:
    """By the library's linear algebra; see `nist_solve`."""
    n, u = len(problem.y), len(problem.parameters)
    if problem.name in nist.LINEAR:
        block, step = nist_solve.linear(problem)
    else:
        block, step = nist_solve.levenberg_marquardt(problem, problem.starts[start])
    w = block.state.w
    std = np.sqrt(np.diag(step.cofactor) * (w @ w) / (n - u))
    return _fit(problem, block.x, std, block.iterations, block.message)


def scipy_least_squares(problem: nist.Problem, start: int, method: str) -> Fit:
    """By `scipy.optimize.least_squares`, with the same derivatives and the tightest tolerances."""
    tight = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-15)
    result = least_squares(
        problem.misclosure,
        problem.starts[start],
        jac=problem.jacobian,
        method=method,
        x_scale="jac",
        max_nfev=MAX_ITERATIONS,
        **tight,
    )
    freedom = len(problem.y) - len(problem.parameters)
    with np.errstate(all="ignore"):
        scale = 1 / np.maximum(np.linalg.norm(result.jac, axis=0), 1e-300)
        root = np.linalg.pinv(result.jac * scale, rcond=1e-15) * scale[:, None]
        std = np.sqrt((root**2).sum(axis=1) * (2 * result.cost) / freedom)
    return _fit(problem, result.x, std, result.nfev, result.message)


def scipy_curve_fit(problem: nist.Problem, start: int) -> Fit:
    """By `scipy.optimize.curve_fit` as it is: its own differences and tolerances."""
    try:
        b, covariance, info, message, _ = curve_fit(
            lambda x, *b: problem.function(np.array(b), x),
            problem.x,
            problem.y,
            problem.starts[start],
            full_output=True,
        )
    except RuntimeError as error:
        return Fit(-np.inf, -np.inf, 0, str(error))
    with np.errstate(all="ignore"):
        return _fit(problem, b, np.sqrt(np.diag(covariance)), info["nfev"], message)


def _cell(fit: Fit) -> str:
    if fit.parameter_digits < 1:
        return "–"
    return f"{fit.parameter_digits:.1f} / {max(fit.std_digits, 0.0):.1f}"


def table(problems: list[nist.Problem]) -> list[str]:
    """Rows of Markdown: digits of parameters / of standard deviations."""
    rows = [
        "| set | level | start | velocal | linearisations | SciPy trf | SciPy lm | curve_fit |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for problem in problems:
        for start in range(len(problem.starts)):
            fit = ours(problem, start)
            others = [
                scipy_least_squares(problem, start, "trf"),
                scipy_least_squares(problem, start, "lm"),
                scipy_curve_fit(problem, start),
            ]
            cells = [problem.name, problem.level, str(start + 1), _cell(fit), str(fit.evaluations)]
            rows.append("| " + " | ".join([*cells, *map(_cell, others)]) + " |")
    return rows


def main() -> None:
    """Print the tables, or write them into the page."""
    warnings.simplefilter("ignore")
    page = DOC.read_text(encoding="utf-8")
    problems = {
        "nist_linear": [nist.linear(name) for name in nist.LINEAR],
        "nist_nonlinear": [nist.nonlinear(name) for name in nist.MODELS],
    }
    for name, of in problems.items():
        rows = "\n".join(table(of))
        print(rows)
        page = inserted(page, name, rows)
    if "--write" in sys.argv:
        DOC.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
