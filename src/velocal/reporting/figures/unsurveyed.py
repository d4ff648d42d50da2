"""Recordings without a survey: picture of the planes and of each laser on them, and the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.io.markup import markdown_table
from velocal.reporting.style import COLOURS, centred, finish, laser_axis, metres, reference, style
from velocal.scanner.models import scanner_named

#: A marker for every round of the colours.
MARKERS = ("o", "s", "^", "D")

#: Columns of the table of planes, and the decimals that its Markdown shows.
TABLE: Mapping[str, int | None] = {
    "sample": None,
    "scanner": None,
    "plane": None,
    "points": 0,
    "trimmed": 0,
    "lasers": 0,
    "range_m": 1,
    "incidence_deg": 0,
    "tilt_deg": 0,
    "rms_cm": 2,
    "std_cm": 2,
    "pooled_rms_cm": 2,
    "spread_cm": 2,
    "flatness_mean_cm": 2,
    "flatness_max_cm": 1,
    "finding": None,
}
_NOTE = (
    "s is the distance along the beam to the plane. rms: mean over the lasers of the root mean "
    "square of s about zero; std: of the standard deviation of s about the mean of the "
    "laser, which offsets of the lasers do not enter; pooled_rms: of all s; spread: of single "
    "returns in an azimuth bin, where the recording has enough rotations; it contains the slope "
    "of the plane within the bin; trimmed: points left out as outliers; tilt: 0 for a level "
    "plane, 90 for an upright one."
)

#: Points off the planes that are drawn, at most.
_POINTS = 20_000


def field_planes(
    xyz: Array,
    planes: Mapping[str, NDArray[np.integer]],
    lasers: pd.DataFrame,
    facts: Mapping[str, Any],
    findings: Sequence[str],
) -> Figure:
    """Draw the plan view of the points and the standard deviation of s per laser and plane.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        Points in the scanner frame, metres.
    planes : mapping of str to ndarray of int
        Rows of the points on each plane.
    lasers : DataFrame
        Columns ``plane``, ``laser_id``, ``rms_cm``, ``std_cm``.
    facts : mapping
        ``sample``, ``scanner`` and ``calibration`` for the title; ``sigma_cm``, the standard
        deviation of the datasheet, drawn as a dashed line.
    findings : sequence of str
        Said below the title.

    Returns
    -------
    Figure
    """
    sigma_cm = float(facts["sigma_cm"])
    n_lasers = scanner_named(facts["scanner"]).n_lasers
    title = "{sample}: {scanner}, {calibration} calibration".format(**facts)
    looks = {
        name: {
            "color": COLOURS[number % len(COLOURS)],
            "marker": MARKERS[number // len(COLOURS) % len(MARKERS)],
        }
        for number, name in enumerate(planes)
    }
    with style():
        figure = Figure(figsize=(9.0, 4.6))
        grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15))
        _plan(figure.add_subplot(grid[:, 0]), xyz, planes, looks)
        above = figure.add_subplot(grid[0, 1])
        below = figure.add_subplot(grid[1, 1], sharex=above)
        _per_laser(above, lasers, looks, "rms_cm", sigma_cm)
        above.set_title("s about zero")
        above.tick_params(labelbottom=False)
        _per_laser(below, lasers, looks, "std_cm", sigma_cm)
        below.set_title("s about the mean of the laser on that plane")
        laser_axis(below, n_lasers)
        below.set_xlabel("laser")
        finish(figure, [below], "\n".join([title, *findings]), ncols=7)
    return figure


def _plan(
    ax: Axes,
    xyz: Array,
    planes: Mapping[str, NDArray[np.integer]],
    looks: Mapping[str, Mapping[str, Any]],
) -> None:
    used = np.concatenate([np.empty(0, dtype=np.int64), *planes.values()])
    others = np.ones(len(xyz), dtype=bool)
    others[used] = False
    some = np.flatnonzero(others)[:: 1 + len(xyz) // _POINTS]
    # Points as an image within the SVG: a hundred thousand of them are no drawing.
    ax.plot(xyz[some, 0], xyz[some, 1], ",", color="#A8A8A8", rasterized=True)
    for number, (name, rows) in enumerate(planes.items()):
        ax.plot(
            xyz[rows, 0], xyz[rows, 1], ".", markersize=2.0, markeredgewidth=0.0,
            color=looks[name]["color"], rasterized=True,
        )  # fmt: skip
        centre = xyz[rows, :2].mean(axis=0)
        ax.annotate(
            name, centre, xytext=(0, 8 if number % 2 else -8), textcoords="offset points",
            fontsize=7.5, ha="center", va="bottom" if number % 2 else "top",
            color=looks[name]["color"], fontweight="bold",
        )  # fmt: skip
    shown = np.vstack([xyz[used, :2], np.zeros((1, 2))]) if len(used) else xyz[:, :2]
    low, high = np.percentile(shown, [0 if len(used) else 5, 100 if len(used) else 95], axis=0)
    centred(ax, low, high)
    metres(ax)
    ax.set_title("plan view; +: scanner")


def _per_laser(
    ax: Axes,
    lasers: pd.DataFrame,
    looks: Mapping[str, Mapping[str, Any]],
    column: str,
    sigma_cm: float,
) -> None:
    for name, look in looks.items():
        rows = lasers[lasers["plane"] == name]
        ax.plot(
            rows["laser_id"] + 1, rows[column], linestyle="", markersize=3.6, alpha=0.9,
            markeredgewidth=0.0, label=name, clip_on=False, zorder=3, **look,
        )  # fmt: skip
    reference(ax, sigma_cm, f"datasheet σ = {sigma_cm:g} cm")
    largest = float(np.nanmax(lasers[column])) if lasers[column].notna().any() else 0.0
    ax.set_ylim(0.0, 1.08 * max(largest, sigma_cm))
    ax.set_ylabel("std of s [cm]")


def field_markdown(table: pd.DataFrame) -> str:
    """Table of planes as Markdown; an empty entry where there is no number.

    Parameters
    ----------
    table : DataFrame
        Columns `TABLE`.

    Returns
    -------
    str
    """
    cells = [
        [
            "" if pd.isna(row[name]) else str(row[name]) if d is None else f"{row[name]:.{d}f}"
            for name, d in TABLE.items()
        ]
        for row in table.to_dict(orient="records")
    ]
    lines = markdown_table(list(TABLE), cells, [d is not None for d in TABLE.values()])
    return "\n".join(["**Planes in recordings without a survey.**", "", *lines, "", _NOTE]) + "\n"
