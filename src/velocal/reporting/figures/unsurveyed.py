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
from velocal.evaluation.holdout import QUANTILE, JudgedCalibration
from velocal.evaluation.unsurveyed import relative_std
from velocal.io.markup import markdown_table
from velocal.reporting.style import (
    COLOURS,
    GREY,
    centred,
    finish,
    laser_axis,
    metres,
    reference,
    style,
)

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
    n_lasers: int,
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
    n_lasers : int
        Of the scanner.

    Returns
    -------
    Figure
    """
    sigma_cm = float(facts["sigma_cm"])
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


def field_calibration(found: JudgedCalibration, title: str) -> Figure:
    """Draw the corrections of a calibration without a survey, and what planes left out say of it.

    Parameters
    ----------
    found : JudgedCalibration
        Its parts that were held out are planes.
    title : str

    Returns
    -------
    Figure
        Above: correction of the distance by laser with its interval of 95 %, both relative to
        the mean over the lasers, which such a calibration hardly knows. Below: standard deviation
        of s of every plane that was left out, before and after.
    """
    calibration = found.unit.calibration
    with style():
        figure = Figure(figsize=(9.0, 5.4))
        above, below = figure.subplots(2, 1, gridspec_kw={"height_ratios": (1.0, 1.1)})
        seen = np.flatnonzero(calibration.observed)
        above.axhline(0.0, color=GREY, linewidth=0.8)
        dl = calibration.corrections[seen, 0]
        above.errorbar(
            seen + 1, (dl - dl.mean()) * 1e2,
            yerr=QUANTILE * relative_std(found.unit)[seen, 0] * 1e2,
            fmt="o", markersize=3.6, linewidth=1.0, color=COLOURS[0],
        )  # fmt: skip
        laser_axis(above, len(calibration))
        above.set_xlabel("laser")
        above.set_ylabel("dl - mean [cm]")
        above.set_title(
            "correction of the distance relative to the mean of all lasers, 95 % interval"
        )
        parts = found.hold_out.parts
        names = [f"{part.station}\n{part.plane}" for part in parts]
        at = np.arange(len(parts))
        for shift, name, values in (
            (-0.12, "before", [part.total.before_m for part in parts]),
            (0.12, "after", [part.total.after_m for part in parts]),
        ):
            # The interval is that of the gain: it belongs to the value after.
            spread = None
            if name == "after":
                spread = [
                    [(part.total.high_m - part.total.gain_m) * 1e2 for part in parts],
                    [(part.total.gain_m - part.total.low_m) * 1e2 for part in parts],
                ]
            below.errorbar(
                at + shift, np.array(values) * 1e2, yerr=spread, fmt="so"[name == "after"],
                markersize=4.6, linewidth=1.0, label=name,
                color=GREY if name == "before" else COLOURS[0],
            )  # fmt: skip
        below.set_xticks(at, names)
        below.set_xlim(-0.6, max(len(parts) - 0.4, 0.6))
        below.set_ylim(bottom=0.0)
        below.set_ylabel("std of s [cm]")
        below.set_title("planes that were left out: lasers about their common plane")
        total = found.hold_out.total
        said = found.hold_out.verdict.value
        if total:
            said += (
                f" on planes left out ({total.before_m * 1e2:.2f} to {total.after_m * 1e2:.2f} cm)"
            )
        finish(figure, [below], f"{title}: {said}", ncols=2)
    return figure


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
