"""Figures of the residuals per laser, and their numbers.

They are dumbbells: factory and calibrated value of a laser on one line, so that both share a
scale.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from velocal.errors import VelocalError
from velocal.evaluation.candidates import Role
from velocal.paper.best_set import BEFORE as FACTORY
from velocal.paper.best_set import shown_after
from velocal.reporting.style import (
    AFTER,
    BEFORE,
    CONNECTION,
    DARK,
    finish,
    laser_axis,
    reference,
    samples_title,
    style,
)
from velocal.study.figures import LaserFigure

#: Column, its axis label, and the share of a normal distribution about zero with the datasheet's
#: standard deviation (None: the standard deviation itself), by kind.
QUANTITIES = {
    "std": ("rms_cm", "standard deviation of s [cm]", None),
    "within_1sigma": ("within_1sigma_pct", "share of |s| < 1σ [%]", 68.27),
    "within_3sigma": ("within_3sigma_pct", "share of |s| < 3σ [%]", 99.73),
}
_NORMAL_LABEL = "share if σ = {:g} cm (datasheet)"
#: A panel begins at zero unless the shares of all lasers are at least this, percent.
_NEARLY_ALL_PCT = 90.0
#: Quantities of every kind of figure per laser, one panel each.
PANELS = {
    **{kind: (kind,) for kind in QUANTITIES},
    "within": ("within_1sigma", "within_3sigma"),
}
#: What a figure per laser shows, by kind.
TITLES = {
    "std": "standard deviation of s",
    "within_1sigma": "share of s within 1σ",
    "within_3sigma": "share of s within 3σ",
    "within": "share of s within 1σ and 3σ",
}


def per_laser(lasers: pd.DataFrame, summary: pd.DataFrame, selection: LaserFigure) -> pd.DataFrame:
    """Numbers of a figure per laser: samples and windows together, before and after.

    Parameters
    ----------
    lasers, summary : DataFrame
        Statistics of all lasers, and of all windows.
    selection : LaserFigure
        Entry of the configuration.

    Returns
    -------
    DataFrame
        Columns ``laser`` (counted from 1 as in the paper), ``laser_id``, ``calibration`` (before
        or after), ``role`` and ``parameter_set``, ``count`` and those of the kind; with
        ``rms_cm`` also ``worse``, 1 where it is larger after than before. Windows are
        weighted by their number of residuals: ``rms_cm`` is of all residuals of the laser, shares
        are of all of them. NaN for a laser without residuals.

    Raises
    ------
    VelocalError
        If a sample has no statistics.
    """
    scanner, data, samples = selection.scanner, selection.data, selection.samples
    after = shown_after(summary, scanner, samples, data, "figures")
    of_data = lasers[(lasers["scanner"] == scanner) & (lasers["data"] == data)]
    known = list(dict.fromkeys(of_data["sample"]))
    missing = [sample for sample in samples if sample not in known]
    if missing:
        raise VelocalError(
            f"no {data} statistics of {scanner}, sample {missing[0]!r}",
            where="figures",
            allowed=", ".join(known),
        )
    chosen = of_data[of_data["sample"].isin(samples)]
    columns = [QUANTITIES[kind][0] for kind in PANELS[selection.kind]]
    numbers = pd.concat(
        [
            _means(shown.rows(chosen), columns).assign(calibration=calibration, **shown.identity)[
                ["laser", "laser_id", "calibration", "role", "parameter_set", "count", *columns]
            ]
            for calibration, shown in (("before", FACTORY), ("after", after))
        ],
        ignore_index=True,
    )
    if "rms_cm" in columns:
        first, last = numbers["rms_cm"].to_numpy().reshape(2, -1)
        numbers["worse"] = np.concatenate([np.zeros(len(first)), last > first]).astype(np.int64)
    return numbers


def _means(rows: pd.DataFrame, columns: list[str]) -> pd.DataFrame:
    """Means of every laser over the windows, weighted by the number of residuals."""
    laser_id = rows["laser_id"].to_numpy(dtype=np.int64)
    weight = rows["count"].to_numpy(dtype=float)
    count = np.bincount(laser_id, weights=weight)
    means: dict[str, Any] = {
        "laser": np.arange(len(count)) + 1,
        "laser_id": np.arange(len(count)),
        "count": count.astype(np.int64),
    }
    for name in columns:
        power = 2 if name == "rms_cm" else 1
        values = np.where(weight > 0, rows[name].to_numpy(dtype=float), 0.0) ** power
        with np.errstate(invalid="ignore", divide="ignore"):
            means[name] = (np.bincount(laser_id, weights=weight * values) / count) ** (1 / power)
    return pd.DataFrame(means)


def draw_per_laser(
    numbers: pd.DataFrame, selection: LaserFigure, *, sigma_cm: float, simulated: bool
) -> Figure:
    """Draw the numbers of `per_laser`, one panel per quantity.

    Parameters
    ----------
    numbers : DataFrame
    selection : LaserFigure
        Entry of the configuration.
    sigma_cm : float
        Standard deviation of the datasheet, drawn as a dashed line.
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    panels = PANELS[selection.kind]
    with style():
        heights = [0.6 if _nearly_all(numbers, kind) else 1.0 for kind in panels]
        figure = Figure(figsize=(7.0, 1.1 + 2.2 * sum(heights)))
        axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[
            :, 0
        ]
        for ax, kind in zip(axes, panels, strict=True):
            _dumbbells(ax, numbers, kind, sigma_cm)
        laser_axis(axes[-1], int(numbers["laser"].max()))
        axes[-1].set_xlabel("laser" + _unseen(numbers))
        title = samples_title(selection, TITLES[selection.kind] + " per laser")
        finish(figure, [axes[0]], title, simulated=simulated)
    return figure


