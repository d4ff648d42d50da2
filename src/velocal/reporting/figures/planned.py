"""Picture of a plan: which laser meets which plane, and the standard deviations that follow."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from velocal.evaluation.planner import WEAK, Plan
from velocal.reporting.style import AFTER, BEFORE, GREY, finish, laser_axis, style

#: Parameter, label and factor of every panel of standard deviations.
_PANELS = (
    ("dl", "dl [mm]", 1e3),
    ("alpha", "alpha [deg]", 180.0 / np.pi),
    ("v", "v [deg]", 180.0 / np.pi),
)


def draw_lasers(plan: Plan, scanner: str) -> Figure:
    """Draw medians per laser and plane, and the expected standard deviations.

    Parameters
    ----------
    plan : Plan
    scanner : str
        Name for the title.

    Returns
    -------
    Figure
    """
    lasers = len(plan.std)
    names = [
        f"{station.name}: {plane}".replace("_", " ")
        for station in plan.unit.stations
        for plane in plan.planes
    ]
    medians = plan.medians.transpose(0, 2, 1).reshape(-1, lasers)
    with style():
        figure = Figure(figsize=(7.0, 5.6 + 0.18 * len(names)))
        heights = [0.5 + 0.18 * len(names), 1.2, 1.2, 1.2]
        axes = figure.subplots(4, 1, sharex=True, height_ratios=heights)
        _met(figure, axes[0], medians, names)
        for number, (ax, (_, label, factor)) in enumerate(zip(axes[1:], _PANELS, strict=True)):
            _std(ax, plan, number, factor)
            ax.set_ylabel(label)
        laser_axis(axes[-1], lasers)
        axes[-1].set_xlabel("laser, counted from 1")
        finish(figure, [axes[1]], f"{scanner}: expected standard deviations, before measuring")
    return figure


def _met(figure: Figure, ax: Axes, medians: np.ndarray, names: list[str]) -> None:
    shown = np.where(medians > 0, medians, np.nan)
    edges = np.arange(medians.shape[1] + 1) + 0.5
    image = ax.pcolormesh(edges, np.arange(len(names) + 1) - 0.5, shown, cmap="Blues", vmin=0.0)
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.grid(visible=False)
    ax.set_title("medians of every laser on every plane (white: none)")
    figure.colorbar(image, ax=ax, pad=0.01)


def _std(ax: Axes, plan: Plan, number: int, factor: float) -> None:
    """Standard deviations by what the data decide."""
    share, seen = plan.unit.determined[:, number], plan.unit.calibration.observed
    laser, std = np.arange(len(share)) + 1, factor * plan.std[:, number]
    for chosen, marker, colour, fill, label in (
        (seen & (share >= WEAK), "o", AFTER, AFTER, "determined by the data"),
        (seen & (share < WEAK), "s", BEFORE, "white", f"weakly: data decide less than {WEAK:.0%}"),
        (~seen, "x", GREY, GREY, "not observed"),
    ):
        ax.plot(
            laser[chosen], std[chosen], marker, color=colour, markerfacecolor=fill, markersize=4.0,
            label=label,
        )  # fmt: skip
    ax.set_ylim(0.0, 1.1 * float(std.max()))
