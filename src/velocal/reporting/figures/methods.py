"""Comparison of the methods of adjustment: table, verdict and figure. Formatting only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from velocal.evaluation.methods import DEFAULT, PRINTED
from velocal.io.markup import markdown_table
from velocal.paper.tables import SIMULATED
from velocal.reporting.style import AFTER, BEFORE, CONNECTION, GREY, finish, style

#: Columns of the table for people, by column of the numbers, with their decimals.
_HEADINGS: Mapping[str, tuple[str, int | None]] = {
    "name": ("Method", None),
    "reference": ("After", None),
    "planes": ("Planes", None),
    "parameters": ("Parameters", None),
    "calibration_walls_rms_cm": ("Calibration, walls [cm]", 2),
    "other_walls_rms_cm": ("Other position, walls [cm]", 2),
    "calibration_rms_cm": ("Calibration, all [cm]", 2),
    "other_rms_cm": ("Other position, all [cm]", 2),
    "calibration_within_1sigma_pct": ("Calibration within 1σ [%]", 1),
    "other_within_1sigma_pct": ("Other within 1σ [%]", 1),
    "dl_error_cm": ("Error of dl [cm]", 2),
    "alpha_error_deg": ("Error of alpha [deg]", 3),
    "v_error_deg": ("Error of v [deg]", 3),
    "v_far_off": ("Lasers with v off by > 1 deg", 0),
    "unconverged": ("Lasers not converged", 0),
}
#: How many of the columns, the first ones, hold text.
TEXTS = sum(decimals is None for _, decimals in _HEADINGS.values())
#: Numbers that are marked where the method was adjusted on the other position too.
_OTHER = ("other_walls_rms_cm", "other_rms_cm", "other_within_1sigma_pct")

_NOTE = (
    "Standard deviations are means over the lasers of the root mean square of s about zero, means "
    "of all windows, on the planes that are named: all methods are judged on the same medians. "
    "*: the method was adjusted on that position too."
)
_NOTE_ERRORS = (
    " Errors are root mean squares over the lasers against the truth of the simulated scanner."
)
#: Standard deviations beyond this many times their median are written, not drawn.
_FAR = 4.0
#: Panels of the figure: title, axis label, columns and whether the axis is logarithmic.
_PANELS = (
    ("std of s, walls", "cm", ("calibration_walls_rms_cm", "other_walls_rms_cm"), False),
    ("std of s, all planes", "cm", ("calibration_rms_cm", "other_rms_cm"), False),
    ("error of dl", "cm", ("dl_error_cm",), True),
    ("error of alpha", "deg", ("alpha_error_deg",), True),
    ("error of v", "deg", ("v_error_deg",), True),
)


def rows(numbers: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Headings and entries as they print; columns that the numbers lack are left out."""
    shown = {name: head for name, head in _HEADINGS.items() if name in numbers}
    cells = [
        [_cell(row, name, decimals) for name, (_, decimals) in shown.items()]
        for row in numbers.to_dict(orient="records")
    ]
    return [heading for heading, _ in shown.values()], cells


def _cell(row: Mapping[Any, Any], name: str, decimals: int | None) -> str:
    value = row[name]
    if decimals is None:
        return "" if pd.isna(value) else str(value)
    if pd.isna(value):
        return "–"
    mark = "*" if name in _OTHER and row["other_seen"] else ""
    return f"{value:.{decimals if abs(value) < 100 else 0}f}{mark}"


def verdict(numbers: pd.DataFrame) -> list[str]:
    """What the default gives against the paper's method as printed, in sentences."""
    by_method = {str(row["method"]): row for row in numbers.to_dict(orient="records")}
    if not {DEFAULT, PRINTED} <= set(by_method):
        return []
    ours, paper = by_method[DEFAULT], by_method[PRINTED]
    calibration, other = (
        100.0 * (float(ours[column]) / float(paper[column]) - 1.0)
        for column in ("calibration_walls_rms_cm", "other_walls_rms_cm")
    )
    sentences = [
        f"On the walls, which is what the paper looks at, the default gives {other:+.1f} % on the "
        "position that neither saw, against the paper's method as printed: it is "
        + ("better there." if other < 0 else "NOT better there.")
        + f" On the calibration data it gives {calibration:+.1f} %. Residuals of the data that a "
        "method was adjusted on say nothing of it: the true parameters leave larger ones."
    ]
    if "v_error_deg" in paper:
        sentences.append(
            f"The paper's method leaves v wrong by {paper['v_error_deg']:.2f} deg and alpha by "
            f"{paper['alpha_error_deg']:.2f} deg (default: {ours['v_error_deg']:.2f} and "
            f"{ours['alpha_error_deg']:.2f} deg); {int(paper['v_far_off'])} lasers are off by "
            f"more than 1 deg in v (default: {int(ours['v_far_off'])})."
        )
    return sentences


