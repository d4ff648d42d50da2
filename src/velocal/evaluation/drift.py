"""Temporal stability: how the distances of every laser change from window to window.

All windows of a position see the same surfaces at the same angles. What does not change between
them (pose, planes, flatness, the fixed pattern of a laser) is the same in all their residuals, and
the difference of two windows is free of it. After Glennie and Lichti, *Temporal stability of the
Velodyne HDL-64E S2 scanner for high accuracy scanning applications* (2011).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from velocal.adjustment.nuisance import by_pose
from velocal.adjustment.observations import Observations, joined
from velocal.adjustment.stochastic import block_numbers
from velocal.arrays import Array
from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import LaserParameters

#: Columns that say which window a row is of.
KEYS = ("scanner", "position", "sample", "window")
#: Width of a block of neighbouring angles, within which differences count as correlated.
BLOCK_RAD = np.deg2rad(5.0)
#: Fewest blocks from whose scatter a standard deviation is computed.
MIN_BLOCKS = 3


@dataclass(frozen=True)
class Drift:
    """Change of the distances of every laser against a reference window.

    Attributes
    ----------
    change_m : ndarray, shape (windows, lasers)
        Mean of the differences of s, metres; positive where distances are measured longer than in
        the reference. NaN for a laser that a window does not see
        in at least `MIN_BLOCKS` blocks.
    std_m : ndarray, shape (windows, lasers)
        Standard deviation of this mean, from the scatter of the blocks.
    blocks : ndarray of int, shape (lasers,)
        Blocks that all windows have in common.
    """

    change_m: Array
    std_m: Array
    blocks: NDArray[np.int64]


def drift(
    reference: Observations, windows: Sequence[Observations], parameters: LaserParameters
) -> Drift:
    """Compare windows of one position with a reference window of the same position.

    Parameters
    ----------
    reference : Observations
        Medians on planes.
    windows : sequence of Observations
        The same of other windows, also of other samples.
    parameters : LaserParameters
        Of the scanner; any calibration near the truth gives the same differences.

    Returns
    -------
    Drift
    """
    found = block_means([reference, *windows], parameters)
    return _drift(found, found.mean[1:] - found.mean[0])


@dataclass(frozen=True)
class Blocks:
    """Means of s in the blocks of angles that all windows see.

    Attributes
    ----------
    mean : ndarray, shape (windows, blocks)
    weight : ndarray, shape (blocks,)
        Medians of the window that has the fewest.
    laser : ndarray of int, shape (blocks,)
    lasers : int
        Of the scanner.
    place : ndarray of int, shape (blocks,)
        Plane and angles; blocks of several lasers have the same.
    movement : ndarray, shape (blocks, 6)
        Derivatives of s by rotation vector and translation of the scanner.
    """

    mean: Array
    weight: Array
    laser: NDArray[np.int64]
    lasers: int
    place: NDArray[np.int64]
    movement: Array


def block_means(windows: Sequence[Observations], parameters: LaserParameters) -> Blocks:
    """Average the misclosures of every laser, plane and block of angles, window by window.

    Parameters
    ----------
    windows : sequence of Observations
    parameters : LaserParameters

    Returns
    -------
    Blocks
    """
    data = joined(list(windows))
    planes = int(data.plane_number.max()) + 1
    block = block_numbers(data.phi, data.laser_id * planes + data.plane_number, BLOCK_RAD)
    n_blocks = int(block.max()) + 1
    laser = np.empty(n_blocks, dtype=np.int64)
    laser[block] = data.laser_id
    place = np.empty(n_blocks, dtype=np.int64)
    place[block] = block_numbers(data.phi, data.plane_number, BLOCK_RAD)
    at = data.station_number * n_blocks + block
    count = np.bincount(at, minlength=len(windows) * n_blocks).reshape(-1, n_blocks)
    s = data.misclosure(parameters)
    total = np.bincount(at, s, len(windows) * n_blocks)
    used = (count > 0).all(axis=0)
    direction, origin = laser_beams(data.phi, data.laser_id, parameters)
    towards = np.einsum("ni,ni->n", direction, data.normal)
    length = data.distance_m + parameters.dl[data.laser_id] - s
    point = origin + length[:, None] * direction
    moved = by_pose(point, data.normal, towards, np.zeros(3))
    movement = np.stack([np.bincount(block, column, n_blocks) for column in moved.T], axis=1)
    movement = movement[used] / count[:, used].sum(axis=0)[:, None]
    laser, count = laser[used], count[:, used]
    mean = total.reshape(-1, n_blocks)[:, used] / count
    # A block that a window sees only a part of counts as little as that part.
    weight = count.min(axis=0).astype(float)
    return Blocks(mean, weight, laser, len(parameters), place[used], movement)


def _drift(found: Blocks, differences: Array) -> Drift:
    """Mean of the differences of every laser, and its standard deviation from their scatter."""
    laser, weight, n_lasers = found.laser, found.weight, found.lasers
    blocks = np.bincount(laser, minlength=n_lasers)
    sums = np.bincount(laser, weight, n_lasers)
    change = np.full((len(differences), n_lasers), np.nan)
    std = np.full((len(differences), n_lasers), np.nan)
    enough = blocks >= MIN_BLOCKS
    for number, difference in enumerate(differences):
        centre = np.bincount(laser, weight * difference, n_lasers)[enough] / sums[enough]
        change[number, enough] = centre
        filled = np.zeros(n_lasers)
        filled[enough] = centre
        square = np.bincount(laser, (weight * (difference - filled[laser])) ** 2, n_lasers)
        free = blocks[enough] / (blocks[enough] - 1.0)
        std[number, enough] = np.sqrt(square[enough] * free) / sums[enough]
    return Drift(change, std, blocks)


@dataclass(frozen=True)
class Window:
    """Medians of one window.

    Attributes
    ----------
    scanner, position, sample, window : str
    temperature_deg_c : float
        Of the scanner; NaN if it is not known.
    observations : Observations
        Medians on planes.
    """

    scanner: str
    position: str
    sample: str
    window: str
    temperature_deg_c: float
    observations: Observations


def drift_table(
    windows: Sequence[Window], parameters: Mapping[str, LaserParameters]
) -> list[dict[str, Any]]:
    """Change of every laser in every window against the last window of its position.

    Parameters
    ----------
    windows : sequence of Window
        In the order of time.
    parameters : mapping of str to LaserParameters
        By scanner.

    Returns
    -------
    list of dict
        `scanner`, `position`, `sample`, `window`, `temperature_deg_c`, `laser` (counted from 1),
        `laser_id`, `change_cm` and `std_cm`.
    """
    rows = []
    for position in dict.fromkeys(each.position for each in windows):
        own = [each for each in windows if each.position == position]
        medians = [each.observations for each in own]
        found = drift(medians[-1], medians, parameters[own[0].scanner])
        for each, change, std in zip(own, found.change_m, found.std_m, strict=True):
            heading = {name: getattr(each, name) for name in (*KEYS, "temperature_deg_c")}
            rows += [
                {**heading, "laser": 1 + laser, "laser_id": laser, "change_cm": 1e2 * change[laser],
                 "std_cm": 1e2 * std[laser]}
                for laser in range(len(change))
            ]  # fmt: skip
    return rows


def summarised(table: pd.DataFrame) -> pd.DataFrame:
    """Means of the rows of `drift_table` over the lasers.

    Returns
    -------
    DataFrame
        `KEYS`, `temperature_deg_c`, number of `lasers`, ``common_cm`` (mean change of the lasers)
        and ``single_cm`` (standard deviation of the lasers about it).
    """
    return (
        table.dropna(subset="change_cm")
        .groupby([*KEYS, "temperature_deg_c"], sort=False, dropna=False)["change_cm"]
        .agg(lasers="size", common_cm="mean", single_cm="std")
        .reset_index()
    )


def temperature_table(means: pd.DataFrame) -> pd.DataFrame:
    """How the common change follows the temperature, by least squares at every position.

    Parameters
    ----------
    means : DataFrame
        As `summarised` gives it. Positions with fewer than four windows of known temperature, or
        with one temperature only, are left out.

    Returns
    -------
    DataFrame
        `scanner`, `position`, number of `windows`, ``slope_cm_per_k`` and the limits ``low`` and
        ``high`` of its 95 % interval.
    """
    rows = []
    for (scanner, position), own in means.groupby(["scanner", "position"], sort=False):
        known = own.dropna(subset="temperature_deg_c")
        warmth = known["temperature_deg_c"].to_numpy(dtype=float)
        n = len(warmth)
        if n < 4 or np.ptp(warmth) == 0.0:
            continue
        change = known["common_cm"].to_numpy(dtype=float)
        about = warmth - warmth.mean()
        slope = float(about @ change / (about @ about))
        rest = change - change.mean() - slope * about
        std = float(np.sqrt(rest @ rest / (n - 2) / (about @ about)))
        half = float(stdtrit(n - 2, 0.975)) * std
        rows.append((scanner, position, n, slope, slope - half, slope + half))
    columns = ["scanner", "position", "windows", "slope_cm_per_k", "low", "high"]
    return pd.DataFrame(rows, columns=columns)
