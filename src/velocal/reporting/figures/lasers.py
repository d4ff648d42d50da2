"""Figures of the residuals per laser, and their numbers.

Figures of single lasers are dumbbells: factory and calibrated value of a laser on one line, so
that both share a scale. Colours are those of Okabe and Ito; the two states differ in shape and
fill as well, for print without colour. The bytes depend on nothing but the numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator
from numpy.typing import NDArray

from velocal.errors import ConfigError, VelocalError
from velocal.evaluation.statistics import calibration_after
from velocal.io.storage import atomic

BEFORE, AFTER, GREY, DARK = "#D55E00", "#0072B2", "#6B6B6B", "#303030"
#: Okabe and Ito, without black and yellow.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")

#: Column, its axis label, and the share of a normal distribution about zero with the datasheet's
#: standard deviation (None: the standard deviation itself), by kind.
QUANTITIES = {
    "std": ("std_cm", "standard deviation of s [cm]", None),
    "within_1sigma": ("within_1sigma_pct", "share of |s| < 1σ [%]", 68.27),
    "within_3sigma": ("within_3sigma_pct", "share of |s| < 3σ [%]", 99.73),
}
#: Quantities of every kind of figure per laser, one panel each.
PANELS = {
    **{kind: (kind,) for kind in QUANTITIES},
    "within": ("within_1sigma", "within_3sigma"),
}
KINDS = (*PANELS, "histogram")

#: What a figure per laser shows, by kind.
TITLES = {
    "std": "standard deviation of s",
    "within_1sigma": "share of s within 1σ",
    "within_3sigma": "share of s within 3σ",
    "within": "share of s within 1σ and 3σ",
}

#: Widths of histogram bins to choose from, cm, and about how many bins to have.
_BIN_WIDTHS_CM = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
_BINS = 60

#: Settings of matplotlib on top of its own defaults.
STYLE: Mapping[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.minor.width": 0.4,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 300,
    "svg.hashsalt": "velocal",
    "svg.fonttype": "path",
}


@contextmanager
def style() -> Iterator[None]:
    """The one style of all figures, whatever the user's matplotlibrc says."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def save(figure: Figure, svg: Path, png: Path) -> None:
    """Write a figure as SVG and PNG without anything that changes from run to run."""
    with style():
        FigureCanvasAgg(figure)
        for path, metadata in (
            (svg, {"Date": None, "Creator": None}),
            (png, {"Software": None}),
        ):
            with atomic(path) as temporary:
                figure.savefig(temporary, format=path.suffix[1:], metadata=metadata)


def per_laser(
    lasers: pd.DataFrame, summary: pd.DataFrame, selection: Mapping[str, Any]
) -> pd.DataFrame:
    """Numbers of a figure per laser: samples and windows together, before and after.

    Parameters
    ----------
    lasers, summary : DataFrame
        Statistics of all lasers, and of all windows.
    selection : mapping
        Entry of the configuration: ``kind``, ``scanner``, ``samples``, ``data``.

    Returns
    -------
    DataFrame
        Columns ``laser`` (counted from 1 as in the paper), ``laser_id``, ``calibration``,
        ``parameters`` (``factory``, ``adjusted`` or the name of a set), ``count`` and those of
        the kind. Windows are weighted by their number of residuals: standard deviations are the
        root mean square over all residuals of the laser, shares are of all of them. NaN for a
        laser without residuals.

    Raises
    ------
    VelocalError
        If a sample has no statistics.
    """
    scanner, data = str(selection["scanner"]), str(selection["data"])
    samples = [str(sample) for sample in selection["samples"]]
    columns = {str(name): summary[name].to_numpy() for name in summary}
    after = calibration_after(columns, scanner, samples, data)
    of_data = lasers[(lasers["scanner"] == scanner) & (lasers["data"] == data)]
    known = [str(name) for name in dict.fromkeys(of_data["sample"])]
    missing = [sample for sample in samples if sample not in known]
    if missing:
        raise VelocalError(
            f"no {data} statistics of {scanner}, sample {missing[0]!r}",
            where="figures",
            allowed=", ".join(known),
        )
    chosen = of_data[of_data["sample"].astype(str).isin(samples)]
    parts = []
    for calibration, shown in (("before", "before"), ("after", after)):
        rows = chosen[chosen["calibration"] == shown]
        laser_id = rows["laser_id"].to_numpy(dtype=np.int64)
        weight = rows["count"].to_numpy(dtype=float)

        def mean(
            name: str,
            power: int = 1,
            *,
            rows: pd.DataFrame = rows,
            laser_id: NDArray[np.int64] = laser_id,
            weight: NDArray[np.float64] = weight,
        ) -> NDArray[np.float64]:
            values = np.where(weight > 0, rows[name].to_numpy(dtype=float), 0.0) ** power
            with np.errstate(invalid="ignore", divide="ignore"):
                total = np.bincount(laser_id, weights=weight * values)
                return np.asarray(total / np.bincount(laser_id, weights=weight))

        count = np.bincount(laser_id, weights=weight).astype(np.int64)
        part: dict[str, Any] = {
            "laser": np.arange(len(count)) + 1,
            "laser_id": np.arange(len(count)),
            "calibration": calibration,
            "parameters": {"before": "factory", "after": "adjusted"}.get(shown, shown),
            "count": count,
        }
        for kind in PANELS[selection["kind"]]:
            name = QUANTITIES[kind][0]
            part[name] = mean("rms_cm", 2) ** 0.5 if name == "std_cm" else mean(name)
        parts.append(pd.DataFrame(part))
    return pd.concat(parts, ignore_index=True)


