"""Monte Carlo on the simulated world: stated standard deviations compared with true errors.

Medians are drawn directly (`simulation.draws`). Packets are left to the tests of the closed loop.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import ADJUSTABLE
from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.solvers import Solver
from velocal.adjustment.stochastic import Stochastic
from velocal.arrays import Array
from velocal.simulation.draws import Draw, Geometry, exact
from velocal.study.world import Errors


@dataclass(frozen=True)
class Outcome:
    """Runs of one method on one station, arrays of shape (runs, lasers, u).

    The lasers are those that have beams.

    Attributes
    ----------
    names : tuple of str
        Adjusted parameters.
    error : ndarray
        Adjusted minus true parameters.
    std : ndarray
        Stated standard deviations.
    inside : ndarray of bool
        Whether the stated 95 % interval covers the truth.
    observable : ndarray of bool, shape (lasers, u)
        Whether the data determine the parameter (in most runs).
    """

    names: tuple[str, ...]
    error: Array
    std: Array
    inside: NDArray[np.bool_]
    observable: NDArray[np.bool_]


def outcome(
    draws: Iterable[Draw],
    at: Geometry,
    names: Sequence[str],
    solver: Solver,
    stochastic: Stochastic,
) -> Outcome:
    """Adjust every run and compare the result with its truth.

    The adjustment iterates until no correction changes by more than a thousandth of its prior
    standard deviation.

    Parameters
    ----------
    draws : iterable of Draw
    at : Geometry
        Of all draws.
    names : sequence of str
        Parameters to adjust.
    solver : Solver
    stochastic : Stochastic
        Its survey is replaced by that of the draw.
    """
    error, std, inside, weak = [], [], [], []
    used = np.unique(at.laser_id)
    for draw in draws:
        survey = () if draw.survey is None else (draw.survey,)
        model = replace(stochastic, survey=survey)
        found = adjust_all(draw.observations, at.factory, names, solver, model, tolerance=1e-3)
        results = [found[laser] for laser in used]
        true = np.column_stack(
            [(getattr(draw.true, name) - getattr(at.factory, name))[used] for name in names]
        )
        difference = np.array([result.corrections for result in results]) - true
        half = np.array([result.interval() for result in results])
        error.append(difference)
        std.append([result.std for result in results])
        inside.append(np.abs(difference) <= half)
        weak.append([[name in result.weakly_determined for name in names] for result in results])
    return Outcome(
        tuple(names),
        np.array(error),
        np.array(std),
        np.array(inside),
        np.mean(weak, axis=0) < 0.5,
    )


def cramer_rao(at: Geometry, stochastic: Stochastic, names: Sequence[str]) -> Array:
    """Least standard deviations of unbiased parameters for white noise, shape (lasers, u).

    They are the roots of the diagonal of (A' M A)^-1 at the factory's parameters, for the lasers
    that have beams; infinite for a laser whose data do not determine all parameters.

    Parameters
    ----------
    at : Geometry
    stochastic : Stochastic
        Sizes of the noise.
    names : sequence of str
        Parameters to adjust.
    """
    _, matrix = exact(at).design(at.factory)
    weighted = matrix / stochastic.sigma_misclosure(matrix[:, ADJUSTABLE.index("alpha")])[:, None]
    weighted = weighted[:, [ADJUSTABLE.index(name) for name in names]]
    used = np.unique(at.laser_id)
    bound = np.full((len(used), len(names)), np.inf)
    for number, laser in enumerate(used):
        own = weighted[at.laser_id == laser]
        scaled = own * [stochastic.prior_std[name] for name in names]
        if len(own) > len(names) and np.linalg.cond(scaled) < 1e10:
            bound[number] = np.sqrt(np.diag(np.linalg.inv(own.T @ own)))
    return bound


def observable_only(at: Geometry, stochastic: Stochastic, names: Sequence[str]) -> Geometry:
    """Beams of those lasers whose bound is below the prior in all parameters `names`.

    For the other lasers the bound does not hold: an error of v by degrees makes the model
    nonlinear.
    """
    bound = cramer_rao(at, stochastic, names)
    prior = [stochastic.prior_std[name] for name in names]
    lasers = np.unique(at.laser_id)[(bound < prior).all(axis=1)]
    kept = np.isin(at.laser_id, lasers)
    return replace(at, phi=at.phi[kept], laser_id=at.laser_id[kept], plane=at.plane[kept])


def of_unit(stochastic: Stochastic, errors: Errors) -> Stochastic:
    """Stochastic model with the range scale and the repeatability of a simulated unit."""
    steady = (
        errors.shift_cm, errors.drift_laser_cm, errors.drift_common_cm, errors.drift_window_cm,
    )  # fmt: skip
    return replace(
        stochastic,
        range_scale=errors.range_scale_cm_per_m * 1e-2,
        repeatability_m=float(np.linalg.norm(steady)) * 1e-2,
    )


def white_only(stochastic: Stochastic) -> Stochastic:
    """Stochastic model of independent noise of distance and angle, and no other errors."""
    return replace(stochastic, block_rad=None, range_scale=0.0, repeatability_m=0.0, survey=())


def summary(found: Outcome, bound: Array | None = None) -> Iterator[dict[str, Any]]:
    """Rows per parameter: those that the data determine, and those that they do not.

    Parameters
    ----------
    found : Outcome
    bound : ndarray, shape (lasers, u), optional
        Standard deviations to compare the errors with; the stated ones if omitted.

    Yields
    ------
    dict
        Root mean square error and stated standard deviation over runs and lasers, in metres or
        radians; their ratio, and the least and the greatest ratio of a single laser; the share of
        95 % intervals that cover the truth, and the least and the greatest share of a laser.
    """
    stated = np.sqrt(np.mean(found.std**2, axis=0))
    compared = stated if bound is None else bound
    rms = np.sqrt(np.mean(found.error**2, axis=0))
    cover = found.inside.mean(axis=0) * 100.0
    for number, name in enumerate(found.names):
        for observable in (True, False):
            lasers = found.observable[:, number] == observable
            if not lasers.any():
                continue
            size, other, share = (each[lasers, number] for each in (rms, compared, cover))
            ratio = size / other
            yield {
                "parameter": name,
                "observable": int(observable),
                "runs": len(found.error),
                "lasers": int(lasers.sum()),
                "rms_error": np.sqrt(np.mean(size**2)),
                "stated_std": np.sqrt(np.mean(stated[lasers, number] ** 2)),
                "compared_with": "stated" if bound is None else "bound",
                "ratio": np.sqrt(np.mean(ratio**2)),
                "least_ratio": ratio.min(),
                "greatest_ratio": ratio.max(),
                "coverage_95_pct": share.mean(),
                "least_coverage_pct": share.min(),
                "greatest_coverage_pct": share.max(),
            }
