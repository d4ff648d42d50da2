"""Stability of a unit: whether it measures the same distances at several times.

Windows of one recording see the same planes at the same angles: their differences are free of all
that stays (`velocal.evaluation.drift`). A movement of the scanner is adjusted too, and the scatter
gives the standard deviation. Recordings at other places see other planes: the distances of every
recording are adjusted anew, with its own planes and what is known of the angles, and the adjustment
gives the covariance.

A change has two parts: the mean over the lasers, and what every laser changes relative to it.
Without a survey, two recordings hardly show the first, because planes shift with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, stdtrit

from velocal.adjustment.observations import Observations
from velocal.adjustment.unit.result import NAMES, UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import UnitStation
from velocal.arrays import Array
from velocal.evaluation.drift import MIN_BLOCKS, Blocks, block_means, temperature_table
from velocal.evaluation.holdout import LEVEL
from velocal.evaluation.planes_in_data import FieldPlane
from velocal.scanner.parameters import LaserParameters

#: Columns of the table of `tabulate`.
COLUMNS = (
    "compared", "recording", "window", "temperature_deg_c", "part", "laser_id", "change_cm",
    "std_cm", "low_cm", "high_cm", "p",
)  # fmt: skip
#: A change is called significant if it would occur by chance with less than this probability.
SIGNIFICANT = 1.0 - LEVEL
#: A recording is divided into this number of windows at most, of this number of rotations at least.
MAX_PARTS, MIN_ROTATIONS = 6, 5
#: Prior standard deviation of the change of a distance: nothing is known.
_FREE_M = 0.05
#: Prior standard deviations of a movement between windows: rotation (rad) and translation (m).
_MOVED = np.array(3 * [0.01] + 3 * [0.01])
#: A block is disturbed if a window differs by this number of times what blocks usually do; passes
#: in which they are found.
_FAR_OFF, _ROBUST_PASSES = 5.0, 30
#: Passes in which the noise of the lasers is estimated.
_PASSES = 4
#: The shift of a laser at a station, as a size that is not zero: it is what is looked for here.
_NO_SHIFT_M = 1e-6


@dataclass(frozen=True)
class Changes:
    """Changes of distances against their mean over some times, and tests whether there are any.

    Attributes
    ----------
    common_m, common_std_m : ndarray, shape (times,)
        Mean over the lasers, and its standard deviation; positive where the distances are measured
        longer than on average.
    common_half_m : ndarray, shape (times,)
        Half of the interval with the confidence `holdout.LEVEL`.
    common_p : float
        Probability that a common change of this size occurs by chance.
    single_m, single_std_m, single_half_m : ndarray, shape (times, lasers)
        The same of every laser relative to that mean; NaN for a laser that is not seen at all
        times.
    single_p : ndarray, shape (lasers,)
        The same of the changes of one laser over all times.
    lasers_p : float
        The same of the changes of all lasers relative to their mean together.
    movement : ndarray, shape (times, 6), or None
        Rotation vector and translation of the scanner between the windows of a recording.
    disturbed : float
        Share of the blocks of angles that are left out, because something stood before the plane
        in one of the windows.
    """

    common_m: Array
    common_std_m: Array
    common_half_m: Array
    common_p: float
    single_m: Array
    single_std_m: Array
    single_half_m: Array
    single_p: Array
    lasers_p: float
    movement: Array | None = None
    disturbed: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether lasers have changed relative to each other, or all together.

        Each of both tests has half of `SIGNIFICANT`.
        """
        return bool(min(self.common_p, self.lasers_p) < 0.5 * SIGNIFICANT)


