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
        positions; at one it is mostly a pattern along the azimuth that comes again in every
        recording. All else (pose, planes, prior, repeatability) is taken as common to all.
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
    samples: Sequence[Sequence[Corrections]],
    weighting: str = "equal",
    positions: Sequence[str] | None = None,
) -> dict[str, Average]:
    """Mean over the windows of every sample, then over the samples.

    Parameters
    ----------
    samples : sequence of sequence of Corrections
        Adjustments by sample and window. An adjustment that did not see a laser at all is left
        out of that laser's mean.
    weighting : {"equal", "covariance"}
        The plain mean, as the paper forms it, or weights by inverse variance.
    positions : sequence of str, optional
        Position of every sample; all at one if not given.

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
        variance = (weight * common).sum(axis=(0, 1)) ** 2
        for own in _by_position(len(samples), positions):
            variance += (weight * noise)[own].sum(axis=(0, 1)) ** 2
        result[name] = Average(
            mean,
            np.where(observed, np.sqrt(variance), np.nan),
            _scatter(value, seen),
            _root_mean_square(std, seen),
        )
    return result


def average_covariance(
    samples: Sequence[Sequence[Corrections]],
    weighting: str = "equal",
    positions: Sequence[str] | None = None,
) -> dict[tuple[str, str], Array]:
    """Covariances of the means that `average` forms, shape (lasers,) by pair of parameters.

    Parameters are those of `average`. What is common there is so here, with its mean
    correlation. NaN for a laser that no adjustment saw.
    """
    seen = np.array([[part.observed for part in windows] for windows in samples], dtype=float)

    def table(kind: str, key: str | tuple[str, str]) -> Array:
        return np.array([[getattr(part, kind)[key] for part in windows] for windows in samples])

    result = {}
    for pair in samples[0][0].covariance:
        noise, common = [], []
        for name in pair:
            std, noisy = table("std", name), table("noise_std", name)
            weight = _weights(seen, std if weighting == "covariance" else None)
            noise.append((noisy, weight * noisy))
            rest = np.sqrt(np.maximum(std**2 - noisy**2, 0.0))
            common.append((rest, weight * rest))
        of_noise = table("noise_covariance", pair)
        value = _common(table("covariance", pair) - of_noise, common, seen)
        for own in _by_position(len(samples), positions):
            value += _common(of_noise[own], [(n[own], w[own]) for n, w in noise], seen[own])
        result[pair] = np.where(seen.any(axis=(0, 1)), value, np.nan)
    return result


def _common(covariance: Array, of_pair: Sequence[tuple[Array, Array]], seen: Array) -> Array:
    """Covariance of two sums, of errors that their terms share, with the terms' mean correlation.

    `of_pair` holds standard deviations and weighted ones; all arrays (samples, windows, lasers).
    """
    (one, weighted), (other, otherwise) = of_pair
    size = one * other * seen
    zero = np.zeros_like(size)
    correlation = np.clip(np.divide(covariance, size, where=size > 0, out=zero), -1.0, 1.0)
    mean = correlation.sum(axis=(0, 1)) / np.maximum(seen.sum(axis=(0, 1)), 1.0)
    return np.asarray(mean * weighted.sum(axis=(0, 1)) * otherwise.sum(axis=(0, 1)))


def _by_position(count: int, positions: Sequence[str] | None) -> list[NDArray[np.bool_]]:
    """Which samples stand at each position."""
    names = np.array(positions if positions is not None else [""] * count)
    return [names == name for name in np.unique(names)]


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
