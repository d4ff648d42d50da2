"""Statistics of the residual s per laser, before and after calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.arrays import Array
from velocal.evaluation.candidates import IDENTITY, Candidate
from velocal.evaluation.variance_test import correlated_variance_test, holm

#: Columns that say which residuals a row of statistics is of.
KEYS = ("scanner", "sample", "window", "data", *IDENTITY)
#: Column that says whether the rotations are the window's own ("window") or outside all windows
#: ("outside").
ROTATIONS_FROM = "rotations_from"
#: Significance of the variance tests.
ALPHA = 0.05
#: Columns that count lasers whose variance is significantly below sigma^2: the paper's two tests,
#: then that for correlated residuals, for every laser alone and for all lasers together.
COMPLIES = ("complies_zero", "complies_mean", "complies_correlated", "complies_holm")


@dataclass(frozen=True)
class LaserStatistics:
    """Statistics of s, one element per laser; NaN for a laser without residuals.

    Attributes
    ----------
    count : ndarray of int64
        Number of residuals.
    rms_m : ndarray
        Root mean square about zero: the tables' "standard deviation".
    mean_m, std_m : ndarray
        Mean, and standard deviation about it.
    within_1sigma, within_3sigma : ndarray
        Share of residuals smaller than one and three datasheet sigmas.
    complies_zero, complies_mean : ndarray of bool
        Whether the variance about zero, or about the mean, is significantly below sigma^2 by the
        paper's test: one-sided chi-square at 5 %, for every laser alone, as if residuals were
        independent. `statistics_columns` also gives a test for correlated residuals.
    """

    count: NDArray[np.int64]
    rms_m: Array
    mean_m: Array
    std_m: Array
    within_1sigma: Array
    within_3sigma: Array
    complies_zero: NDArray[np.bool_]
    complies_mean: NDArray[np.bool_]


def laser_rms(s: Array, laser_id: NDArray[np.integer], n_lasers: int) -> Array:
    """Root mean square of residuals about zero per laser; NaN for a laser without residuals.

    Parameters
    ----------
    s, laser_id, n_lasers
        As for `laser_statistics`.

    Returns
    -------
    ndarray, shape (n_lasers,)
        Metres.
    """
    count = np.bincount(laser_id, minlength=n_lasers)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.bincount(laser_id, s**2, minlength=n_lasers) / count))


def laser_statistics(
    s: Array, laser_id: NDArray[np.integer], n_lasers: int, sigma_m: float
) -> LaserStatistics:
    """Statistics of residuals per laser.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Residuals, metres.
    laser_id : ndarray of int, shape (n,)
        Laser of each.
    n_lasers : int
        Number of lasers of the scanner.
    sigma_m : float
        Standard deviation of the datasheet, metres.

    Returns
    -------
    LaserStatistics
    """

    def total(values: NDArray[Any]) -> Array:
        weights = values.astype(np.float64)
        return np.asarray(np.bincount(laser_id, weights, minlength=n_lasers), dtype=np.float64)

    s = s.astype(np.float64)
    count = np.bincount(laser_id, minlength=n_lasers)
    with np.errstate(invalid="ignore", divide="ignore"):
        square = total(s**2)
        mean = total(s) / count
        about_mean = total((s - mean[laser_id]) ** 2)
        size = np.abs(s)
        # H0: variance >= sigma^2. It is rejected, and the laser complies, below the lower bound.
        zero = square / sigma_m**2 < _chi_square_bound(count)
        centred = about_mean / sigma_m**2 < _chi_square_bound(count - 1)
        return LaserStatistics(
            count=count,
            rms_m=np.sqrt(square / count),
            mean_m=mean,
            # Without residuals the quotient is -0: a laser that nobody saw is not exact.
            std_m=np.where(count > 0, np.sqrt(about_mean / (count - 1)), np.nan),
            within_1sigma=total(size < sigma_m) / count,
            within_3sigma=total(size < 3.0 * sigma_m) / count,
            complies_zero=zero & (count > 0),
            complies_mean=centred & (count > 1),
        )


def _chi_square_bound(freedom: NDArray[np.int64]) -> Array:
    """Value that a chi-square variable stays below with probability `ALPHA`.

    scipy.stats has the same, but takes longer to import than most scripts to run.
    """
    from scipy.special import gammaincinv  # here: many jobs import this module, few need it

    return np.asarray(2.0 * gammaincinv(freedom / 2.0, ALPHA))


#: Columns of the table of statistics that hold centimetres and per cent.
_COLUMNS = {
    "rms_cm": ("rms_m", 1e2),
    "mean_cm": ("mean_m", 1e2),
    "std_cm": ("std_m", 1e2),
    "within_1sigma_pct": ("within_1sigma", 1e2),
    "within_3sigma_pct": ("within_3sigma", 1e2),
    "complies_zero": ("complies_zero", 1),
    "complies_mean": ("complies_mean", 1),
}


def statistics_columns(
    heading: Mapping[str, str],
    s: Array,
    laser_id: NDArray[np.integer],
    n_lasers: int,
    sigma_m: float,
    phi: Array | None = None,
) -> dict[str, NDArray[Any]]:
    """Statistics as columns of a table, a row per laser, in centimetres and per cent.

    Parameters
    ----------
    heading : mapping of str to str
        Columns that are the same in every row.
    s, laser_id, n_lasers, sigma_m
        As for `laser_statistics`.
    phi : ndarray, shape (n,), optional
        Rotational angles of the residuals, radians, for the test of correlated residuals.

    Returns
    -------
    dict of str to ndarray, shape (n_lasers,)
        The heading, ``laser_id``, ``count``, ``rms_cm`` (about zero), ``mean_cm``, ``std_cm``
        (about the mean), shares, and the paper's tests ``complies_zero`` and ``complies_mean``.
        With `phi` also the test about zero for residuals that are correlated along azimuth:
        ``effective_count``, ``p_correlated``, ``complies_correlated`` (5 % for every laser alone)
        and ``complies_holm`` (5 % for all lasers of the scanner together).
    """
    lasers = laser_statistics(s, laser_id, n_lasers, sigma_m)
    columns = {
        **{name: np.full(n_lasers, value) for name, value in heading.items()},
        "laser_id": np.arange(n_lasers),
        "count": lasers.count,
        **{name: getattr(lasers, of) * factor for name, (of, factor) in _COLUMNS.items()},
    }
    if phi is not None:
        tested = correlated_variance_test(s, phi, laser_id, n_lasers, sigma_m)
        columns["effective_count"] = tested.effective_count
        columns["p_correlated"] = tested.p
        columns["complies_correlated"] = (tested.p < ALPHA).astype(int)
        columns["complies_holm"] = holm(tested.p, ALPHA).astype(int)
    return columns


def statistics_table(
    heading: Mapping[str, str],
    candidates: Sequence[Candidate],
    data: Observations,
    sigma_m: float,
) -> dict[str, NDArray[Any]]:
    """Statistics of the same observations with several calibrations, below each other.

    Parameters
    ----------
    heading : mapping of str to str
        Columns that are the same in every row.
    candidates : sequence of Candidate
        Calibrations of one scanner.
    data : Observations
    sigma_m : float
        Standard deviation of the datasheet, metres.

    Returns
    -------
    dict of str to ndarray, shape (rows,)
        Columns of `statistics_columns`, with `IDENTITY` in the heading, a row per laser of every
        candidate, and of the paper's use of the factory's file where that differs.
    """
    parts = [
        statistics_columns(
            {**heading, **each.identity},
            each.misclosure(data),
            data.laser_id,
            len(each.parameters),
            sigma_m,
            data.phi,
        )
        for candidate in candidates
        for each in candidate.shown()
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def summary_row(lasers: Mapping[str, Any]) -> dict[str, float]:
    """Reduce the statistics of all lasers of a window to one row.

    Parameters
    ----------
    lasers : mapping of str to array, shape (lasers,)
        Columns of `statistics_columns` for one window and calibration.

    Returns
    -------
    dict
        ``rms_cm``: mean over the lasers of the root mean square about zero, which is what the
        paper's tables print as "standard deviation". ``pooled_rms_cm``: root mean square of all
        residuals. ``std_cm``: mean over the lasers of the standard deviation about the mean of
        the laser. Shares of all residuals within one and three sigmas; number of lasers whose
        variance is significantly below sigma^2, by every test of the table; lasers with residuals
        and number of residuals. NaN where there are none.
    """
    column = {name: np.asarray(lasers[name], dtype=float) for name in ("count", *_COLUMNS)}
    seen = column["count"] > 0
    weight = column["count"][seen]

    def mean(name: str, *, weighted: bool = False, power: int = 1) -> float:
        if not seen.any():
            return float("nan")
        values = column[name][seen] ** power
        if weighted:
            return float(np.average(values, weights=weight))
        return float(np.nanmean(values))

    return {
        "rms_cm": mean("rms_cm"),
        "pooled_rms_cm": mean("rms_cm", weighted=True, power=2) ** 0.5,
        "std_cm": mean("std_cm"),
        "within_1sigma_pct": mean("within_1sigma_pct", weighted=True),
        "within_3sigma_pct": mean("within_3sigma_pct", weighted=True),
        **{name: int(np.sum(lasers[name])) for name in COMPLIES if name in lasers},
        "lasers": int(seen.sum()),
        "count": int(weight.sum()),
    }
