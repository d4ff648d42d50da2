"""Map of an interior in oblique view, and a section of one wall before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.evaluation.interior_map import STATES, Section
from velocal.reporting.style import AFTER, BEFORE, DARK, finish, metres, style
from velocal.study.figures import MapFigure
from velocal.study.planes import Box

#: Heights are drawn upward at this share of their length, X and Y as they are.
LIFT = 0.5
#: Heights that colours span, percent of the points.
_COLOURED = (1.0, 99.0)
_PIXEL_M = 0.0125
_MARGIN_M = 0.4
#: Ground of words on the map.
_PLATE = {"boxstyle": "round,pad=0.12", "facecolor": "white", "alpha": 0.8, "linewidth": 0}


def section_table(
    part: Section, points: Mapping[str, NDArray[Any]], positions: Sequence[str]
) -> dict[str, NDArray[Any]]:
    """Numbers of the section.

    Parameters
    ----------
    part : Section
    points : mapping of str to ndarray
        Columns of `schemas.MAP`.
    positions : sequence of str
        Names of the positions.

    Returns
    -------
    dict of str to ndarray
        Columns ``position``, ``laser`` (counted from 1), and for each calibration
        ``along_{state}_m`` and ``across_{state}_cm`` (from the fitted line).
    """
    columns: dict[str, NDArray[Any]] = {
        "position": np.array(positions)[points["position"][part.rows]],
        "laser": points["laser_id"][part.rows].astype(np.int64) + 1,
    }
    for state in STATES:
        columns[f"along_{state}_m"] = np.round(part.along[state], 4)
        columns[f"across_{state}_cm"] = np.round(part.across[state] * 1e2, 3) + 0.0
    return columns


def draw_map(
    xyz: Array,
    scanners: Mapping[str, Array],
    numbers: Mapping[str, NDArray[Any]],
    selection: MapFigure,
    *,
    simulated: bool,
) -> Figure:
    """Draw the map and the first of the sections.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        Points with the refined calibration, metres.
    scanners : mapping of str to ndarray, shape (3,)
        Where the scanner stood, by position.
    numbers : mapping of str to ndarray
        Those of `section_table`.
    selection : MapFigure
        Entry of the configuration.
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    name, box = next(iter(selection.sections.items()))
    with style():
        figure = Figure(figsize=(7.0, 6.3))
        grid = figure.add_gridspec(2, 2, height_ratios=(2.7, 1.0))
        _oblique(figure, figure.add_subplot(grid[0, :]), xyz, scanners, box)
        left = figure.add_subplot(grid[1, 0])
        right = figure.add_subplot(grid[1, 1], sharex=left, sharey=left)
        left.set_ylim(*_symmetric(numbers))
        for ax, state, colour, label in (
            (left, "factory", BEFORE, "before (factory)"),
            (right, "refined", AFTER, f"after ({selection.set})"),
        ):
            _section(ax, numbers, state, colour, label)
        run = "X" if np.ptp(box.x_m) >= np.ptp(box.y_m) else "Y"
        low, high = (100.0 * float(z) for z in box.z_m)
        left.set_ylabel(f"across {name.replace('_', ' ')} [cm]")
        figure.supxlabel(
            f"{run} along the wall [m]; section at heights from {low:.0f} to {high:.0f} cm",
            fontsize=8.5,
        )
        count = f"{len(xyz):,}".replace(",", "\u2009")
        title = (
            f"{selection.scanner}: interior from {len(scanners)} positions, {count} points, "
            f"parameter set {selection.set}"
        )
        finish(figure, [], title, simulated=simulated)
    return figure


def _symmetric(numbers: Mapping[str, NDArray[Any]]) -> tuple[float, float]:
    """Scale of both panels: all but one point in a thousand."""
    both = np.abs([numbers[f"across_{state}_cm"] for state in STATES])
    reach = 1.15 * float(np.quantile(both, 0.999))
    return -reach, reach


