"""The scanner frame with the parameters of a laser, and the residual of a point about a wall.

Every point of the drawings is computed by the beam equations and by equation (5) as the
adjustment uses them, with parameters that are exaggerated so that they can be seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from velocal.arrays import Array
from velocal.paper.residual_form import beta, paper_form
from velocal.reporting.style import AFTER, BEFORE, COLOURS, DARK, GREY, finish, style
from velocal.scanner.beam import beams
from velocal.scanner.models import scanner_named
from velocal.study.figures import FrameFigure

#: The laser of the drawings: rotational angle of the head, and exaggerated parameters.
_PHI, _ALPHA, _V = np.deg2rad([66.0, 24.0, 24.0])
_LENGTH_M, _VOFF_M, _HOFF_M = 4.2, 0.9, 0.7
#: Where the drawing of angles ends that are shown from the origin, metres.
_REACH_M = 4.6
#: Wall of the residual: angle of its trace with the Y axis, and distance from the origin.
_OMEGA, _AWAY_M = np.deg2rad(18.0), 2.6
#: The point lies behind the wall by this distance along the beam.
_BEHIND_M = 1.5
_BEAM_PHI, _BEAM_ALPHA = np.deg2rad([86.0, 16.0])

Rows = list[tuple[str, str, str, float, float, float]]
_COLUMNS = ["panel", "kind", "name", "x", "y", "value"]


def _example(phi: float, alpha: float, v: float, voff: float, hoff: float) -> tuple[Array, Array]:
    """Direction and origin of one beam, each of shape (3,)."""
    one = (np.array([value]) for value in (phi, alpha, v, voff, hoff))
    direction, origin = beams(*one)
    return direction[0], origin[0]


def frame_table(selection: FrameFigure) -> pd.DataFrame:
    """Numbers of the figure of the frame.

    Parameters
    ----------
    selection : FrameFigure
        Entry of the configuration.

    Returns
    -------
    DataFrame
        Columns ``panel`` (``above``, ``side`` or ``lasers``), ``kind`` (``point`` or ``angle`` of
        the drawn example, ``laser`` of the scanner), ``name``, ``x`` and ``y`` (metres in the
        drawings; the nominal alpha and v in degrees for a laser), ``value`` (an angle in degrees,
        or the number of the block of a laser, counted from 1).
    """
    direction, origin = _example(_PHI, _ALPHA, _V, _VOFF_M, _HOFF_M)
    point = origin + _LENGTH_M * direction
    flat = float(np.hypot(direction[0], direction[1]))
    rows: Rows = [
        ("above", "point", "beam origin", origin[0], origin[1], np.nan),
        ("above", "point", "point", point[0], point[1], np.nan),
        ("above", "angle", "phi", 0.0, 0.0, np.rad2deg(_PHI)),
        ("above", "angle", "alpha", 0.0, 0.0, np.rad2deg(_ALPHA)),
        ("above", "angle", "theta", 0.0, 0.0, np.rad2deg(_PHI - _ALPHA)),
        ("side", "point", "beam origin", 0.0, origin[2], np.nan),
        ("side", "point", "point", _LENGTH_M * flat, point[2], np.nan),
        ("side", "angle", "v", 0.0, origin[2], np.rad2deg(_V)),
    ]
    scanner = scanner_named(selection.scanner)
    alpha, v = np.rad2deg(scanner.rotational_rad), np.rad2deg(scanner.vertical_rad)
    for laser in range(scanner.n_lasers):
        rows.append(("lasers", "laser", f"{laser + 1}", alpha[laser], v[laser], laser // 32 + 1))
    return _rounded(rows)


def _rounded(rows: Rows) -> pd.DataFrame:
    table = pd.DataFrame(rows, columns=_COLUMNS)
    numeric = ["x", "y", "value"]
    table[numeric] = np.round(table[numeric].astype(float), 4) + 0.0
    return table


def _places(numbers: pd.DataFrame, panel: str, kind: str) -> dict[str, Array]:
    """Place and value of everything of a kind in a panel, by name."""
    chosen = numbers[(numbers["panel"] == panel) & (numbers["kind"] == kind)]
    return {
        str(row["name"]): np.array([row["x"], row["y"], row["value"]], dtype=float)
        for row in chosen.to_dict(orient="records")
    }


def draw_frame(numbers: pd.DataFrame, selection: FrameFigure) -> Figure:
    """Draw the numbers of `frame_table`: from above, from the side, and all lasers.

    Parameters
    ----------
    numbers : DataFrame
    selection : FrameFigure
        Entry of the configuration.

    Returns
    -------
    Figure
    """
    with style():
        figure = Figure(figsize=(7.0, 3.3))
        above, side, lasers = figure.subplots(1, 3, width_ratios=(1.2, 1.15, 0.85))
        _above(above, numbers)
        _side(side, numbers)
        _lasers(lasers, numbers)
        finish(figure, [], f"{selection.scanner}: scanner frame and the parameters of a laser")
    return figure


def _schematic(ax: Axes, title: str, low: tuple[float, float], high: tuple[float, float]) -> None:
    ax.set_axis_off()
    ax.set_aspect("equal")
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_title(title, fontweight="normal", fontsize=8.5)


def _arrow(
    ax: Axes,
    start: Sequence[float] | Array,
    end: Sequence[float] | Array,
    colour: str = "black",
    *,
    both: bool = False,
) -> None:
    ax.annotate(
        "", (end[0], end[1]), (start[0], start[1]), zorder=3.0,
        arrowprops={"arrowstyle": "<|-|>" if both else "-|>", "color": colour, "linewidth": 1.0,
                    "shrinkA": 0.0, "shrinkB": 0.0, "mutation_scale": 8.0},
    )  # fmt: skip


def _line(ax: Axes, points: Iterable[Array], colour: str, *, dashed: bool = False,
          width: float = 1.0) -> None:  # fmt: skip
    xy = np.array([np.asarray(point)[:2] for point in points])
    ax.plot(xy[:, 0], xy[:, 1], color=colour, linewidth=width, zorder=2.0,
            linestyle=(0, (3, 2)) if dashed else "solid")  # fmt: skip


def _arc(ax: Axes, centre: Array, radius: float, first: float, last: float, name: str, colour: str,
         *, out: float = 0.32) -> None:  # fmt: skip
    """Arc between two directions (radians, clockwise from Y up), with its name at its middle."""
    angle = np.linspace(first, last, 60)
    ax.plot(centre[0] + radius * np.sin(angle), centre[1] + radius * np.cos(angle),
            color=colour, linewidth=1.0, zorder=2.5)  # fmt: skip
    tip, before = angle[-1], angle[-4]
    at = [centre[:2] + radius * np.array([np.sin(a), np.cos(a)]) for a in (before, tip)]
    _arrow(ax, at[0], at[1], colour)
    middle = 0.5 * (first + last)
    x, y = centre[:2] + (radius + out) * np.array([np.sin(middle), np.cos(middle)])
    ax.text(x, y, name, ha="center", va="center", color=colour)


def _axes_of_frame(ax: Axes, right: str, up: str, reach: tuple[float, float]) -> None:
    _arrow(ax, (0.0, 0.0), (reach[0], 0.0))
    _arrow(ax, (0.0, 0.0), (0.0, reach[1]))
    ax.text(reach[0], -0.12, right, ha="right", va="top", fontweight="bold")
    ax.text(-0.12, reach[1], up, ha="right", va="top", fontweight="bold")


def _above(ax: Axes, numbers: pd.DataFrame) -> None:
    _schematic(ax, "from above", (-1.9, -0.6), (4.9, 4.9))
    points, angles = (_places(numbers, "above", kind) for kind in ("point", "angle"))
    origin, point = points["beam origin"][:2], points["point"][:2]
    phi, theta = (np.deg2rad(angles[name][2]) for name in ("phi", "theta"))
    _axes_of_frame(ax, "X", "Y", (4.8, 4.7))
    head = _REACH_M * np.array([np.sin(phi), np.cos(phi)])
    along = 4.1 * np.array([np.sin(theta), np.cos(theta)])
    _line(ax, [np.zeros(2), head], GREY, dashed=True)
    _line(ax, [np.zeros(2), along], BEFORE, dashed=True)
    below = head + 0.16 * np.array([np.cos(phi), -np.sin(phi)])
    ax.text(below[0], below[1], "direction of the head", ha="right", va="top", fontsize=7.0,
            color=GREY, rotation=90.0 - float(np.rad2deg(phi)), rotation_mode="anchor")  # fmt: skip
    # The names of angles that begin at the Y axis stand on its other side.
    for radius, last, name, colour in ((2.3, phi, "φ", GREY), (3.5, theta, "θ = φ − α", DARK)):
        _arc(ax, np.zeros(2), radius, 0.0, last, "", colour)
        ax.text(-0.14, radius, name, ha="right", va="center", color=colour)
    _arc(ax, np.zeros(2), 1.6, phi, theta, "α", BEFORE)
    _arrow(ax, (0.0, 0.0), origin, COLOURS[2], both=True)
    ax.text(origin[0] * 0.5 - 0.1, origin[1] * 0.5 - 0.08, "hoff", ha="right", va="top",
            color=COLOURS[2])  # fmt: skip
    _line(ax, [origin, point], AFTER, width=1.6)
    middle = 0.72 * point + 0.28 * origin + 0.14 * np.array([-np.cos(theta), np.sin(theta)])
    turn = 90.0 - float(np.rad2deg(theta))
    ax.text(middle[0], middle[1], "L cos v", ha="center", va="bottom", color=AFTER, rotation=turn,
            rotation_mode="anchor", fontsize=8.0)  # fmt: skip
    ax.plot(*origin, "o", color=AFTER, markersize=3.5, zorder=4.0)
    ax.plot(*point, "o", color=AFTER, markersize=5.0, zorder=4.0)
    ax.text(point[0] + 0.1, point[1] + 0.05, "point", ha="left", va="bottom", color=AFTER)


def _side(ax: Axes, numbers: pd.DataFrame) -> None:
    _schematic(ax, "from the side, in the plane of the beam", (-1.2, -0.6), (5.2, 4.9))
    points, angles = (_places(numbers, "side", kind) for kind in ("point", "angle"))
    origin, point = points["beam origin"][:2], points["point"][:2]
    v = np.deg2rad(angles["v"][2])
    _axes_of_frame(ax, "horizontal", "Z", (4.9, 4.2))
    _arrow(ax, (0.0, 0.0), origin, COLOURS[2], both=True)
    ax.text(-0.14, 0.5 * origin[1], "voff", ha="right", va="center", color=COLOURS[2])
    level = np.array([point[0], origin[1]])
    _line(ax, [origin, level], GREY, dashed=True)
    _line(ax, [level, point], GREY, dashed=True)
    ax.text(0.5 * point[0], origin[1] - 0.12, "L cos v", ha="center", va="top", color=GREY)
    ax.text(point[0] + 0.1, 0.5 * (origin[1] + point[1]), "L sin v", ha="left", va="center",
            color=GREY)  # fmt: skip
    _arc(ax, origin, 1.8, 0.5 * np.pi, 0.5 * np.pi - v, "v", BEFORE)
    _line(ax, [origin, point], AFTER, width=1.6)
    middle = 0.6 * point + 0.4 * origin
    ax.text(middle[0] - 0.1, middle[1] + 0.2, "L = l + dl", ha="center", va="center", color=AFTER,
            rotation=float(np.rad2deg(v)), rotation_mode="anchor")  # fmt: skip
    ax.plot(*origin, "o", color=AFTER, markersize=3.5, zorder=4.0)
    ax.plot(*point, "o", color=AFTER, markersize=5.0, zorder=4.0)
    ax.text(point[0], point[1] + 0.15, "point", ha="center", va="bottom", color=AFTER)
    ax.text(-0.1, -0.12, "centre of the base", ha="left", va="top", fontsize=7.0)


def _lasers(ax: Axes, numbers: pd.DataFrame) -> None:
    rows = numbers[numbers["kind"] == "laser"]
    blocks = sorted(rows["value"].unique())
    for number, block in enumerate(blocks):
        own = rows[rows["value"] == block]
        first, last = own["name"].astype(int).min(), own["name"].astype(int).max()
        ax.plot(own["x"], own["y"], "os^D"[number % 4], color=COLOURS[number], markersize=3.6,
                markerfacecolor="white" if number % 2 else COLOURS[number],
                label=f"lasers {first} to {last}")  # fmt: skip
    ax.grid(visible=True, axis="both")
    wide = max(1.0, 1.15 * float(rows["x"].abs().max()))
    ax.set_xlim(-wide, wide)
    ax.set_xlabel("nominal α [deg]")
    ax.set_ylabel("nominal v [deg]", labelpad=1.0)
    ax.set_title("all lasers", fontweight="normal", fontsize=8.5)
    low, high = float(rows["y"].min()), float(rows["y"].max())
    # Room for the legend above the lasers.
    ax.set_ylim(low - 0.05 * (high - low), high + (0.08 + 0.09 * len(blocks)) * (high - low))
    ax.legend(loc="upper center", fontsize=7.0, borderpad=0.2, handletextpad=0.1)


def residual_table() -> pd.DataFrame:
    """Numbers of the figure of the residual.

    Returns
    -------
    DataFrame
        Columns as `frame_table` gives them; panel ``wall``. The kind ``length`` holds s by
        equation (5), s by the paper's form with Table I, and the distance D of equation (4),
        in metres.
    """
    direction, origin = _example(_BEAM_PHI, _BEAM_ALPHA, 0.0, 0.0, 0.0)
    # The trace runs along (sin omega, cos omega); the normal points away from the scanner.
    trace = np.array([np.sin(_OMEGA), np.cos(_OMEGA), 0.0])
    normal = np.array([np.cos(_OMEGA), -np.sin(_OMEGA), 0.0])
    hit = origin + direction * (_AWAY_M - normal @ origin) / (normal @ direction)
    point = hit + _BEHIND_M * direction
    distance = float(normal @ point - _AWAY_M)
    s = distance / float(normal @ direction)
    angle = beta(np.array([_BEAM_PHI]), np.array([_BEAM_ALPHA]), np.array([_OMEGA]))
    paper = paper_form(point[None], -normal / _AWAY_M, np.zeros(1), angle)[0]
    foot = point - distance * normal
    ends = [_AWAY_M * normal + along * trace for along in (-1.2, 3.6)]
    theta = _BEAM_PHI - _BEAM_ALPHA
    rows: Rows = [
        *(("wall", "point", name, at[0], at[1], np.nan)
          for name, at in (("beam origin", origin), ("point", point), ("on the plane", hit),
                           ("foot", foot), ("end 1", ends[0]), ("end 2", ends[1]))),
        ("wall", "angle", "theta", 0.0, 0.0, np.rad2deg(theta)),
        ("wall", "angle", "omega", 0.0, 0.0, np.rad2deg(_OMEGA)),
        ("wall", "angle", "beta", hit[0], hit[1], np.rad2deg(angle[0])),
        ("wall", "length", "s", point[0], point[1], s),
        ("wall", "length", "s of the paper", point[0], point[1], abs(paper)),
        ("wall", "length", "D", point[0], point[1], distance),
    ]  # fmt: skip
    return _rounded(rows)


def draw_residual(numbers: pd.DataFrame) -> Figure:
    """Draw the numbers of `residual_table`: a beam, a wall and a point behind it, from above.

    Parameters
    ----------
    numbers : DataFrame

    Returns
    -------
    Figure
    """
    points, angles = (_places(numbers, "wall", kind) for kind in ("point", "angle"))
    origin, point, hit, foot = (
        points[name][:2] for name in ("beam origin", "point", "on the plane", "foot")
    )
    theta, omega, beta_rad = (np.deg2rad(angles[name][2]) for name in ("theta", "omega", "beta"))
    with style():
        figure = Figure(figsize=(7.0, 3.7))
        ax = figure.subplots()
        _schematic(ax, "", (-0.7, -0.8), (8.6, 3.7))
        _axes_of_frame(ax, "X", "Y", (5.0, 3.5))
        _line(ax, [points["end 1"], points["end 2"]], DARK, width=2.4)
        end = points["end 2"][:2]
        ax.text(end[0] + 0.1, end[1] - 0.15, "wall: n · X + d = 0", ha="left", va="center")
        _line(ax, [origin, hit], AFTER, width=1.6)
        _line(ax, [hit, point], BEFORE, width=2.2)
        _line(ax, [point, foot], COLOURS[2], width=1.6)
        middle = 0.5 * (hit + point)
        ax.text(middle[0] + 0.06, middle[1] - 0.2, "s", ha="center", va="center", color=BEFORE,
                fontweight="bold")  # fmt: skip
        middle = 0.5 * (point + foot)
        ax.text(middle[0] + 0.05, middle[1] + 0.17, "D", ha="left", va="center", color=COLOURS[2],
                fontweight="bold")  # fmt: skip
        _arc(ax, np.zeros(2), 1.3, 0.0, theta, "θ = φ − α", DARK, out=0.5)
        _arc(ax, hit, 0.75, omega, theta, "β", COLOURS[3], out=-0.22)
        _line(ax, [hit, hit + np.array([0.0, 1.9])], GREY, dashed=True)
        _arc(ax, hit, 1.75, 0.0, omega, "ω", GREY, out=0.2)
        ax.plot(*origin, "o", color="black", markersize=4.0, zorder=4.0)
        ax.plot(*hit, "o", color=AFTER, markersize=4.0, zorder=4.0)
        ax.plot(*point, "o", color=BEFORE, markersize=5.0, zorder=4.0)
        ax.text(point[0] + 0.12, point[1] + 0.12, "point X", ha="left", va="bottom", color=BEFORE)
        ax.text(hit[0] + 0.1, hit[1] - 0.12, "X − s u", ha="left", va="top", color=AFTER)
        ax.text(0.0, -0.15, "scanner", ha="center", va="top", fontsize=7.5)
        lengths = _places(numbers, "wall", "length")
        ax.text(
            5.5, 2.6,
            "D = n · X + d  (4)\n"
            "s = D / (n · u)  (5)\n"
            "paper: s = D / (cos v |sin β|)\n\n"
            "as drawn, with v = 0:\n"
            f"D = {lengths['D'][2]:.2f} m, s = {lengths['s'][2]:.2f} m\n"
            f"θ = {np.rad2deg(theta):.0f}°, ω = {np.rad2deg(omega):.0f}°, "
            f"β = {np.rad2deg(beta_rad):.0f}°",
            ha="left", va="top", fontsize=8.0, linespacing=1.5,
        )  # fmt: skip
        finish(figure, [], "Residual s of a point about a wall, from above")
    return figure
