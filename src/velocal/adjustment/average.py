"""Mean of several calibrations of one scanner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import ADJUSTABLE_UNITS
from velocal.adjustment.result import CalibrationSet
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.scanner.parameters import PARAMETERS

Weighting = Literal["equal", "covariance"]


@dataclass(frozen=True)
class Member:
    """One of the calibrations that are averaged.

    Attributes
    ----------
    sample : str
        Sample that it was adjusted on. Members of one sample are its windows.
    position : str
        Position of the scanner. Noise averages out over positions only: within one position it is
        mostly a pattern along the azimuth that repeats in every recording.
    calibration : CalibrationSet
        Its result.
    """

    sample: str
    position: str
    calibration: CalibrationSet


def average(
    members: Sequence[Member | CalibrationSet], weighting: Weighting = "equal"
) -> CalibrationSet:
    """Mean over the windows of every sample, then over the samples.

    Parameters
    ----------
    members : sequence of Member or CalibrationSet
        Adjustments of the same parameters with the same initial values. One that did not observe
        a laser is left out of the mean of that laser. Those without a sample and a position are
        taken as windows of one sample.
    weighting : {"equal", "covariance"}
        The plain mean, as the paper forms it, or weights by inverse variance.

    Returns
    -------
    CalibrationSet
        Corrections are zero, and the covariance is NaN, for a laser that no member observed. Its
        sources are ``common`` and, for every position, ``noise at`` it. Common to all members is
        everything but noise (pose, planes, prior, repeatability), with the mean correlation of
        two parameters. Without sources if a member has none.

    Raises
    ------
    VelocalError
        If there are no members, or they do not belong together, or weights by inverse variance
        are asked for and a member has no covariance.

    Examples
    --------
    >>> recording = velocal.open_recording("capture.bin", scanner="HDL-32E")
    >>> station = velocal.read_station("station.json")
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> windows = [recording.medians(each, length=3, min_count=1) for each in ("beginning", "end")]
    >>> found = velocal.average([velocal.calibrate(each, station, factory) for each in windows])
    >>> sorted(found.sources)
    ['common', 'noise at ']
    """
    named = [
        each if isinstance(each, Member) else Member(sample="", position="", calibration=each)
        for each in members
    ]
    stack = _Stack(named)
    first = named[0].calibration
    weight = stack.weights(weighting)
    corrections = (weight * stack.value).sum(axis=0)
    observed = np.asarray(stack.seen.any(axis=0).ravel())
    sources: dict[str, Array] = {}
    if stack.known:
        sources["common"] = stack.common(weight)
        for position in np.unique(stack.position):
            own = stack.position == position
            sources[f"noise at {position}"] = stack.noise_at(own, weight)
        for part in sources.values():
            part[~observed] = np.nan
    return CalibrationSet(first.names, first.initial, corrections, observed, sources)


def scatter_columns(members: Sequence[Member]) -> dict[str, list[Any]]:
    """Columns that set both means, what is stated and what is seen beside each other.

    Parameters
    ----------
    members : sequence of Member
        With their covariances; see `average`.

    Returns
    -------
    dict of str to list
        One row per parameter and laser, in the unit of the parameter. ``stated_std`` is the root
        mean square of the standard deviations of the members; ``scatter`` is the standard
        deviation between the samples, or between the windows where there is only one sample (NaN
        with fewer than two).
    """
    stack = _Stack(members)
    plain, weighted = average(members), average(members, "covariance")
    names, n = plain.names, len(plain)
    columns: dict[str, list[Any]] = {
        "parameter": [name for name in names for _ in range(n)],
        "unit": [ADJUSTABLE_UNITS[name] for name in names for _ in range(n)],
        "laser_id": list(range(n)) * len(names),
    }
    tables = {
        "plain_mean": plain.corrections,
        "weighted_mean": weighted.corrections,
        "plain_std": plain.std,
        "weighted_std": weighted.std,
        "stated_std": stack.stated_std(),
        "scatter": stack.scatter(),
    }
    return columns | {name: table.T.ravel().tolist() for name, table in tables.items()}


class _Stack:
    """Arrays of all members together.

    Attributes
    ----------
    sample : ndarray of int, shape (members,)
        Number of the sample of every member.
    position : ndarray of str, shape (members,)
        Position of every member.
    value : ndarray, shape (members, lasers, u)
        Corrections.
    seen : ndarray, shape (members, lasers, 1)
        One where a member has observed the laser, else zero.
    known : bool
        Whether every member has its covariance.
    covariance, noise : ndarray, shape (members, lasers, u, u)
        Covariance, and its part from noise.
    """

    def __init__(self, members: Sequence[Member]) -> None:
        _check(members)
        sets = [member.calibration for member in members]
        samples = list(dict.fromkeys(member.sample for member in members))
        self.sample = np.array([samples.index(member.sample) for member in members])
        self.position = np.array([member.position for member in members])
        self.value = np.array([one.corrections for one in sets])
        self.seen = np.array([one.observed for one in sets], dtype=float)[:, :, None]
        self.known = all("noise" in one.sources for one in sets)
        if self.known:
            self.covariance = np.array([one.covariance for one in sets])
            self.noise = np.array([one.sources["noise"] for one in sets])
            self.std = np.array([one.std for one in sets])
            self.noise_std = np.array([one.noise_std for one in sets])
            self.rest_std = np.sqrt(np.maximum(self.std**2 - self.noise_std**2, 0.0))

    def weights(self, weighting: Weighting) -> Array:
        """Weights of the mean of means, shape (members, lasers, 1 or u); their sum is one."""
        inside = self.seen
        if weighting == "covariance":
            if not self.known:
                raise VelocalError(
                    "a member has no covariance to weight it by",
                    where="mean of calibrations",
                    allowed="equal weights, or members with covariances",
                )
            inside = self.seen / np.where(self.seen > 0, self.std, 1.0) ** 2
        count = self._by_sample(inside)
        outside = (count > 0).astype(float) if weighting == "equal" else count
        inside = inside / np.where(count > 0, count, 1.0)[self.sample]
        total = outside.sum(axis=0)
        return np.asarray(inside * outside[self.sample] / np.where(total > 0, total, 1.0))

    def common(self, weight: Array) -> Array:
        """Covariance of the mean from what is common to all members, shape (lasers, u, u)."""
        every = np.ones(len(self.sample), dtype=bool)
        return _of_mean(self.covariance - self.noise, self.rest_std, weight, self.seen, every)

    def noise_at(self, own: NDArray[np.bool_], weight: Array) -> Array:
        """Covariance of the mean from noise at one position, shape (lasers, u, u)."""
        return _of_mean(self.noise, self.noise_std, weight, self.seen, own)

    def scatter(self) -> Array:
        """Standard deviation between samples, or windows of the only one, shape (lasers, u)."""
        count = self._by_sample(self.seen)
        each = self._by_sample(self.seen * self.value) / np.maximum(count, 1.0)
        present = count > 0
        if len(count) == 1:
            each, present = self.value, self.seen > 0
        n = present.sum(axis=0)
        centre = (present * each).sum(axis=0) / np.maximum(n, 1)
        square = (present * (each - centre) ** 2).sum(axis=0)
        return np.where(n > 1, np.sqrt(square / np.maximum(n - 1, 1)), np.nan)

    def stated_std(self) -> Array:
        """Root mean square of the standard deviations of the members, shape (lasers, u)."""
        count = self.seen.sum(axis=0)
        square = np.where(self.seen > 0, self.std**2, 0.0).sum(axis=0)
        return np.where(count > 0, np.sqrt(square / np.maximum(count, 1.0)), np.nan)

    def _by_sample(self, values: Array) -> Array:
        """Sums over the members of every sample."""
        sums = np.zeros((self.sample.max() + 1, *values.shape[1:]))
        np.add.at(sums, self.sample, values)
        return sums


def _check(members: Sequence[Member]) -> None:
    """Refuse members that do not belong together."""
    if not members:
        raise VelocalError("there is no calibration to average", where="mean of calibrations")
    first = members[0].calibration
    for member in members:
        one = member.calibration
        alike = one.names == first.names and all(
            np.array_equal(getattr(one.initial, name), getattr(first.initial, name))
            for name in PARAMETERS
        )
        if not alike:
            raise VelocalError(
                f"{member.sample} has other parameters or initial values than {members[0].sample}",
                where="mean of calibrations",
                allowed="adjustments of the same parameters that start at the same values",
            )


def _of_mean(
    covariance: Array, std: Array, weight: Array, seen: Array, own: NDArray[np.bool_]
) -> Array:
    """Covariance of a weighted sum of errors that its terms share, shape (lasers, u, u).

    Two parameters are correlated as in the mean of the terms.

    Parameters
    ----------
    covariance : ndarray, shape (members, lasers, u, u)
        Of every term.
    std : ndarray, shape (members, lasers, u)
        Its standard deviations.
    weight, seen : ndarray, shape (members, lasers, 1 or u)
        Weight of every term, and whether it counts.
    own : ndarray of bool, shape (members,)
        Terms of the sum.
    """
    total = (weight * std)[own].sum(axis=0)
    size = std[own][..., :, None] * std[own][..., None, :] * seen[own][..., None]
    zero = np.zeros_like(size)
    correlation = np.clip(np.divide(covariance[own], size, where=size > 0, out=zero), -1.0, 1.0)
    mean = correlation.sum(axis=0) / np.maximum(seen[own].sum(axis=0)[..., None], 1.0)
    found = mean * total[..., :, None] * total[..., None, :]
    diagonal = np.arange(total.shape[-1])
    found[:, diagonal, diagonal] = total**2
    return np.asarray(found)