def between_windows(windows: Sequence[Observations], parameters: LaserParameters) -> Changes | None:
    """Compare windows of one recording.

    Parameters
    ----------
    windows : sequence of Observations
        Medians on planes, which have the same numbers in all windows.
    parameters : LaserParameters
        Any calibration near the truth.

    Returns
    -------
    Changes or None
        None if there are fewer than two windows, or fewer than two lasers that all of them see.

    Notes
    -----
    A scanner that moves by millimetres while it records changes all distances. A movement between
    the windows is therefore adjusted together with the changes of the lasers. Planes in few
    directions do not tell it from a common change, whose standard deviation is then large.

    A laser is tested by the ratio of its changes to the scatter of its blocks of angles (F
    distribution); the probabilities of the lasers are joined by Fisher's method. The mean over the
    lasers is tested against what blocks and lasers scatter.
    """
    if len(windows) < 2 or not all(len(each.phi) for each in windows):
        return None
    found = block_means(windows, parameters)
    y = found.mean - found.mean.mean(axis=0)
    undisturbed, usual = _undisturbed(y, found)
    blocks = np.bincount(found.laser[undisturbed], minlength=found.lasers)
    seen = np.flatnonzero(blocks >= MIN_BLOCKS)
    times, lasers = len(windows), len(seen)
    if lasers < 2:
        return None
    use = undisturbed & np.isin(found.laser, seen)
    of, weight, blocks = np.searchsorted(seen, found.laser[use]), found.weight[use], blocks[seen]
    columns = np.concatenate([found.movement[use], np.eye(lasers)[of]], axis=1)
    free = times - 1.0
    dof = free * (blocks - 1.0)
    # Variance of a block of one window with the weight 1, by laser.
    variance = np.full(lasers, usual**2)
    for _ in range(_PASSES):
        solved, whole = _solve(y[:, use], columns, weight / variance[of])
        square = (weight * (y[:, use] - solved @ columns.T) ** 2).sum(axis=0)
        variance = np.maximum(np.bincount(of, square, lasers) / dof, np.finfo(float).tiny)
    change, covariance = solved[:, 6:], whole[6:, 6:]
    common = change.mean(axis=1)
    apart = np.eye(lasers) - 1.0 / lasers
    single = change @ apart
    own = np.diag(apart @ covariance @ apart)
    single_p = fdtrc(free, dof, (single**2).sum(axis=0) / free / own)
    # Lasers that change each on their own have a mean that is not zero; and what is not modelled
    # at a place (a wall that moves a little) is common to the lasers.
    scatter = (single**2).sum() / (free * (lasers - 1.0)) / lasers
    influence = (weight / variance[of])[:, None] * columns @ whole[:, 6:].mean(axis=1)
    rest = y[:, use] - solved @ columns.T
    places, group = np.unique(found.place[use], return_inverse=True)
    at_place = np.array([np.bincount(group, influence * each) for each in rest])
    free_places = max(len(places) - 7.0, 1.0)
    together = (at_place**2).sum() / free * len(places) / free_places
    common_variance = max(float(covariance.mean()), float(scatter), float(together))
    common_dof = free * min(lasers - 1.0, free_places)
    common_p = fdtrc(free, common_dof, (common**2).sum() / free / common_variance)
    fisher = -2.0 * np.log(np.maximum(single_p, 1e-300)).sum()
    # The difference to the mean of all windows lacks its part of that mean.
    share = free / times
    common_std = np.full(times, np.sqrt(common_variance * share))
    single_std = np.sqrt(share * np.broadcast_to(own, single.shape))
    return _changes(
        seen,
        len(parameters),
        (np.asarray(common), common_std, np.full(times, common_dof), float(common_p)),
        (np.asarray(single), single_std, np.asarray(dof), np.asarray(single_p)),
        float(chdtrc(2.0 * lasers, fisher)),
        np.asarray(solved[:, :6]),
        1.0 - float(np.mean(undisturbed)),
    )


def between_recordings(
    stations: Sequence[UnitStation], unit: UnitCalibration, settings: UnitSettings
) -> Changes | None:
    """Compare recordings of one unit at several places.

    Parameters
    ----------
    stations : sequence of UnitStation
        One for each recording: `velocal.evaluation.unsurveyed.unit_station_of`, or surveyed ones.
    unit : UnitCalibration
        Adjusted on all of them.
    settings : UnitSettings
        As for that.

    Returns
    -------
    Changes or None
        None if there are fewer than two recordings, or fewer than two lasers that all of them see.

    Notes
    -----
    Each recording gets its own dl about the values of `unit`. The errors that alpha and v still
    have, and those of voff, hoff and range scale, are unknowns with their standard deviations;
    that they are the same in all recordings is not used, so that the intervals are rather too
    wide where the recordings are alike. The changes of the lasers relative to their mean are
    tested by their chi-square.
    """
    if len(stations) < 2:
        return None
    # Here: it needs scipy.linalg, and windows of one position are compared without it.
    from velocal.adjustment.unit.adjust import adjust_unit

    alone = [
        adjust_unit([station], unit.calibration.adjusted, _own(unit, settings))
        for station in stations
    ]
    observed = np.array([one.calibration.observed for one in alone])
    seen = np.flatnonzero(observed.all(axis=0))
    n, times = len(seen), len(stations)
    if n < 2:
        return None
    change = -np.array([one.calibration.corrections[seen, 0] for one in alone])
    ranges = np.array([one.mean_range_m[seen] for one in alone])
    covariance = np.array([_between_lasers(one, seen) for one in alone])
    if unit.far_point_m is None:
        # Every dl holds at the ranges of its recording. They are compared at the mean ones.
        size = unit.sigma("sigma_scale")
        covariance[:, np.arange(n), np.arange(n)] += (size * (ranges - ranges.mean(axis=0))) ** 2
    difference = change - change.mean(axis=0)
    own = covariance * (1.0 - 2.0 / times) + covariance.sum(axis=0) / times**2
    common, common_std = difference.mean(axis=1), np.sqrt(own.mean(axis=(1, 2)))
    apart = np.eye(n) - 1.0 / n
    single = difference @ apart
    single_std = np.sqrt(np.diagonal(apart @ own @ apart, axis1=1, axis2=2))
    # A basis of all that is no change of the mean.
    basis = np.linalg.svd(apart)[0][:, : n - 1]
    lasers_p = _same(change @ basis, basis.T @ covariance @ basis)
    common_p = _same(change.mean(axis=1)[:, None], covariance.mean(axis=(1, 2))[:, None, None])
    variance = np.diagonal(apart @ covariance @ apart, axis1=1, axis2=2)
    relative = change @ apart
    single_p = np.array([_same(relative[:, [k]], variance[:, k, None, None]) for k in range(n)])
    infinite = np.full(n, np.inf)
    return _changes(
        seen,
        len(unit.calibration),
        (common, common_std, np.full(times, np.inf), common_p),
        (single, single_std, infinite, single_p),
        lasers_p,
    )