def _dumbbells(ax: Axes, numbers: pd.DataFrame, kind: str, sigma_cm: float) -> None:
    column, label, normal = QUANTITIES[kind]
    before = numbers[numbers["calibration"] == "before"]
    after = numbers[numbers["calibration"] == "after"]
    laser = before["laser"].to_numpy()
    low, high = before[column].to_numpy(dtype=float), after[column].to_numpy(dtype=float)
    ax.vlines(laser, np.fmin(low, high), np.fmax(low, high), color=CONNECTION, linewidth=1.0)
    ax.plot(
        laser, low, "o", color=BEFORE, markersize=4.6, markerfacecolor="white",
        markeredgewidth=1.1, label="before (factory)", clip_on=False, zorder=3,
    )  # fmt: skip
    ax.plot(
        laser, high, "o", color=AFTER, markersize=3.6, clip_on=False, zorder=4,
        label=f"after ({name_after(numbers)})",
    )  # fmt: skip
    if "worse" in numbers and after["worse"].any():
        worse = after["worse"].to_numpy() == 1
        ax.plot(
            laser[worse], high[worse], "o", color=DARK, markersize=7.0, markerfacecolor="none",
            clip_on=False, zorder=5, label=f"worse: {worse.sum()} of {len(worse)}",
        )  # fmt: skip
    if normal is None:
        level, text = sigma_cm, f"datasheet σ = {sigma_cm:g} cm"
        ax.set_ylim(0.0, 1.05 * max(float(np.nanmax([low, high])), sigma_cm))
    elif _nearly_all(numbers, kind):
        level, text = normal, _NORMAL_LABEL.format(sigma_cm)
        least = min(float(np.nanmin([low, high])), normal)
        bottom = np.floor(least - 0.5)
        ax.set_ylim(bottom, 100.0 + 0.08 * (100.0 - bottom))
        ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    else:
        level, text = normal, _NORMAL_LABEL.format(sigma_cm)
        ax.set_ylim(0.0, 104.0)
        ax.yaxis.set_major_locator(MultipleLocator(20))
    reference(ax, level, text)
    ax.set_ylabel(label.replace("share of ", "share of\n") if _nearly_all(numbers, kind) else label)


def _nearly_all(numbers: pd.DataFrame, kind: str) -> bool:
    """Whether the shares of all lasers are so large that the lower part would be empty."""
    column, _, normal = QUANTITIES[kind]
    return normal is not None and bool(
        np.nanmin(np.append(numbers[column].to_numpy(dtype=float), 100.0)) >= _NEARLY_ALL_PCT
    )


def name_after(numbers: pd.DataFrame) -> str:
    """What is shown as "after": the name of a parameter set, or "adjusted" on each window."""
    after = numbers[numbers["calibration"] == "after"].iloc[0]
    return "adjusted" if after["role"] == Role.WINDOW.value else str(after["parameter_set"])


def _unseen(numbers: pd.DataFrame) -> str:
    """Names lasers that have no residuals."""
    empty = numbers[(numbers["count"] == 0) & (numbers["calibration"] == "before")]
    if empty.empty:
        return ""
    return f" (no residuals: {', '.join(str(laser) for laser in empty['laser'])})"
