"""Parameter sets out of several adjustments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.tabulate import Corrections

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Average:
    """Mean of the corrections of one parameter.

    Attributes
    ----------
    mean : ndarray, shape (lasers,)
        Zero for a laser that no adjustment saw.
    std : ndarray, shape (lasers,)
        Its standard deviation; NaN where nothing was seen. Noise averages out over the
        adjustments; all else (pose, planes, prior, repeatability) is taken as common to them,
        which is cautious.
    scatter : ndarray, shape (lasers,)
        Standard deviation between the samples, or between the windows where there is only one
        sample; NaN with fewer than two.
    stated : ndarray, shape (lasers,)
        Root mean square of the standard deviations of the single adjustments.
    """

    mean: Array
    std: Array
    scatter: Array
    stated: Array


def average(
    samples: Sequence[Sequence[Corrections]], weighting: str = "equal"
) -> dict[str, Average]:
    """Mean over the windows of every sample, then over the samples.

    Parameters
    ----------
    samples : sequence of sequence of Corrections
        Adjustments by sample and window. An adjustment that did not see a laser at all is left
        out of that laser's mean.
    weighting : {"equal", "covariance"}
        The plain mean, as the paper forms it, or weights by inverse variance.

    Returns
    -------
    dict of str to Average
        By parameter.
    """
    seen = np.array([[part.observed for part in windows] for windows in samples], dtype=float)
    result = {}
    for name in samples[0][0].value:
        value, std, noise = (
            np.array([[table[name] for table in tables] for tables in kind])
            for kind in (
                [[part.value for part in windows] for windows in samples],
                [[part.std for part in windows] for windows in samples],
                [[part.noise_std for part in windows] for windows in samples],
            )
        )
        weight = _weights(seen, std if weighting == "covariance" else None)
        observed = weight.sum(axis=(0, 1)) > 0
        mean = (weight * value).sum(axis=(0, 1))
        common = np.sqrt(np.maximum(std**2 - noise**2, 0.0))
        variance = ((weight * noise) ** 2).sum(axis=(0, 1)) + (
            (weight * common).sum(axis=(0, 1)) ** 2
        )
        result[name] = Average(
            mean,
            np.where(observed, np.sqrt(variance), np.nan),
            _scatter(value, seen),
            _root_mean_square(std, seen),
        )
    return result


def average_covariance(
    samples: Sequence[Sequence[Corrections]], weighting: str = "equal"
) -> dict[tuple[str, str], Array]:
    """Covariances of the means that `average` forms, shape (lasers,) by pair of parameters.

    What does not average out is common to the adjustments, as in `average`: it keeps its mean
    correlation. NaN for a laser that no adjustment saw.
    """
    parts = [part for windows in samples for part in windows]
    seen = np.array([[part.observed for part in windows] for windows in samples], dtype=float)
    plain = _weights(seen, None).reshape(len(parts), -1)
    weight, common = {}, {}
    for name in parts[0].value:
        std = np.array([[part.std[name] for part in windows] for windows in samples])
        noise = np.array([part.noise_std[name] for part in parts])
        chosen = _weights(seen, std if weighting == "covariance" else None)
        weight[name] = chosen.reshape(len(parts), -1)
        common[name] = np.sqrt(np.maximum(std.reshape(len(parts), -1) ** 2 - noise**2, 0.0))
    result = {}
    for pair in parts[0].covariance:
        (one, other), noise = pair, np.array([part.noise_covariance[pair] for part in parts])
        rest = np.array([part.covariance[pair] for part in parts]) - noise
        size = common[one] * common[other]
        correlation = np.clip(np.divide(rest, size, where=size > 0, out=np.zeros_like(size)), -1, 1)
        value = (weight[one] * weight[other] * noise).sum(axis=0)
        value += (plain * correlation).sum(axis=0) * np.prod(
            [(weight[name] * common[name]).sum(axis=0) for name in pair], axis=0
        )
        result[pair] = np.where(plain.sum(axis=0) > 0, value, np.nan)
    return result


def _weights(seen: Array, std: Array | None) -> Array:
    """Weights of the mean of means, shape (samples, windows, lasers), summing to one."""
    inside = seen if std is None else seen / np.where(seen > 0, std, 1.0) ** 2
    count = inside.sum(axis=1, keepdims=True)
    inside = inside / np.where(count > 0, count, 1.0)
    outside = (count > 0).astype(float) if std is None else count
    total = outside.sum(axis=0, keepdims=True)
    return np.asarray(inside * outside / np.where(total > 0, total, 1.0))


def _scatter(value: Array, seen: Array) -> Array:
    """Standard deviation between samples (or windows of the only one)."""
    count = seen.sum(axis=1)
    each = (seen * value).sum(axis=1) / np.maximum(count, 1.0)
    present = count > 0
    if len(value) == 1:
        each, present = value[0], seen[0] > 0
    n = present.sum(axis=0)
    centre = (present * each).sum(axis=0) / np.maximum(n, 1)
    square = (present * (each - centre) ** 2).sum(axis=0)
    return np.where(n > 1, np.sqrt(square / np.maximum(n - 1, 1)), np.nan)


def _root_mean_square(std: Array, seen: Array) -> Array:
    count = seen.sum(axis=(0, 1))
    square = np.where(seen > 0, std**2, 0.0).sum(axis=(0, 1))
    return np.where(count > 0, np.sqrt(square / np.maximum(count, 1.0)), np.nan)


def scatter_table(
    plain: Mapping[str, Average], weighted: Mapping[str, Average], units: Mapping[str, str]
) -> dict[str, list[object]]:
    """Columns that set both means, what is stated and what is seen beside each other.

    One row per parameter and laser; values in the unit of the parameter.
    """
    columns: dict[str, list[object]] = {
        name: []
        for name in (
            "parameter", "unit", "laser_id", "plain_mean", "weighted_mean", "plain_std",
            "weighted_std", "stated_std", "scatter",
        )
    }  # fmt: skip
    for name, one in plain.items():
        other, n = weighted[name], len(one.mean)
        columns["parameter"] += [name] * n
        columns["unit"] += [units[name]] * n
        columns["laser_id"] += list(range(n))
        columns["plain_mean"] += one.mean.tolist()
        columns["weighted_mean"] += other.mean.tolist()
        columns["plain_std"] += one.std.tolist()
        columns["weighted_std"] += other.std.tolist()
        columns["stated_std"] += one.stated.tolist()
        columns["scatter"] += one.scatter.tolist()
    return columns
