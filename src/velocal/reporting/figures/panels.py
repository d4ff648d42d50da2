"""Outdoor validation: standard deviation against distance, before and after, and the report's part.

All figures share one scale, so that conditions and scanners can be compared.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from velocal.paper.outdoor import before_and_after
from velocal.reporting.style import AFTER, BEFORE, CONNECTION, finish, reference, style

#: Columns of the numbers of a figure.
COLUMNS = ("sample", "distance_m", "lasers", "points", "before_cm", "after_cm", "parameter_set")


def numbers(samples: pd.DataFrame, kind: str, scanner: str) -> pd.DataFrame:
    """Numbers of a figure: samples of one kind and scanner by distance, columns `COLUMNS`.

    Parameters
    ----------
    samples : DataFrame
        As `outdoor.summarise` gives them.
    kind, scanner : str

    Returns
    -------
    DataFrame
    """
    chosen = samples[(samples["kind"] == kind) & (samples["scanner"] == scanner)]
    ordered = before_and_after(chosen, ["sample"]).sort_values(
        ["distance_m", "sample"], kind="stable"
    )
    return ordered[list(COLUMNS)].reset_index(drop=True)


def top_cm(samples: pd.DataFrame, sigma_cm: float) -> float:
    """Upper end of the one scale of all figures, out of the samples of `outdoor.summarise`."""
    shown = samples.loc[samples["shown"] != "", "rms_cm"].to_numpy(dtype=float)
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

    Returns
    -------
    Figure
    """
    distance = numbers["distance_m"].to_numpy(dtype=float)
    before, after = (numbers[name].to_numpy(dtype=float) for name in ("before_cm", "after_cm"))
    with style():
        figure = Figure(figsize=(7.0, 3.3))
        ax = figure.subplots()
        ax.vlines(
            distance, np.fmin(before, after), np.fmax(before, after), color=CONNECTION,
            linewidth=1.0,
        )  # fmt: skip
        for values, color, fill, size, label in (
            (before, BEFORE, "white", 5.4, "before (factory)"),
            (after, AFTER, AFTER, 4.4, f"after ({numbers['parameter_set'].iloc[0]})"),
        ):
            ax.plot(
                distance, values, "o", color=color, markerfacecolor=fill, markersize=size,
                markeredgewidth=1.1, clip_on=False, zorder=3,
                label=f"{label}, mean {np.mean(values):.1f} cm",
            )  # fmt: skip
            ax.axhline(float(np.mean(values)), color=color, linewidth=0.8, linestyle=(0, (1, 2)))
        reference(ax, sigma_cm, f"datasheet σ = {sigma_cm:g} cm")
        ax.set_xlim(8.0, max(37.0, float(distance.max()) + 2.0))
        ax.set_ylim(0.0, top_cm)
        ax.set_xlabel("distance of the panels [m]")
        ax.set_ylabel("standard deviation of s [cm]")
        title = (
            f"{scanner}, outdoors, {kind} conditions, {len(numbers)} samples: s about planes "
            "fitted to the panels"
        )
        finish(figure, [ax], title, simulated=simulated, ncols=3, columnspacing=1.2)
    return figure


def section(means: pd.DataFrame | None) -> list[dict[Hashable, Any]]:
    """Rows of means that a report shows; none without means."""
    if means is None or means.empty:
        return []
    return before_and_after(means, ["kind", "scanner"]).to_dict(orient="records")