def _note(numbers: pd.DataFrame) -> str:
    return _NOTE + (_NOTE_ERRORS if "v_error_deg" in numbers else "")


def markdown(numbers: pd.DataFrame, scanner: str, *, simulated: bool) -> str:
    """Comparison as Markdown.

    Parameters
    ----------
    numbers : DataFrame
        Rows of `methods.evaluate`.
    scanner : str
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    str
    """
    headings, cells = rows(numbers)
    table = markdown_table(headings, cells, [place >= TEXTS for place in range(len(headings))])
    lines = [f"**Methods of adjustment, {scanner}.**", "", *table]
    lines += ["", *verdict(numbers), "", _note(numbers)]
    if simulated:
        lines += ["", SIMULATED]
    return "\n".join(lines) + "\n"


def draw(numbers: pd.DataFrame, scanner: str, *, simulated: bool) -> Figure:
    """Draw a dot per method and quantity.

    Parameters
    ----------
    numbers : DataFrame
        Rows of `methods.evaluate`.
    scanner : str
        For the title.
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    panels = [panel for panel in _PANELS if set(panel[2]) <= set(numbers)]
    with style():
        figure = Figure(figsize=(max(2.3 + 1.5 * len(panels), 7.0), 1.35 + 0.235 * len(numbers)))
        all_axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for ax, (title, unit, columns, logarithmic) in zip(all_axes, panels, strict=True):
            _dots(ax, numbers, columns, logarithmic=logarithmic)
            ax.set_title(title, fontsize=8.5)
            ax.set_xlabel(f"[{unit}], logarithmic" if logarithmic else f"[{unit}]")
        first = all_axes[0]
        first.set_yticks(range(len(numbers)), [str(name) for name in numbers["name"]])
        for label, method in zip(first.get_yticklabels(), numbers["method"], strict=True):
            if method in (DEFAULT, PRINTED):
                label.set_fontweight("bold")
        first.set_ylim(len(numbers) - 0.5, -0.5)
        what = "residuals and errors of the parameters"
        title = f"{scanner}: methods of adjustment, " + (
            what if len(panels) == len(_PANELS) else "residuals"
        )
        finish(figure, [first], title, simulated=simulated, ncols=3)
    return figure


def _dots(ax: Axes, numbers: pd.DataFrame, columns: Sequence[str], *, logarithmic: bool) -> None:
    y = np.arange(len(numbers))
    values = numbers[list(columns)].to_numpy(dtype=float)
    if logarithmic:
        ax.set_xscale("log")
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        ax.set_xlim(low / 1.35, high * 1.35)
        few = high / low < 20
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
    else:
        limit = _FAR * float(np.nanmedian(values))
        for number in np.flatnonzero((values > limit).any(axis=1)):
            text = " / ".join(f"{value:.0f}" for value in values[number])
            ax.text(
                0.99, y[number], f"{text} ▸", transform=ax.get_yaxis_transform(), ha="right",
                va="center", fontsize=7.0, color=GREY,
            )  # fmt: skip
        values = np.where((values > limit).any(axis=1, keepdims=True), np.nan, values)
        ax.set_xlim(0.0, 1.08 * float(np.nanmax(values)))
    ax.grid(visible=True, axis="both")
    ax.tick_params(axis="y", length=0)
    if len(columns) == 1:
        ax.plot(values[:, 0], y, "o", color="black", markersize=4.2, clip_on=False, zorder=3)
        return
    seen = numbers["other_seen"].to_numpy(dtype=bool)
    ax.hlines(y, values.min(axis=1), values.max(axis=1), color=CONNECTION, linewidth=1.0)
    ax.plot(
        values[:, 0], y, "o", color=AFTER, markersize=4.2, clip_on=False, zorder=4,
        label="calibration data",
    )  # fmt: skip
    for chosen, marker, label in (
        (~seen, "o", "other position, unseen"),
        (seen, "D", "other position, adjusted on it too"),
    ):
        ax.plot(
            values[chosen, 1], y[chosen], marker, color=BEFORE, markerfacecolor="white",
            markersize=4.8 if marker == "o" else 4.2, markeredgewidth=1.1, clip_on=False,
            zorder=3, label=label,
        )  # fmt: skip


def section(numbers: pd.DataFrame | None) -> dict[str, Any] | None:
    """What a report shows of the comparison; None without."""
    if numbers is None or numbers.empty:
        return None
    headings, cells = rows(numbers)
    return {
        "headings": headings,
        "texts": TEXTS,
        "rows": cells,
        "verdict": verdict(numbers),
        "note": _note(numbers),
    }