@dataclass(frozen=True)
class BinsOnPlanes:
    """Bins of laser and azimuth of a whole recording whose medians lie on planes.

    Attributes
    ----------
    ticks, min_count : int
        Width of an azimuth bin, and the returns that a median needs.
    laser_id, azimuth_bin, plane : ndarray of int, shape (n,)
        Laser, azimuth bin and plane of the medians on planes.
    normal, offset : ndarray, shape (planes, 3), (planes,)
        Unit normals and offsets (metres) of the planes, in the scanner frame.
    """

    ticks: int
    min_count: int
    laser_id: NDArray[np.integer]
    azimuth_bin: NDArray[np.int64]
    plane: NDArray[np.integer]
    normal: Array
    offset: Array

    @classmethod
    def of(
        cls,
        medians: Mapping[str, NDArray[Any]],
        rows: NDArray[np.integer],
        plane: NDArray[np.integer],
        planes: Sequence[FieldPlane],
        *,
        ticks: int,
        min_count: int,
    ) -> BinsOnPlanes:
        """Take the bins from the medians of the whole recording.

        Parameters
        ----------
        medians : mapping
            Columns of `schemas.MEDIANS`.
        rows, plane : ndarray of int, shape (n,)
            Medians on planes, and the number of the plane of each.
        planes : sequence of FieldPlane
        ticks, min_count : int
        """
        fitted = [each.fit.plane for each in planes]
        return cls(
            ticks,
            min_count,
            medians["laser_id"][rows],
            medians["azimuth"][rows].astype(np.int64) // ticks,
            plane,
            np.stack([each.normal for each in fitted]),
            np.array([each.offset for each in fitted]),
        )

    def rows_of(
        self, medians: Mapping[str, NDArray[Any]]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Find the medians of a part of the recording that lie on these planes.

        Parameters
        ----------
        medians : mapping
            Columns of `schemas.MEDIANS`, of the part.

        Returns
        -------
        rows, plane : ndarray of int
            Medians whose laser and bin are on a plane, and its number.
        """
        part = medians["laser_id"], medians["azimuth"].astype(np.int64) // self.ticks
        whole = self.laser_id, self.azimuth_bin
        shape = [
            1 + max(int(a.max(initial=0)), int(b.max(initial=0)))
            for a, b in zip(whole, part, strict=True)
        ]
        number = np.full(shape, -1)
        number[whole] = self.plane
        found = number[part]
        rows = np.flatnonzero(found >= 0)
        return rows, found[rows]


def parts_in_time(complete: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Divide the rotations of a recording into windows of about the same length.

    Parameters
    ----------
    complete : ndarray of int
        Numbers of the complete rotations, in the order of time.

    Returns
    -------
    list of ndarray of int
        At most `MAX_PARTS`, each of `MIN_ROTATIONS` at least; empty if these are not two.
    """
    count = min(MAX_PARTS, len(complete) // MIN_ROTATIONS)
    return np.array_split(complete, count) if count > 1 else []


def tabulate(
    changes: Mapping[str, Changes], times: Mapping[str, Sequence[tuple[str, str, float]]]
) -> list[dict[str, Any]]:
    """Rows of a table of changes.

    Parameters
    ----------
    changes : mapping of str to Changes
        By what is compared: ``recordings``, or the name of the recording whose windows they are.
    times : mapping of str to sequence of (str, str, float)
        Recording, window (empty for the whole recording) and temperature in degrees Celsius (NaN
        where it is not known) of the times of every entry of `changes`.

    Returns
    -------
    list of dict
        `compared`, `recording`, `window`, `temperature_deg_c`, `part`, `laser_id`, `change_cm`,
        `std_cm`, `low_cm`, `high_cm` and `p`. Parts: ``common`` is the mean over the lasers;
        ``laser`` is one laser relative to it; ``lasers`` is the root mean square of these, with
        the probability of all together; ``per K`` is the slope of the mean by the temperature.
    """
    rows: list[dict[str, Any]] = []
    for compared, found in changes.items():
        means = []
        for number, (recording, window, warmth) in enumerate(times[compared]):
            heading: dict[str, Any] = {
                "compared": compared,
                "recording": recording,
                "window": window,
            }
            heading |= {"temperature_deg_c": warmth}
            common = found.common_m[number]
            means.append({"scanner": "", "position": compared, "temperature_deg_c": warmth,
                          "common_cm": common * 1e2})  # fmt: skip
            rows.append(heading | _row("common", None, common, found.common_std_m[number],
                                       found.common_half_m[number], found.common_p))  # fmt: skip
            single = found.single_m[number]
            seen = np.flatnonzero(np.isfinite(single))
            size = float(np.sqrt(np.mean(single[seen] ** 2)))
            expected = float(np.sqrt(np.mean(found.single_std_m[number, seen] ** 2)))
            rows.append(heading | _row("lasers", None, size, expected, np.nan, found.lasers_p))
            rows += [
                heading | _row("laser", int(k), single[k], found.single_std_m[number, k],
                               found.single_half_m[number, k], found.single_p[k])
                for k in seen
            ]  # fmt: skip
        for slope in temperature_table(pd.DataFrame(means)).itertuples():
            row: dict[str, Any] = {"compared": compared, "recording": "", "window": ""}
            row |= {"part": "per K"}
            row |= {"change_cm": slope.slope_cm_per_k, "low_cm": slope.low, "high_cm": slope.high}
            rows.append(row)
    return rows


def verdict(changes: Mapping[str, Changes]) -> str:
    """Say in a sentence for each comparison whether distances have changed.

    Parameters
    ----------
    changes : mapping of str to Changes
        As for `tabulate`.

    Returns
    -------
    str
    """
    if not changes:
        return "one recording, too short for several windows: nothing can be compared"
    said = []
    for compared, found in changes.items():
        between = "recordings" if compared == "recordings" else f"windows of {compared}"
        many = len(found.common_m)
        size = float(np.sqrt(np.nanmean(found.single_m**2))) * 1e3
        known = float(np.sqrt(np.nanmean(found.single_std_m**2))) * 1e3
        tells = "a drift is shown" if found.significant else "no drift is shown"
        said.append(
            f"{many} {between}: {tells}; lasers relative to their mean {size:.1f} mm "
            f"(by chance {known:.2f} mm, {_told(found.lasers_p)}), common up to "
            f"{np.abs(found.common_m).max() * 1e3:.1f} mm (standard deviation "
            f"{found.common_std_m.max() * 1e3:.1f} mm, {_told(found.common_p)})" + _moved(found)
        )
    return "\n".join(said)


def _solve(y: Array, columns: Array, weight: Array) -> tuple[Array, Array]:
    """Movement and changes of the lasers in every window (times, n), and their covariance."""
    by_row = weight[:, None] * columns
    normal = by_row.T @ columns
    normal[np.diag_indices(6)] += 1.0 / _MOVED**2
    # A laser without any undisturbed block stays at zero.
    empty = np.diagonal(normal) == 0.0
    normal[empty, empty] = 1.0
    covariance = np.linalg.inv(normal)
    return np.asarray(y @ by_row @ covariance), np.asarray(covariance)


def _undisturbed(y: Array, blocks: Blocks) -> tuple[NDArray[np.bool_], float]:
    """Blocks at which nothing but the scanner moved: no door, nobody who walked past.

    The number is what a block of the weight 1 usually differs by, metres.

    Movement and changes are fitted with weights that fall with the residuals, so that they follow
    the larger part of the surfaces.
    """
    columns = np.concatenate([blocks.movement, np.eye(blocks.lasers)[blocks.laser]], axis=1)
    trust = np.ones(len(blocks.laser))
    tiny = np.finfo(float).tiny
    usual = max(float(np.median(np.abs(y).max(axis=0) * np.sqrt(blocks.weight))), tiny)
    for _ in range(_ROBUST_PASSES):
        solved, _ = _solve(y, columns, blocks.weight * trust / usual**2)
        size = np.abs(y - solved @ columns.T).max(axis=0) * np.sqrt(blocks.weight)
        usual = max(float(np.median(size)), tiny)
        trust = (1.0 + (size / (2.0 * usual)) ** 2) ** -2.0
    return np.asarray(size < _FAR_OFF * usual), usual


def _told(probability: float) -> str:
    """Probability of a test for people."""
    return f"p = {probability:.2g}" if probability >= 0.001 else "p < 0.001"


def _moved(found: Changes) -> str:
    """Say by how much the scanner has moved, and what is left out."""
    if found.movement is None:
        return ""
    spread = np.ptp(found.movement, axis=0)
    turn, shift = (np.linalg.norm(each) for each in (spread[:3], spread[3:]))
    return (
        f"; the scanner moved by {shift * 1e3:.1f} mm and {np.rad2deg(turn):.3f} deg, "
        f"{found.disturbed * 100:.0f} % of the angles are left out as disturbed"
    )


def _row(
    part: str, laser_id: int | None, change: float, std: float, half: float, p: float
) -> dict[str, Any]:
    return {
        "part": part,
        "laser_id": laser_id,
        "change_cm": change * 1e2,
        "std_cm": std * 1e2,
        "low_cm": (change - half) * 1e2,
        "high_cm": (change + half) * 1e2,
        "p": p,
    }


def _own(unit: UnitCalibration, settings: UnitSettings) -> UnitSettings:
    """Settings of one recording: free distances, all else as well known as `unit` knows it."""
    seen = unit.calibration.observed
    std = np.sqrt(np.mean(unit.calibration.std[seen] ** 2, axis=0))
    prior = {name: float(std[NAMES.index(name)]) for name in NAMES if name != "dl"}
    far = unit.far_point_m is not None
    prior |= {
        "dl": _FREE_M,
        "scale": unit.sigma("sigma_far" if far else "sigma_scale"),
        "voff": unit.sigma("sigma_voff"),
        "hoff": unit.sigma("sigma_hoff"),
    }
    return replace(
        settings,
        prior=prior,
        shift_m=_NO_SHIFT_M,
        least_std={},
        hold_below=0.0,
        integration_points=1,
    )


def _between_lasers(unit: UnitCalibration, seen: NDArray[np.integer]) -> Array:
    """Covariance of the dl of some lasers, shape (n, n)."""
    shared = unit.shared[seen, 0]
    found = shared @ shared.T
    place = np.arange(len(seen))
    found[place, place] = np.maximum(unit.calibration.covariance[seen, 0, 0], found[place, place])
    return np.asarray(found)


def _same(values: Array, covariance: Array) -> float:
    """Probability that vectors (times, n) with covariances (times, n, n) differ by chance."""
    weight = np.linalg.inv(covariance)
    mean = np.linalg.solve(weight.sum(axis=0), np.einsum("tij,tj->i", weight, values))
    rest = values - mean
    square = np.einsum("ti,tij,tj->", rest, weight, rest)
    return float(chdtrc((len(values) - 1) * values.shape[1], square))


def _changes(
    seen: NDArray[np.integer],
    lasers: int,
    common: tuple[Array, Array, Array, float],
    single: tuple[Array, Array, Array, Array],
    lasers_p: float,
    movement: Array | None = None,
    disturbed: float = 0.0,
) -> Changes:
    """Put changes, standard deviations, degrees of freedom and probabilities together."""

    def half(std: Array, dof: Array) -> Array:
        return np.asarray(std * stdtrit(np.minimum(dof, 1e9), 0.5 + LEVEL / 2.0))

    def all_lasers(values: Array) -> Array:
        found = np.full((*values.shape[:-1], lasers), np.nan)
        found[..., seen] = values
        return found

    return Changes(
        common_m=common[0],
        common_std_m=common[1],
        common_half_m=half(common[1], common[2]),
        common_p=float(common[3]),
        single_m=all_lasers(single[0]),
        single_std_m=all_lasers(single[1]),
        single_half_m=all_lasers(half(single[1], single[2])),
        single_p=all_lasers(single[3]),
        lasers_p=float(lasers_p),
        movement=movement,
        disturbed=disturbed,
    )
