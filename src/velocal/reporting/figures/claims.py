"""Figures of claims of the paper: samples with and without light, and offsets that are adjusted."""

from __future__ import annotations

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from velocal.reporting.style import AFTER, BEFORE, DARK, finish, laser_axis, style


def draw_light(differences: pd.DataFrame, *, simulated: bool) -> Figure:
    """Draw the difference of every laser with its 95 % interval, a panel per parameter.

    Parameters
    ----------
    differences : DataFrame
        As `light.differences` gives it.
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    names = list(dict.fromkeys(differences["parameter"]))
    with style():
        figure = Figure(figsize=(7.0, 0.9 + 1.7 * len(names)))
        axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for ax, name in zip(axes, names, strict=True):
            own = differences[differences["parameter"] == name]
            pairs = own.groupby(["without", "with"], sort=False)
            for (pair, rows), colour, shift in zip(
                pairs, (AFTER, BEFORE), (-0.15, 0.15), strict=True
            ):
                half = rows["high"] - rows["difference"]
                label = f"{pair[1]} - {pair[0]}"
                _intervals(ax, rows["laser"] + shift, rows["difference"], half, colour, label)
            ax.axhline(0.0, color=DARK, linewidth=0.7)
            # A few lasers of which a parameter is hardly determined would set the scale.
            wide = (own["high"] - own["difference"]).quantile(0.95)
            limit = 1.2 * max(float(wide), float(own["difference"].abs().max()))
            ax.set_ylim(-limit, limit)
            ax.set_ylabel(f"{name} [{own['unit'].iloc[0]}]")
        laser_axis(axes[-1], int(differences["laser"].max()))
        axes[-1].set_xlabel("laser")
        title = "With the halogen light minus without, 95 % intervals of noise and repeatability"
        finish(figure, [axes[0]], title, simulated=simulated)
    return figure


def draw_offsets(offsets: pd.DataFrame, *, simulated: bool) -> Figure:
    """Draw hoff of every laser with its 95 % interval, and its error against that of alpha.

    Parameters
    ----------
    offsets : DataFrame
        Tables of `offsets.table`, one below the other.
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    samples = list(dict.fromkeys(offsets["sample"]))
    known = bool(offsets["hoff_true_cm"].notna().any())
    with style():
        figure = Figure(figsize=(7.0, 0.7 + 1.25 * len(samples)))
        axes = figure.subplots(len(samples), 2, squeeze=False, width_ratios=(3, 1), sharex="col")
        for (left, right), sample in zip(axes, samples, strict=True):
            own = offsets[offsets["sample"] == sample]
            _intervals(
                left, own["laser"], own["hoff_cm"], 1.96 * own["hoff_std_cm"], AFTER,
                "adjusted, 95 % interval",
            )  # fmt: skip
            truth = own["hoff_true_cm"] if known else 0.0 * own["hoff_cm"]
            label = "truth" if known else "factory"
            left.plot(own["laser"], truth, color=BEFORE, linewidth=1.2, label=label, zorder=3)
            left.set_ylabel(f"{sample}\nhoff [cm]")
            right.plot(
                own["alpha_deg"] - own["alpha_true_deg"].fillna(0.0),
                own["hoff_cm"] - own["hoff_true_cm"].fillna(0.0),
                "o", color=AFTER, markersize=2.6,
            )  # fmt: skip
            right.grid(visible=True, axis="both")
        what = "error" if known else "correction"
        axes[-1, 0].set_xlabel("laser")
        laser_axis(axes[-1, 0], int(offsets["laser"].max()))
        axes[-1, 1].set_xlabel(f"{what} of alpha [deg]")
        axes[0, 1].set_title(f"{what} of hoff [cm]", fontsize=8.5)
        title = "Corrections of hoff, if five parameters are adjusted at one position"
        finish(figure, [axes[0, 0]], title, simulated=simulated)
    return figure


def _intervals(
    ax: Axes, x: pd.Series, y: pd.Series, half: pd.Series, colour: str, label: str
) -> None:
    """Points with vertical intervals."""
    ax.errorbar(
        x, y, yerr=half, fmt="o", color=colour, markersize=2.4, elinewidth=0.7, label=label
    )  # fmt: skip
