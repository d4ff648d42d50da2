"""Statistics of the residual s per laser, before and after calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from velocal.errors import VelocalError

Array = NDArray[np.float64]

#: Significance of the variance tests.
ALPHA = 0.05


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
        Whether the variance about zero, or about the mean, is significantly below sigma^2
        (one-sided chi-square test at 5 %).
    """

    count: NDArray[np.int64]
    rms_m: Array
    mean_m: Array
    std_m: Array
    within_1sigma: Array
    within_3sigma: Array
    complies_zero: NDArray[np.bool_]
    complies_mean: NDArray[np.bool_]


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
            std_m=np.sqrt(about_mean / (count - 1)),
            within_1sigma=total(size < sigma_m) / count,
            within_3sigma=total(size < 3.0 * sigma_m) / count,
            complies_zero=zero & (count > 0),
            complies_mean=centred & (count > 1),
        )


def _chi_square_bound(freedom: NDArray[np.int64]) -> Array:
    """Value that a chi-square variable stays below with probability `ALPHA`.

    scipy.stats has the same, but takes longer to import than most scripts to run.
    """
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


def statistics_table(
    heading: Mapping[str, str],
    residuals: Mapping[str, Array],
    laser_id: NDArray[np.integer],
    n_lasers: int,
    sigma_m: float,
) -> dict[str, Array]:
    """Statistics as columns of a table, a row per calibration and laser, in cm and per cent.

    Parameters
    ----------
    heading : mapping of str to str
        Columns that are the same in every row.
    residuals : mapping of str to ndarray, shape (n,)
        Residuals by calibration: "before", "after" or the name of a parameter set.
    laser_id, n_lasers, sigma_m
        As for `laser_statistics`.
    """
    columns: dict[str, list[Any]] = {name: [] for name in (*heading, "calibration", "laser_id")}
    columns |= {name: [] for name in ("count", *_COLUMNS)}
    for calibration, s in residuals.items():
        lasers = laser_statistics(s, laser_id, n_lasers, sigma_m)
        for name, value in {**heading, "calibration": calibration}.items():
            columns[name].append(np.full(n_lasers, value))
        columns["laser_id"].append(np.arange(n_lasers))
        columns["count"].append(lasers.count)
        for name, (attribute, factor) in _COLUMNS.items():
            columns[name].append(getattr(lasers, attribute) * factor)
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def summary_row(lasers: Mapping[str, Any]) -> dict[str, float]:
    """Reduce the statistics of all lasers of a window to one row.

    Parameters
    ----------
    lasers : mapping of str to array, shape (lasers,)
        Columns of `statistics_table` for one window and calibration.

    Returns
    -------
    dict
        ``std_cm``: mean over lasers of the root mean square about zero, which is what the
        tables print. ``pooled_rms_cm`` and ``mean_std_cm``: the two other readings of "standard
        deviation", the root mean square of all residuals and the mean over lasers of the
        standard deviation about the laser's mean. Shares of all residuals within one and three
        sigmas; lasers whose variance is significantly below sigma^2; lasers with residuals and
        number of residuals. NaN where there are none.
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
        "std_cm": mean("rms_cm"),
        "pooled_rms_cm": mean("rms_cm", weighted=True, power=2) ** 0.5,
        "mean_std_cm": mean("std_cm"),
        "within_1sigma_pct": mean("within_1sigma_pct", weighted=True),
        "within_3sigma_pct": mean("within_3sigma_pct", weighted=True),
        "complies_zero": int(column["complies_zero"].sum()),
        "complies_mean": int(column["complies_mean"].sum()),
        "lasers": int(seen.sum()),
        "count": int(weight.sum()),
    }


def mean_std_of_sets(
    summary: Mapping[str, NDArray[Any]], scanner: str, samples: Sequence[str]
) -> dict[str, float]:
    """Mean of ``std_cm`` of every parameter set over the single scans of some samples.

    Parameters
    ----------
    summary : mapping of str to ndarray
        Columns of the summary: one row per sample, window, data and calibration.
    scanner : str
    samples : sequence of str
        Whose rows count, all windows of them.

    Returns
    -------
    dict of str to float
        In the order of the summary; NaN where a window has no residuals.

    Raises
    ------
    VelocalError
        If there is no set, or sets were not validated on the same windows.
    """
    rows = (summary["data"] == "validation") & (summary["scanner"] == scanner)
    rows &= np.array([str(name) in samples for name in summary["sample"]], dtype=bool)
    rows &= summary["calibration"] != "before"
    calibration, std_cm = summary["calibration"][rows], summary["std_cm"][rows].astype(float)
    names = [str(name) for name in dict.fromkeys(calibration)]
    counts = {name: int(np.sum(calibration == name)) for name in names}
    if not names or len(set(counts.values())) > 1:
        raise VelocalError(
            f"{scanner}, samples {', '.join(samples)}: "
            + ("no parameter set was validated" if not names else f"windows per set are {counts}"),
            where="statistics",
            allowed="one or more sets, each validated on the same windows",
        )
    return {name: float(np.mean(std_cm[calibration == name])) for name in names}


def best_set(summary: Mapping[str, NDArray[Any]], scanner: str, samples: Sequence[str]) -> str:
    """Name of the parameter set that tables and figures of validation show as "after".

    It is the one of least mean ``std_cm`` over all windows of the samples, the first of equals.
    The paper shows its best set per table in the same way. It is chosen on the validation data
    themselves, so its numbers are a little better than those of a set chosen beforehand.

    Raises
    ------
    VelocalError
        As `mean_std_of_sets`, or if no set has residuals in every window.
    """
    means = mean_std_of_sets(summary, scanner, samples)
    finite = {name: mean for name, mean in means.items() if np.isfinite(mean)}
    if not finite:
        raise VelocalError(
            f"{scanner}, samples {', '.join(samples)}: a window without residuals",
            where="statistics",
            hint="No return of it was assigned to a plane: look at assignment.limits.",
        )
    return min(finite, key=lambda name: finite[name])


def calibration_after(
    summary: Mapping[str, NDArray[Any]], scanner: str, samples: Sequence[str], data: str
) -> str:
    """Value of ``calibration`` in the rows that are shown as "after".

    Medians (`data` "calibration") have their own window's adjustment, single scans
    ("validation") the best set.
    """
    return "after" if data == "calibration" else best_set(summary, scanner, samples)
