"""Outdoor validation: standard deviation against distance, before and after, and the report's part.

All figures share one scale, so that conditions and scanners can be compared.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from velocal.reporting.figures.lasers import AFTER, BEFORE, GREY, style

#: Columns of the numbers of a figure.
COLUMNS = ("sample", "distance_m", "lasers", "points", "before_cm", "after_cm", "parameters")


def numbers(summary: pd.DataFrame, kind: str, scanner: str) -> pd.DataFrame:
    """Numbers of a figure: samples of one kind and scanner by distance, columns `COLUMNS`."""
    chosen = summary[(summary["kind"] == kind) & (summary["scanner"] == scanner)]
    ordered = chosen.sort_values(["distance_m", "sample"], kind="stable")
    return ordered[list(COLUMNS)].reset_index(drop=True)


def top_cm(summary: pd.DataFrame, sigma_cm: float) -> float:
    """Upper end of the one scale of all figures."""
    shown = summary[["before_cm", "after_cm"]].to_numpy(dtype=float)
    return 1.08 * max(float(np.nanmax(shown)), sigma_cm)


def draw(
    numbers: pd.DataFrame,
    kind: str,
    scanner: str,
    *,
    top_cm: float,
    sigma_cm: float,
    simulated: bool,
) -> Figure:
    """Draw the numbers: a line from before to after at the distance of every sample.

    Parameters
    ----------
    numbers : DataFrame
        As `numbers` gives them.
    kind, scanner : str
        For the title.
    top_cm : float
        Upper end of the scale.
    sigma_cm : float
        Standard deviation of the datasheet, drawn as a dashed line.
    simulated : bool
        Whether a note says that the recordings are simulated.
    """
    distance = numbers["distance_m"].to_numpy(dtype=float)
    before, after = (numbers[name].to_numpy(dtype=float) for name in ("before_cm", "after_cm"))
    with style():
        figure = Figure(figsize=(7.0, 3.3))
        ax = figure.subplots()
        ax.vlines(
            distance, np.fmin(before, after), np.fmax(before, after), color="#BDBDBD",
            linewidth=1.0,
        )  # fmt: skip
        for values, color, fill, size, label in (
            (before, BEFORE, "white", 5.4, "before (factory)"),
            (after, AFTER, AFTER, 4.4, f"after ({numbers['parameters'].iloc[0]})"),
        ):
            ax.plot(
                distance, values, "o", color=color, markerfacecolor=fill, markersize=size,
                markeredgewidth=1.1, clip_on=False, zorder=3,
                label=f"{label}, mean {np.mean(values):.1f} cm",
            )  # fmt: skip
            ax.axhline(float(np.mean(values)), color=color, linewidth=0.8, linestyle=(0, (1, 2)))
        ax.axhline(
            sigma_cm, color=GREY, linewidth=0.9, linestyle=(0, (5, 3)),
            label=f"datasheet σ = {sigma_cm:g} cm",
        )  # fmt: skip
        ax.set_xlim(8.0, max(37.0, float(distance.max()) + 2.0))
        ax.set_ylim(0.0, top_cm)
        ax.set_xlabel("distance of the panels [m]")
        ax.set_ylabel("standard deviation of s [cm]")
        figure.suptitle(
            f"{scanner}, outdoors, {kind} conditions, {len(numbers)} samples: s about planes "
            "fitted to the panels",
            x=0.01, ha="left", fontsize=9.0, fontweight="bold",
        )  # fmt: skip
        handles, labels = ax.get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower left", ncols=3, borderpad=0.1, columnspacing=1.2
        )
        if simulated:
            figure.text(
                0.995, 0.012, "simulated recordings", ha="right", va="bottom", fontsize=6.5,
                color=GREY, fontstyle="italic",
            )  # fmt: skip
    return figure


def section(means: pd.DataFrame | None, pictures: Mapping[str, bytes]) -> dict[str, Any] | None:
    """What a report shows: rows of means, and figures by number; None without."""
    if means is None or means.empty:
        return None
    return {
        "rows": means.to_dict(orient="records"),
        "figures": {
            number: base64.b64encode(png).decode("ascii") for number, png in pictures.items()
        },
    }
