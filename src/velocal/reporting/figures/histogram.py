"""Histogram of the residuals of one laser before and after, and its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from velocal.errors import VelocalError
from velocal.reporting.style import AFTER, BEFORE, DASHED, GREY, finish, samples_title, style
from velocal.study.figures import HistogramFigure

#: Widths of histogram bins to choose from, cm, and about how many bins to have.
_BIN_WIDTHS_CM = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
_BINS = 70
#: A residual is far away that is more than this many times as large as 99.8 % of all.
_FAR = 1.5


def histogram(before_m: NDArray[Any], after_m: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Histogram of the residuals of one laser before and after, in the same bins.

    Parameters
    ----------
    before_m, after_m : ndarray
        Residuals s, metres.

    Returns
    -------
    dict of str to ndarray
        Columns ``from_cm``, ``to_cm``, ``before``, ``after`` (counts). Bins are symmetrical about
        zero and hold all residuals, or 99.8 % of them where the others are far away; what lies
        beyond is counted in an open bin at either end.

    Raises
    ------
    VelocalError
        If there are no residuals.
    """
    before, after = (np.asarray(s, dtype=float) * 1e2 for s in (before_m, after_m))
    if not before.size:
        raise VelocalError(
            "the laser has no residuals: it hit no plane",
            where="figures",
            hint="Choose another laser, or look at the assignment of that sample.",
        )
    size = np.abs(np.concatenate([before, after]))
    limit, largest = float(np.quantile(size, 0.998)), float(size.max())
    if largest <= _FAR * limit:
        limit = largest
    width = next((w for w in _BIN_WIDTHS_CM if 2 * limit / w <= _BINS), _BIN_WIDTHS_CM[-1])
    # One more than whole bins: a bin is open above, and a residual may lie on an edge.
    half = int(limit / width + 1e-9) + 1
    # Whole multiples, so that edges print without digits of rounding.
    edges = np.round(np.arange(-half, half + 1) * width, 6) + 0.0
    bounds = np.concatenate([[-np.inf], edges, [np.inf]])
    return {
        "from_cm": bounds[:-1],
        "to_cm": bounds[1:],
        # Bins are closed below: [from, to).
        "before": np.histogram(before, bounds)[0],
        "after": np.histogram(after, bounds)[0],
    }


def draw_histogram(
    numbers: Mapping[str, NDArray[Any]],
    selection: HistogramFigure,
    *,
    sigma_cm: float,
    simulated: bool,
) -> Figure:
    """Draw the numbers of `histogram`: two panels with the same axes.

    Parameters
    ----------
    numbers : mapping of str to ndarray
    selection : HistogramFigure
        Entry of the configuration.
    sigma_cm : float
        Standard deviation of the datasheet, dashed on both sides of zero.
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    within = np.isfinite(numbers["from_cm"]) & np.isfinite(numbers["to_cm"])
    inner = {name: values[within] for name, values in numbers.items()}
    edges = np.append(inner["from_cm"], inner["to_cm"][-1])
    with style():
        figure = Figure(figsize=(7.0, 3.0))
        axes = figure.subplots(1, 2, sharex=True, sharey=True)
        for ax, name, color, label in (
            (axes[0], "before", BEFORE, "before (factory)"),
            (axes[1], "after", AFTER, "after (adjusted)"),
        ):
            ax.stairs(inner[name], edges, fill=True, color=color, alpha=0.85, linewidth=0.0)
            ax.axvline(0.0, color="black", linewidth=0.6)
            for sign in (-1.0, 1.0):
                ax.axvline(sign * sigma_cm, color=GREY, linewidth=0.9, linestyle=DASHED)
            total = int(numbers[name].sum())
            beyond = total - int(inner[name].sum())
            note = f"{label}: {total} medians"
            if beyond:
                note += f", {beyond} of them with |s| > {edges[-1]:g} cm not drawn"
            ax.set_title(note, fontsize=7.5 if beyond else 8.5, fontweight="normal", color=color)
        axes[0].set_xlim(min(edges[0], -1.1 * sigma_cm), max(edges[-1], 1.1 * sigma_cm))
        # Few, or the last label of one panel runs into the first of the other.
        axes[0].xaxis.set_major_locator(MaxNLocator(5))
        figure.supxlabel("residual s [cm]", fontsize=8.5)
        axes[0].set_ylabel(f"medians per {edges[1] - edges[0]:g} cm")
        what = f"residuals of laser {selection.laser}, dashed: datasheet σ = {sigma_cm:g} cm"
        finish(figure, [], samples_title(selection, what), simulated=simulated)
    return figure


def residuals_of(
    tables: Sequence[Mapping[str, NDArray[Any]]], selection: HistogramFigure
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Residuals of one laser before and after, out of the windows' tables of residuals.

    Parameters
    ----------
    tables : sequence of mapping
        Columns of `schemas.RESIDUALS`, one table per window.
    selection : HistogramFigure
        Entry of the configuration; ``laser`` counts from 1 as in the paper.

    Returns
    -------
    before_m, after_m : ndarray
        Residuals with the factory's parameters, and with those of the window; metres.
    """
    laser_id = selection.laser - 1
    before, after = (
        np.concatenate([table[name][table["laser_id"] == laser_id] for table in tables])
        for name in ("before_m", "after_m")
    )
    return before, after
