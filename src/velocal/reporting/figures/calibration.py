"""Picture and table of how far the points of two calibrations are apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from velocal.arrays import Array
from velocal.reporting.style import COLOURS, GREY, finish, style

#: Below this differences are rounding, and drawn there.
_LEAST_CM = 1e-3


def difference_table(ranges_m: Sequence[float], apart_m: Array) -> pd.DataFrame:
    """Columns per laser: the largest difference over all azimuths at each range, centimetres."""
    columns = {f"apart_{r:g}m_cm": 100.0 * row for r, row in zip(ranges_m, apart_m, strict=True)}
    return pd.DataFrame({"laser_id": np.arange(apart_m.shape[1]), **columns})


def draw_differences(
    ranges_m: Sequence[float], apart_m: Array, first: str, second: str, note: str
) -> Figure:
    """Draw the largest difference of every laser, at each range.

    Parameters
    ----------
    ranges_m : sequence of float
    apart_m : ndarray, shape (ranges, lasers)
    first, second : str
        What is compared.
    note : str
        Under which conditions.

    Returns
    -------
    Figure
    """
    with style():
        figure = Figure(figsize=(7.2, 3.4))
        ax = figure.add_subplot()
        laser = np.arange(1, apart_m.shape[1] + 1)
        shown = np.maximum(100.0 * apart_m, _LEAST_CM)
        for k, (range_m, row) in enumerate(zip(ranges_m, shown, strict=True)):
            ax.plot(
                laser,
                row,
                color=COLOURS[k % len(COLOURS)],
                marker="os^Dv<"[k % 6],
                # Equal values lie on each other: open, and smaller from range to range.
                markersize=max(7.0 - 1.3 * k, 2.0),
                markerfacecolor="none",
                linestyle="none",
                label=f"at {range_m:g} m",
            )
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter("{x:g}")
        ax.set_ylim(0.5 * shown.min(), 2.0 * shown.max())
        ax.set_xlabel("laser")
        ax.set_ylabel("largest difference, cm")
        ax.set_title(note, fontsize=7.5, fontweight="normal", color=GREY)
        finish(figure, [ax], f"{first} against {second}")
        return figure
