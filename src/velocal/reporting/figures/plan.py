"""Plan of the test field with what was measured from each position, and its numbers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.reduction.assignment import NO_PLANE, Limits, assign
from velocal.reporting.style import COLOURS, DARK, GREY, finish, metres, style
from velocal.scanner.beam import Beams
from velocal.scanner.parameters import LaserParameters
from velocal.study.figures import PlanFigure
from velocal.survey.station import Station
from velocal.survey.targets import Targets

#: What a row of the numbers is, besides the name of a plane for a median on it.
OTHER, TARGET, OUTLINE, SCANNER, AHEAD = "other", "target", "outline", "scanner", "ahead"

#: Medians that are drawn of each plane and off the planes, at most.
MEDIANS = 3000
#: Medians off the planes are drawn from this height over the lowest corner of the planes, metres:
#: floor that nobody surveyed would hide the plan.
_FLOOR_M = 0.1
#: A plane is a wall if its normal rises by less than this.
_UPRIGHT = 0.5
_WALL_M = 0.2  # drawn thickness
_ARROW_M = 0.9
_MARGIN_M = 0.3


def plan(
    sample: str,
    station: Station,
    beams: Beams,
    parameters: LaserParameters,
    targets: Targets,
    limits: Limits,
) -> pd.DataFrame:
    """Numbers of one panel, all in the site frame.

    Parameters
    ----------
    sample : str
    station : Station
        Where the scanner stood, with the surveyed planes.
    beams : Beams
        Medians of a window.
    parameters : LaserParameters
        The factory's.
    targets : Targets
        Of the planes, site frame.
    limits : Limits
        Limits of the assignment, as in the study.

    Returns
    -------
    DataFrame
        Columns ``position``, ``sample``, ``kind``, ``plane`` (empty for what is on none),
        ``x_m``, ``y_m``, ``z_m`` (to a millimetre), ``drawn_of`` (medians of that kind; every
        n-th is kept so that `MEDIANS` at most are left). A kind is ``median``, ``other`` (a
        median on no plane), ``target``, ``outline`` (corners of a plane in order), ``scanner``
        or ``ahead`` (a point on the scanner's Y axis).
    """
    to_field, patches = station.pose.inverse(), station.patches
    plane = assign(beams, parameters, patches, limits)
    xyz = to_field.apply(beams.points(parameters))
    corners = [to_field.apply(patch.corners) for patch in patches]
    height = np.concatenate(corners)[:, 2]
    inside = (xyz[:, 2] > height.min() + _FLOOR_M) & (xyz[:, 2] < height.max())

    def parts() -> Iterator[tuple[str, str, Array, int]]:
        rows = np.flatnonzero((plane == NO_PLANE) & inside)
        yield OTHER, "", xyz[_thinned(rows)], len(rows)
        for index, patch in enumerate(patches):
            rows = np.flatnonzero(plane == index)
            yield "median", patch.name, xyz[_thinned(rows)], len(rows)
            yield OUTLINE, patch.name, corners[index], 0
            group = np.array(targets.group) == patch.name
            yield TARGET, patch.name, targets.xyz[group] - station.site_origin_m, 0
        origin = to_field.apply(np.array([[0.0, 0.0, 0.0], [0.0, _ARROW_M, 0.0]]))
        yield SCANNER, "", origin[:1], 0
        yield AHEAD, "", origin[1:], 0

    frames = [
        pd.DataFrame(np.round(where, 3) + 0.0, columns=["x_m", "y_m", "z_m"]).assign(
            kind=kind, plane=name, drawn_of=total or len(where)
        )
        for kind, name, where, total in parts()
    ]
    numbers = pd.concat(frames, ignore_index=True)
    numbers = numbers.assign(position=station.position, sample=sample)
    return numbers[["position", "sample", "kind", "plane", "x_m", "y_m", "z_m", "drawn_of"]]


def _thinned(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    return rows[:: -(-len(rows) // MEDIANS) or 1]


def draw_plan(
    numbers: pd.DataFrame, selection: PlanFigure, *, simulated: bool, measured: bool = True
) -> Figure:
    """Draw the numbers of `plan`, one panel per position with the same axes.

    Parameters
    ----------
    numbers : DataFrame
        Of all positions, one after the other.
    selection : PlanFigure
        Entry of the configuration.
    simulated : bool
        Whether a note says that the recordings are simulated.
    measured : bool
        Whether the medians were measured; if not, they are expected.

    Returns
    -------
    Figure
    """
    positions = list(dict.fromkeys(numbers["position"]))
    seen = numbers[["x_m", "y_m"]].to_numpy()
    low, high = (np.quantile(seen, share, axis=0) for share in (0.001, 0.999))
    # Without what lies behind the walls, their names need room of their own.
    margin = _MARGIN_M if measured else 2.0 * _MARGIN_M
    low, high = low - margin, high + margin
    shape = (high[1] - low[1]) / (high[0] - low[0])
    with style():
        figure = Figure(figsize=(7.0, 1.1 + 6.4 / len(positions) * shape))
        axes = figure.subplots(1, len(positions), sharex=True, sharey=True, squeeze=False)[0]
        for ax, position in zip(axes, positions, strict=True):
            _panel(ax, numbers[numbers["position"] == position])
            ax.set_xlim(low[0], high[0])
            ax.set_ylim(low[1], high[1])
            metres(ax, tick_m=2)
            ax.set_ylabel("Y [m]" if ax is axes[0] else "")
        whence = "each position" if len(positions) > 1 else f"position {positions[0]}"
        finish(
            figure, [axes[0]],
            f"{selection.scanner}: test field in plan, medians "
            f"{'measured' if measured else 'expected'} from {whence}",
            simulated=simulated, ncols=4,
        )  # fmt: skip
    return figure


def _panel(ax: Axes, rows: pd.DataFrame) -> None:
    """One position."""

    def of(kind: str, plane: str | None = None) -> Array:
        chosen = rows["kind"] == kind
        if plane is not None:
            chosen &= rows["plane"] == plane
        return rows.loc[chosen, ["x_m", "y_m", "z_m"]].to_numpy()

    def dots(xyz: Array, colour: str, label: str) -> None:
        ax.plot(
            xyz[:, 0], xyz[:, 1], ".", markersize=1.6, markeredgewidth=0.0, color=colour,
            rasterized=True, zorder=2.0,
        )  # fmt: skip
        ax.plot([], [], "o", markersize=3.5, color=colour, label=label)

    scanner, ahead = of(SCANNER)[0, :2], of(AHEAD)[0, :2]
    names = [name for name in dict.fromkeys(rows["plane"]) if name]
    for name, colour in zip(names, COLOURS, strict=False):
        dots(of("median", name), colour, f"on {name.replace('_', ' ')}")
    dots(of(OTHER), "#A8A8A8", "on no plane")
    for name in names:
        corners = of(OUTLINE, name)
        normal = np.linalg.svd(corners - corners.mean(axis=0))[2][2]
        if abs(normal[2]) < _UPRIGHT:
            _wall(ax, name, corners, normal[:2], scanner)
        else:
            ring = np.vstack([corners, corners[:1]])
            ax.plot(ring[:, 0], ring[:, 1], color=DARK, linewidth=0.8, linestyle=(0, (4, 2)),
                    label=f"hull of targets on {name}", zorder=3.0)  # fmt: skip
            targets = of(TARGET, name)
            ax.plot(targets[:, 0], targets[:, 1], "+", color=DARK, markersize=3.2,
                    markeredgewidth=0.6, label=f"target on {name}", zorder=3.0)  # fmt: skip
    ax.annotate(
        "", tuple(ahead), tuple(scanner), zorder=4.0,
        arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1.1},
    )  # fmt: skip
    ax.plot(
        *scanner, "o", color="black", markersize=4.5, label="scanner and its Y axis", zorder=4.0
    )
    position, sample = rows["position"].iloc[0], rows["sample"].iloc[0]
    medians = rows[rows["kind"] == "median"].drop_duplicates("plane")["drawn_of"].sum()
    count = f"{medians:,}".replace(",", "\u2009")
    ax.set_title(f"{position} ({sample}): {count} medians on planes", fontweight="normal")


def _wall(ax: Axes, name: str, corners: Array, normal: Array, scanner: Array) -> None:
    """A wall as a bar behind its surface, seen from the scanner."""
    flat = corners[:, :2]
    normal = normal / np.linalg.norm(normal)
    normal = normal * np.sign((flat.mean(axis=0) - scanner) @ normal)
    along = np.array([-normal[1], normal[0]])
    reach = flat @ along
    ends = flat[[np.argmin(reach), np.argmax(reach)]]
    ax.fill(
        *np.vstack([ends, ends[::-1] + _WALL_M * normal]).T, color=GREY, linewidth=0, zorder=1.5
    )
    x, y = ends.mean(axis=0) + 1.5 * _WALL_M * normal
    upright = abs(along[1]) > abs(along[0])
    ax.text(
        x, y, name.replace("_", " "), fontsize=7.5,
        rotation=90 if upright else 0, color=DARK, zorder=4.0,
        ha="center" if not upright else "right" if normal[0] < 0 else "left",
        va="center" if upright else "top" if normal[1] < 0 else "bottom",
    )  # fmt: skip
