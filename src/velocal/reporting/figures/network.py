"""Picture of an adjusted network: plan with error ellipses, and how good the points are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from velocal.arrays import Array
from velocal.reporting.style import AFTER, BEFORE, GREY, finish, metres, style

#: Kind of point, its colour and marker size; the adjustments whose set-ups belong to it.
KINDS = {
    "control point": (BEFORE, 2.5),
    "target": (GREY, 1.2),
    "base target": (AFTER, 1.2),
}
#: Half axes of an ellipse that holds a point of the plane with 95 %, in standard deviations.
NINETY_FIVE = float(np.sqrt(-2.0 * np.log(0.05)))
#: Factor by which ellipses are drawn larger than the network.
EXAGGERATION = 100.0
#: Markers of set-ups, by what their adjustment begins with.
SETUPS = {
    "control": ("^", "station of the network"),
    "targets": ("s", "camera"),
    "base": ("v", "set-up for a base"),
}


def draw_network(content: Mapping[str, Any], *, simulated: bool) -> Figure:
    """Draw the plan of a network and the distribution of its standard deviations.

    Parameters
    ----------
    content : mapping
        ``adjustments`` and ``points`` as `Survey.to_json` gives them.
    simulated : bool
        Said in the title.

    Returns
    -------
    Figure
    """
    points = content["points"]
    with style():
        figure = Figure(figsize=(9.0, 4.4))
        plan, spread = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
        for kind, (colour, size) in KINDS.items():
            own = [point for point in points if point["kind"] == kind]
            if not own:
                continue
            xyz = np.array([point["xyz_m"] for point in own])
            covariance = np.array([point["covariance_mm2"] for point in own])
            plan.plot(xyz[:, 0], xyz[:, 1], ".", color=colour, markersize=size, zorder=3)
            if kind != "target":  # hundreds along a wall: their ellipses would hide it
                _ellipses(plan, xyz, covariance[:, :2, :2] * 1e-6, colour)
            largest = np.sort(np.sqrt(np.einsum("nii->ni", covariance)).max(axis=1))
            share = 100.0 * np.arange(1, len(largest) + 1) / len(largest)
            spread.step(
                np.append(largest[0], largest), np.append(0.0, share), where="post",
                color=colour, label=f"{kind}s ({len(own)}), at most {largest[-1]:.2f} mm",
            )  # fmt: skip
        _setups(plan, content["adjustments"])
        metres(plan)
        plan.set_title(f"plan; 95 % ellipses {EXAGGERATION:g} times as large")
        spread.set_title("largest standard deviation of a coordinate")
        spread.set_xlabel("a posteriori standard deviation [mm]")
        spread.set_ylabel("share of points [%]")
        spread.set_xlim(left=0.0)
        spread.set_ylim(0.0, 102.0)
        title = "Network of the survey" + (" (simulated observations)" if simulated else "")
        finish(figure, [plan, spread], title, ncols=3)
    return figure


def _ellipses(ax: Axes, xyz: Array, covariance: Array, colour: str) -> None:
    values, vectors = np.linalg.eigh(covariance)
    size = 2.0 * NINETY_FIVE * EXAGGERATION * np.sqrt(np.maximum(values, 0.0))
    angle = np.rad2deg(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    ax.add_collection(
        EllipseCollection(
            size[:, 1], size[:, 0], angle, units="xy", offsets=xyz[:, :2],
            offset_transform=ax.transData, facecolors="none", edgecolors=colour, linewidths=0.6,
        )
    )  # fmt: skip


def _setups(ax: Axes, adjustments: list[Mapping[str, Any]]) -> None:
    for beginning, (marker, label) in SETUPS.items():
        places = [
            place
            for row in adjustments
            if row["adjustment"].startswith(beginning)
            for place in row.get("setups_m", {}).values()
        ]
        if places:
            xyz = np.array(places)
            ax.plot(
                xyz[:, 0], xyz[:, 1], linestyle="", marker=marker, markersize=5.0,
                markerfacecolor="white", color="black", label=label, zorder=4,
            )  # fmt: skip