def draw_per_laser(
    numbers: pd.DataFrame, selection: Mapping[str, Any], *, sigma_cm: float, simulated: bool
) -> Figure:
    """Draw the numbers of `per_laser`, one panel per quantity.

    Parameters
    ----------
    numbers : DataFrame
    selection : mapping
        Entry of the configuration.
    sigma_cm : float
        Standard deviation of the datasheet, drawn as a dashed line.
    simulated : bool
        Whether a note says that the recordings are simulated.
    """
    panels = PANELS[selection["kind"]]
    with style():
        figure = Figure(figsize=(7.0, 1.1 + 2.2 * len(panels)))
        axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for ax, kind in zip(axes, panels, strict=True):
            _dumbbells(ax, numbers, kind, sigma_cm)
        n_lasers = int(numbers["laser"].max())
        axes[-1].set_xlim(0.2, n_lasers + 0.8)
        step = 4 if n_lasers > 16 else 2 if n_lasers > 8 else 1
        axes[-1].set_xticks([1, *range(step, n_lasers + 1, step)])
        axes[-1].xaxis.set_minor_locator(MultipleLocator(1))
        axes[-1].set_xlabel("laser" + _unseen(numbers))
        title = _title(selection, TITLES[selection["kind"]] + " per laser")
        finish(figure, axes[0], title, simulated)
    return figure


def _dumbbells(ax: Axes, numbers: pd.DataFrame, kind: str, sigma_cm: float) -> None:
    column, label, normal = QUANTITIES[kind]
    before = numbers[numbers["calibration"] == "before"]
    after = numbers[numbers["calibration"] == "after"]
    laser = before["laser"].to_numpy()
    low, high = before[column].to_numpy(dtype=float), after[column].to_numpy(dtype=float)
    ax.vlines(laser, np.fmin(low, high), np.fmax(low, high), color="#BDBDBD", linewidth=1.0)
    ax.plot(
        laser, low, "o", color=BEFORE, markersize=4.6, markerfacecolor="white",
        markeredgewidth=1.1, label="before (factory)", clip_on=False, zorder=3,
    )  # fmt: skip
    ax.plot(
        laser, high, "o", color=AFTER, markersize=3.6, clip_on=False, zorder=4,
        label=f"after ({after['parameters'].iloc[0]})",
    )  # fmt: skip
    if normal is None:
        reference, text = sigma_cm, f"datasheet σ = {sigma_cm:g} cm"
        ax.set_ylim(0.0, 1.05 * max(float(np.nanmax([low, high])), sigma_cm))
    else:
        reference, text = normal, f"share if σ = {sigma_cm:g} cm (datasheet)"
        ax.set_ylim(0.0, 104.0)
        ax.yaxis.set_major_locator(MultipleLocator(20))
    ax.axhline(reference, color=GREY, linewidth=0.9, linestyle=(0, (5, 3)), label=text)
    ax.set_ylabel(label)


def _unseen(numbers: pd.DataFrame) -> str:
    """Names lasers that have no residuals."""
    empty = numbers[(numbers["count"] == 0) & (numbers["calibration"] == "before")]
    if empty.empty:
        return ""
    return f" (no residuals: {', '.join(str(laser) for laser in empty['laser'])})"


def finish(figure: Figure, ax: Axes | None, title: str, simulated: bool, **legend: Any) -> None:
    """Title above, legend of an axes below, and a note where the recordings are simulated."""
    figure.suptitle(title, x=0.01, ha="left", fontsize=9.0, fontweight="bold")
    if ax is not None:
        handles, labels = ax.get_legend_handles_labels()
        options = {"ncols": len(labels), "borderpad": 0.1, **legend}
        figure.legend(handles, labels, loc="outside lower left", **options)
    if simulated:
        figure.text(
            0.995, 0.012, "simulated recordings", ha="right", va="bottom", fontsize=7.0,
            color=GREY, fontstyle="italic",
        )  # fmt: skip


