"""Figure of the temporal stability: change of every laser over windows, and with temperature."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from velocal.reporting.style import AFTER, COLOURS, CONNECTION, finish, style


def draw(table: pd.DataFrame, means: pd.DataFrame, *, simulated: bool) -> Figure:
    """Draw a row of panels per scanner: changes over the windows, and against temperature.

    Parameters
    ----------
    table : DataFrame
        Rows of `drift.drift_table`.
    means : DataFrame
        As `drift.summarised` gives it.
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    scanners = list(dict.fromkeys(means["scanner"]))
    with style():
        figure = Figure(figsize=(7.0, 0.7 + 2.5 * len(scanners)))
        axes = figure.subplots(len(scanners), 2, squeeze=False, width_ratios=(2, 1))
        for (left, right), scanner in zip(axes, scanners, strict=True):
            own = means[means["scanner"] == scanner]
            _windows(left, table[table["scanner"] == scanner], own)
            _temperature(right, own)
            left.set_title(scanner)
        title = "Change of measured distances against the last window of the same position"
        finish(figure, [axes[0, 0]], title, simulated=simulated)
    return figure


def _windows(ax: Axes, table: pd.DataFrame, means: pd.DataFrame) -> None:
    """Changes of all lasers, and their mean, over the windows; a break between positions."""
    names = [f"{row.sample} {row.window}" for row in means.itertuples()]
    x = np.arange(len(means))
    places = dict(zip(zip(means["sample"], means["window"], strict=True), x, strict=True))
    for first, position in enumerate(dict.fromkeys(means["position"])):
        there = table[table["position"] == position]
        wide = there.pivot_table(
            index=["sample", "window"], columns="laser_id", values="change_cm", sort=False
        )
        at = [places[key] for key in wide.index]
        lines = ax.plot(at, wide.to_numpy(), color=CONNECTION, linewidth=0.6, zorder=1)
        lines[0].set_label("one laser" if first == 0 else "_")
        common = means[means["position"] == position]["common_cm"].to_numpy()
        ax.plot(
            at, common, "o-", color=AFTER, markersize=3.6, linewidth=1.2, zorder=3,
            label="mean of all lasers" if first == 0 else "_",
        )  # fmt: skip
    ax.set_xticks(x, names, fontsize=7.0, rotation=90)
    ax.set_ylabel("change [cm]")


def _temperature(ax: Axes, means: pd.DataFrame) -> None:
    """Mean change against temperature, by position."""
    known = means.dropna(subset="temperature_deg_c")
    if known.empty:
        ax.text(0.5, 0.5, "sends no temperature", ha="center", va="center", transform=ax.transAxes)
        ax.set_axis_off()
        return
    for colour, (position, own) in zip(
        COLOURS, known.groupby("position", sort=False), strict=False
    ):
        ax.plot(
            own["temperature_deg_c"], own["common_cm"], "o", color=colour, markersize=4.0,
            label=str(position),
        )  # fmt: skip
    ax.legend()
    ax.set_xlabel("temperature of the scanner [°C]")
    ax.set_ylabel("mean change [cm]")
