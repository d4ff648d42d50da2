"""Parameter sets out of several adjustments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Corrections and standard deviations by parameter, and which lasers were observed.
Part = tuple[Mapping[str, Array], Mapping[str, Array], NDArray[np.bool_]]


def average(samples: Sequence[Sequence[Part]]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Plain mean over the windows of every sample, then over the samples, as the paper does.

    Parameters
    ----------
    samples : sequence of sequence of Part
        Adjustments by sample and window. An adjustment that did not see a laser at all is left
        out of that laser's mean.

    Returns
    -------
    mean : dict of str to ndarray, shape (lasers,)
        Corrections; zero for a laser that no adjustment saw.
    std : dict of str to ndarray, shape (lasers,)
        Standard deviation of the mean, propagated from those of the adjustments as if these
        were independent; NaN where a parameter was held in one of them or never seen.
    """
    seen = np.array([[part[2] for part in windows] for windows in samples], dtype=float)
    count = seen.sum(axis=1, keepdims=True)
    # Weight of every adjustment in the mean of means.
    sampled = (count > 0).sum(axis=0, keepdims=True)
    weight = seen / np.maximum(count, 1.0) / np.maximum(sampled, 1.0)
    observed = weight.sum(axis=(0, 1)) > 0
    mean: dict[str, Array] = {}
    std: dict[str, Array] = {}
    for name in samples[0][0][0]:
        value = np.array([[part[0][name] for part in windows] for windows in samples])
        sigma = np.array([[part[1][name] for part in windows] for windows in samples])
        mean[name] = (weight * value).sum(axis=(0, 1))
        # A held parameter has no standard deviation, unless its adjustment has no weight.
        variance = np.where(weight > 0, (weight * sigma) ** 2, 0.0).sum(axis=(0, 1))
        std[name] = np.where(observed, np.sqrt(variance), np.nan)
    return mean, std