def raster(
    xyz: Array, colours: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], tuple[float, float, float, float]]:
    """Picture of points, each a square of two by two pixels, the nearer before the farther.

    Half a million points are no drawing, and as a picture of their own they take a tenth of the
    time that markers would.

    Parameters
    ----------
    xyz : ndarray, shape (n, 3)
        Metres.
    colours : ndarray of uint8, shape (n, 4)
        RGBA.

    Returns
    -------
    picture : ndarray of uint8, shape (rows, columns, 4)
        From below to above, transparent where there is no point.
    extent : tuple of float
        Left, right, bottom, top, metres.
    """
    order = np.lexsort((xyz[:, 2], -xyz[:, 1]))
    flat = np.column_stack([xyz[:, 0], xyz[:, 1] + LIFT * xyz[:, 2]])[order]
    low, high = (np.quantile(flat, share, axis=0) for share in (1e-4, 1.0 - 1e-4))
    low, high = low - _MARGIN_M, high + _MARGIN_M
    columns, rows = np.ceil((high - low) / _PIXEL_M).astype(int)
    inside = np.all((flat >= low) & (flat <= high - 2 * _PIXEL_M), axis=1)
    column, row = ((flat[inside] - low) / _PIXEL_M).astype(np.int64).T
    square = np.array([0, 1, columns, columns + 1])
    picture = np.zeros((rows * columns, 4), dtype=np.uint8)
    # Of equal places the last one counts, which is the nearest.
    picture[((row * columns + column)[:, None] + square).ravel()] = np.repeat(
        colours[order][inside], len(square), axis=0
    )
    right, top = low + _PIXEL_M * np.array([columns, rows])
    extent = (float(low[0]), float(right), float(low[1]), float(top))
    return picture.reshape(rows, columns, 4), extent


def _oblique(
    figure: Figure,
    ax: Axes,
    xyz: Array,
    scanners: Mapping[str, Array],
    box: Box,
) -> None:
    """Plan with heights drawn upward, what is farther away (larger Y) behind what is nearer."""
    low, high = np.percentile(xyz[:, 2], _COLOURED)
    shown = Normalize(float(low), float(high), clip=True)
    colours = ScalarMappable(shown, "cividis")
    picture, extent = raster(xyz, colours.to_rgba(xyz[:, 2], bytes=True))
    ax.imshow(picture, extent=extent, origin="lower", interpolation="nearest", zorder=2.0)
    for name, (where_x, where_y, where_z) in scanners.items():
        at = (where_x, where_y + LIFT * where_z)
        ax.plot([at[0]] * 2, [where_y, at[1]], color="black", linewidth=0.8, zorder=3.0)
        ax.plot(*at, "^", color="black", markersize=6.0, markeredgecolor="white",
                markeredgewidth=0.8, zorder=3.1)  # fmt: skip
        ax.annotate(
            name, at, xytext=(0, 5), textcoords="offset points", ha="center", fontsize=8.5,
            fontweight="bold", zorder=3.2,
            bbox=_PLATE,
        )  # fmt: skip
    corner = (box.x_m[0], box.y_m[0] + LIFT * box.z_m[0])
    height = np.ptp(box.y_m) + LIFT * np.ptp(box.z_m)
    ax.add_patch(
        Rectangle(corner, float(np.ptp(box.x_m)), float(height), fill=False,
                  edgecolor=BEFORE, linewidth=1.3, zorder=3.0)
    )  # fmt: skip
    ax.annotate(
        "section", (box.x_m[1], corner[1] + height), xytext=(0, 2), ha="right", va="bottom",
        textcoords="offset points", fontsize=7.5, color=DARK, zorder=3.2, bbox=_PLATE,
    )  # fmt: skip
    metres(ax, tick_m=2)
    ax.grid(visible=False)
    ax.set_ylabel(f"Y on the floor [m]; heights drawn × {LIFT:g}")
    figure.colorbar(colours, ax=ax, label="height Z [m]", fraction=0.025, pad=0.01, extend="both")


def _section(
    ax: Axes, numbers: Mapping[str, NDArray[Any]], state: str, colour: str, label: str
) -> None:
    across = numbers[f"across_{state}_cm"]
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.plot(
        numbers[f"along_{state}_m"], across, ".", markersize=1.8, markeredgewidth=0.0,
        color=colour, rasterized=True,
    )  # fmt: skip
    rms = float(np.sqrt(np.mean(across**2)))
    ax.set_title(f"{label}: thickness {rms:.1f} cm (rms)", fontweight="normal", color=colour)
    beyond = np.count_nonzero(np.abs(across) > ax.get_ylim()[1])
    note = f"n = {len(across)}" + (f", {beyond} beyond" if beyond else "")
    ax.text(0.99, 0.97, note, transform=ax.transAxes, ha="right", va="top",
            fontsize=7.5)  # fmt: skip