def _title(selection: Mapping[str, Any], what: str) -> str:
    samples = ", ".join(map(str, selection["samples"]))
    return f"{selection['scanner']}, {selection['data']} data ({samples}): {what}"


def histogram(before_m: NDArray[Any], after_m: NDArray[Any]) -> pd.DataFrame:
    """Histogram of the residuals of one laser before and after, in the same bins.

    Parameters
    ----------
    before_m, after_m : ndarray
        Residuals s, metres.

    Returns
    -------
    DataFrame
        Columns ``from_cm``, ``to_cm``, ``before``, ``after`` (counts). Bins are symmetrical about
        zero and hold 99.8 % of the residuals; what lies beyond is counted in an open bin at
        either end.

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
    limit = float(np.quantile(np.abs(np.concatenate([before, after])), 0.998))
    width = next((w for w in _BIN_WIDTHS_CM if 2 * limit / w <= _BINS), _BIN_WIDTHS_CM[-1])
    half = max(int(np.ceil(limit / width)), 1)
    # Whole multiples, so that edges print without digits of rounding.
    edges = np.round(np.arange(-half, half + 1) * width, 6) + 0.0
    bounds = np.concatenate([[-np.inf], edges, [np.inf]])
    return pd.DataFrame(
        {
            "from_cm": bounds[:-1],
            "to_cm": bounds[1:],
            # Bins are closed below: [from, to).
            "before": _counts(before, edges),
            "after": _counts(after, edges),
        }
    )


def _counts(s_cm: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.int64]:
    index = np.searchsorted(edges, s_cm, side="right")
    return np.bincount(index, minlength=len(edges) + 1).astype(np.int64)


def draw_histogram(
    numbers: pd.DataFrame, selection: Mapping[str, Any], *, sigma_cm: float, simulated: bool
) -> Figure:
    """Draw the numbers of `histogram`: two panels with the same axes.

    Parameters
    ----------
    numbers : DataFrame
    selection : mapping
        Entry of the configuration.
    sigma_cm : float
        Standard deviation of the datasheet, dashed on both sides of zero.
    simulated : bool
        Whether a note says that the recordings are simulated.
    """
    inner = numbers[np.isfinite(numbers["from_cm"]) & np.isfinite(numbers["to_cm"])]
    edges = np.append(inner["from_cm"].to_numpy(), inner["to_cm"].to_numpy()[-1])
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
                ax.axvline(sign * sigma_cm, color=GREY, linewidth=0.9, linestyle=(0, (5, 3)))
            beyond = int(numbers[name].sum() - inner[name].sum())
            note = f"n = {int(numbers[name].sum())}" + (f", {beyond} beyond" if beyond else "")
            ax.text(0.98, 0.97, note, transform=ax.transAxes, ha="right", va="top", fontsize=7.5)
            ax.set_title(label, fontsize=8.5, fontweight="normal", color=color)
        axes[0].set_xlim(min(edges[0], -1.1 * sigma_cm), max(edges[-1], 1.1 * sigma_cm))
        # Few, or the last label of one panel runs into the first of the other.
        axes[0].xaxis.set_major_locator(MaxNLocator(5))
        figure.supxlabel("residual s [cm]", fontsize=8.5)
        axes[0].set_ylabel(f"medians per {edges[1] - edges[0]:g} cm")
        what = f"residuals of laser {selection['laser']}, dashed: datasheet σ = {sigma_cm:g} cm"
        finish(figure, None, _title(selection, what), simulated)
    return figure


def residuals_of(
    tables: Sequence[Mapping[str, NDArray[Any]]], selection: Mapping[str, Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Residuals of one laser before and after, out of the windows' tables of residuals.

    Parameters
    ----------
    tables : sequence of mapping
        Columns of `schemas.RESIDUALS`, one table per window.
    selection : mapping
        Entry of the configuration; ``laser`` counts from 1 as in the paper.

    Raises
    ------
    ConfigError
        If no laser is given, or other data than the windows' medians are asked for.
    """
    if "laser" not in selection or selection["data"] != "calibration":
        raise ConfigError(
            f"histogram of {selection['data']} data, laser {selection.get('laser')}",
            where="figures",
            allowed="data: calibration, and a laser counted from 1",
        )
    laser_id = int(selection["laser"]) - 1
    parts = [
        [np.asarray(table[name])[table["laser_id"] == laser_id] for table in tables]
        for name in ("before_m", "after_m")
    ]
    return np.concatenate(parts[0]), np.concatenate(parts[1])
