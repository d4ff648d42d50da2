"""Corrections of every laser with their 95 % intervals, and their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.evaluation.holdout import LEVEL, QUANTILE
from velocal.reporting.style import COLOURS, GREY, finish, laser_axis, style
from velocal.scanner.parameters import PARAMETERS, UNITS, LaserParameters
from velocal.study.figures import CorrectionsFigure

#: Unit for people and its size, by unit.
_SHOWN = {"m": ("cm", 1e-2), "rad": ("deg", np.pi / 180.0)}
#: How a parameter is written on an axis.
_SYMBOLS = {"dl": "dl", "alpha": "α", "v": "v", "voff": "voff", "hoff": "hoff"}
#: Distance between the marks of two sets of a laser, in lasers.
_APART = 0.24
_MARKERS = "osDPX"
#: Intervals are cut at the frame of a panel if that makes the scale finer by this factor: it spans
#: all corrections, and all but this share of the ends of the intervals on either side.
_FINER, _CUT = 1.4, 0.04


@dataclass(frozen=True)
class CorrectedSet:
    """A parameter set with what its adjustments say of it.

    Attributes
    ----------
    name : str
    parameters : LaserParameters
        Mean parameters of the set.
    std : mapping of str to ndarray, shape (lasers,)
        Their standard deviations by parameter, metres and radians; NaN for a laser that no
        adjustment of the set observed.
    weak : sequence of sequence of tuple of str
        Weakly determined parameters by adjustment of the set, and by laser.
    """

    name: str
    parameters: LaserParameters
    std: Mapping[str, Array]
    weak: Sequence[Sequence[tuple[str, ...]]]


def corrections(sets: Sequence[CorrectedSet], factory: LaserParameters) -> pd.DataFrame:
    """Numbers of the figure.

    Parameters
    ----------
    sets : sequence of CorrectedSet
    factory : LaserParameters
        What the corrections are added to.

    Returns
    -------
    DataFrame
        Columns ``parameter_set``, ``parameter``, ``unit`` (``cm`` or ``deg``), ``laser`` (counted
        from 1 as in the paper), ``laser_id``, ``correction``, ``half_width`` of the 95 % interval,
        and ``weakly_determined`` (1 where an adjustment of the set says so, whose correction is
        then at least partly that of the prior). NaN for a laser that was not observed.

    Raises
    ------
    VelocalError
        If a set has no standard deviation of any parameter.
    """
    frames = []
    for each in sets:
        adjusted = [name for name in PARAMETERS if name in each.std]
        if not adjusted:
            raise VelocalError(
                f"parameter set {each.name!r} states no standard deviation",
                where="figures",
                hint="Draw a set that the workflow has adjusted.",
            )
        for name in adjusted:
            unit, size = _SHOWN[UNITS[name]]
            std = np.asarray(each.std[name], dtype=float) / size
            value = (getattr(each.parameters, name) - getattr(factory, name)) / size
            weak = [any(name in one[laser] for one in each.weak) for laser in range(len(std))]
            frames.append(
                pd.DataFrame(
                    {
                        "parameter_set": each.name,
                        "parameter": name,
                        "unit": unit,
                        "laser": np.arange(len(std)) + 1,
                        "laser_id": np.arange(len(std)),
                        "correction": np.where(np.isfinite(std), value, np.nan),
                        # A set states standard deviations without degrees of freedom.
                        "half_width": QUANTILE * std,
                        "weakly_determined": np.array(weak, dtype=np.int64),
                    }
                )
            )
    return pd.concat(frames, ignore_index=True)


def weak_parameters(column: NDArray[Any]) -> list[tuple[str, ...]]:
    """Weakly determined parameters by laser, out of the column of a table of adjustments.

    Parameters
    ----------
    column : ndarray, shape (lasers,)
        Names with blanks between them; NaN or an empty text for none.
    """
    return [tuple(names.split()) if isinstance(names, str) else () for names in column]


def draw_corrections(
    numbers: pd.DataFrame, selection: CorrectionsFigure, *, simulated: bool
) -> Figure:
    """Draw the numbers of `corrections`, one panel per parameter.

    Parameters
    ----------
    numbers : DataFrame
    selection : CorrectionsFigure
        Entry of the configuration.
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    names = list(dict.fromkeys(numbers["parameter"]))
    sets = list(dict.fromkeys(numbers["parameter_set"]))
    with style():
        figure = Figure(figsize=(7.0, 1.0 + 2.1 * len(names)))
        axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        cut = [
            _panel(ax, numbers[numbers["parameter"] == name], sets)
            for ax, name in zip(axes, names, strict=True)
        ]
        n_lasers = int(numbers["laser"].max())
        laser_axis(axes[-1], n_lasers)
        axes[-1].set_xlabel("laser" + _unseen(numbers))
        if numbers["weakly_determined"].any():
            axes[0].plot([], [], "o", color=GREY, markerfacecolor="white", markersize=4.0,
                         label="weakly determined")  # fmt: skip
        if any(cut):
            axes[0].plot([], [], "^", color=GREY, markersize=4.2, markeredgewidth=0.0,
                         label="interval ends outside")  # fmt: skip
        title = (
            f"{selection.scanner}: corrections to the factory's parameters "
            f"with {100 * LEVEL:g} % intervals"
        )
        finish(figure, [axes[0]], title, simulated=simulated, columnspacing=1.0,
               handletextpad=0.2)  # fmt: skip
    return figure


