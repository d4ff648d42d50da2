"""Solutions of NIST's sets by the library's linear algebra and by SciPy, and their digits.

From the shell: ``python tests/reference/nist_fit.py > docs/nist.md`` (after ``make nist``).
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


HEAD = """# Digits reached in NIST's reference data sets

The Statistical Reference Datasets of NIST: 11 linear sets, and 27 nonlinear ones of all three
levels of difficulty, each from both starts. What is tested of the library:

- Linear sets go through its iteration (`velocal.adjustment.core`) and its ordinary least squares
  (`velocal.adjustment.solvers`, `linear`) without a prior. Added for the test: the solution is
  refined in extended precision, which Wampler5 needs.
- Nonlinear sets go through the same linear algebra, at every step of a Levenberg-Marquardt
  iteration that belongs to the test (`tests/reference/nist_solve.py`). The library has none: an
  adjustment of a scanner starts near its solution, and Gauss-Newton steps are enough.

An entry is "digits of the worst parameter / of the worst standard deviation": minus log10 of the
relative error, at most 15 (of the error itself where zero is certified: the standard deviations of
Wampler1 and Wampler2). NIST certifies 11 digits of the nonlinear sets; the linear ones, started at
zero, are compared with least squares in rational numbers, which agrees with all that NIST prints.
A dash: not one digit.

`tests/reference/test_nist.py` asks for 6 digits of every parameter and 4 of every standard
deviation, and gets them, with one exception: **the standard deviations of Lanczos1**, of which
about three digits are reached. Its data have no noise: the certified residuals are 8e-14 of values
up to 2.5, that is a few hundred roundings of a double, and standard deviations are proportional to
them. SciPy's are no better.

For comparison SciPy, from the same starts: `least_squares` with the same derivatives,
`x_scale="jac"`, tolerances of 1e-15 and at most %d evaluations, by its methods `trf` and `lm`; and
`curve_fit` with nothing set. Last digits depend on the processor and on the linear algebra that
NumPy uses.

The sets come from the source distributions of lmfit (nonlinear) and reductus (linear), which
`make nist` downloads, and from SciPy (Norris); NoInt2 and Longley stand in
`tests/reference/nist.py`. This page is made by `python tests/reference/nist_fit.py > docs/nist.md`.
"""


def main() -> None:
    """Print the page."""
    warnings.simplefilter("ignore")
    linear = table([nist.linear(name) for name in nist.LINEAR])
    nonlinear = table([nist.nonlinear(name) for name in nist.MODELS])
    print(
        "\n".join(
            [HEAD % MAX_ITERATIONS, "## Linear", "", *linear, "", "## Nonlinear", "", *nonlinear]
        )
    )


if __name__ == "__main__":
    main()