def _panel(ax: Axes, rows: pd.DataFrame, sets: Sequence[str]) -> bool:
    """One parameter, the sets beside each other at every laser; whether an interval is cut."""
    for laser in range(2, int(rows["laser"].max()) + 1, 2):
        ax.axvspan(laser - 0.5, laser + 0.5, color="#F4F4F4", linewidth=0, zorder=0.0)
    ax.axhline(0.0, color="black", linewidth=0.7, zorder=1.0)
    low, high = _span(rows)
    ax.set_ylim(low, high)
    cut = False
    for number, name in enumerate(sets):
        own = rows[rows["parameter_set"] == name]
        x = own["laser"].to_numpy() + _APART * (number - 0.5 * (len(sets) - 1))
        y, half = own["correction"].to_numpy(), own["half_width"].to_numpy()
        weak = own["weakly_determined"].to_numpy() == 1
        colour = COLOURS[number % len(COLOURS)]
        ax.vlines(x, y - half, y + half, color=colour, linewidth=0.8, zorder=2.0)
        look: dict[str, Any] = {
            "linestyle": "none", "marker": _MARKERS[number % len(_MARKERS)], "color": colour,
            "markersize": 2.6 if len(sets) > 1 else 3.4, "markeredgewidth": 0.7,
        }  # fmt: skip
        ax.plot(x[~weak], y[~weak], label=name, zorder=3.0, **look)
        ax.plot(x[weak], y[weak], zorder=3.0, **look | {"markerfacecolor": "white"})
        for beyond, edge, marker in ((y + half > high, high, "^"), (y - half < low, low, "v")):
            if beyond.any():
                ax.plot(
                    x[beyond], np.full(int(beyond.sum()), edge), marker, color=colour,
                    markersize=4.2, markeredgewidth=0.0, clip_on=False, zorder=4.0,
                )  # fmt: skip
                cut = True
    parameter, unit = rows["parameter"].iloc[0], rows["unit"].iloc[0]
    ax.set_ylabel(f"correction of {_SYMBOLS[parameter]} [{unit}]")
    return cut


def _span(rows: pd.DataFrame) -> tuple[float, float]:
    """Limits of the vertical axis: wide intervals do not make the others too short to read."""
    seen = rows[rows["correction"].notna()]
    y, half = seen["correction"].to_numpy(), seen["half_width"].to_numpy()
    if not len(seen):
        return -1.0, 1.0
    low, high = float(np.min(y - half)), float(np.max(y + half))
    cut_low = min(float(np.quantile(y - half, _CUT)), float(np.min(y)))
    cut_high = max(float(np.quantile(y + half, 1.0 - _CUT)), float(np.max(y)))
    if high - low > _FINER * (cut_high - cut_low):
        low, high = cut_low, cut_high
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin


def _unseen(numbers: pd.DataFrame) -> str:
    """Names lasers that no set has observed."""
    seen = numbers["correction"].notna().groupby(numbers["laser"]).any()
    unseen = [str(laser) for laser, each in seen.items() if not each]
    return f" (not observed: {', '.join(unseen)})" if unseen else ""
