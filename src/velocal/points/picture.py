"""Picture of what a calibration changes: plan of the points, a flat surface before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from velocal.arrays import Array
from velocal.calibration.applied import AppliedCalibration
from velocal.evaluation.plane_search import find_planes
from velocal.evaluation.planes_in_data import Cloud, FieldPlane, Search
from velocal.geometry.planes import fit_plane
from velocal.reporting.style import centred, finish, metres, style
from velocal.scanner.beam import Beams

#: Flat surfaces among which the one to be shown is looked for.
SEARCH = Search(planes=4, distance_m=0.15, extent_m=8.0, min_points=300, incidence_rad=1.2, seed=1)
#: Points that are used and drawn, at most.
POINTS = 40_000
#: Half height of the panels of the surface, in standard deviations before.
HALF_HEIGHT = 4.0


def surface(after: Cloud) -> FieldPlane | None:
    """Find the flat surface that most lasers see, so that they can be compared.

    Parameters
    ----------
    after : Cloud

    Returns
    -------
    FieldPlane or None
        None if no plane is found.
    """
    planes, _ = find_planes(after, SEARCH)
    return max(planes, key=lambda plane: len(np.unique(after.laser_id[plane.rows])), default=None)


def before_and_after(
    beams: Beams,
    calibrations: Sequence[AppliedCalibration],
    labels: Sequence[str],
    title: str,
) -> Figure:
    """Draw the points of two calibrations.

    Parameters
    ----------
    beams : Beams
        Returns, without the calibration.
    calibrations : sequence of two AppliedCalibration
        Before and after.
    labels : sequence of two str
        What they are called.
    title : str

    Returns
    -------
    Figure
        A plan of the points; beside it the surface edge-on with each calibration, if one is found.
    """
    # Random, because every n-th return would always be of the same few lasers.
    rng = np.random.default_rng(SEARCH.seed)
    n = len(beams)
    few = np.sort(rng.choice(n, size=min(n, POINTS), replace=False))
    clouds = [_cloud(beams[few], each) for each in calibrations]
    found = surface(clouds[1])
    with style():
        figure = Figure(figsize=(9.0, 4.6))
        grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15))
        plan = figure.add_subplot(grid[:, 0])
        _plan(figure, plan, clouds[0].xyz, clouds[1].xyz)
        if found is not None:
            of_plane = clouds[1].xyz[found.rows]
            plan.plot(of_plane[:, 0], of_plane[:, 1], ",", color="#D55E00", rasterized=True)
            _surface(
                figure, [figure.add_subplot(grid[k, 1]) for k in (0, 1)], clouds, found, labels
            )
        finish(figure, [], title)
    return figure


def _cloud(beams: Beams, calibration: AppliedCalibration) -> Cloud:
    xyz = calibration.points(beams.distance_m, beams.phi, beams.laser_id)
    return replace(Cloud.from_beams(beams, calibration.model), xyz=xyz)


def _plan(figure: Figure, ax: Axes, before: Array, after: Array) -> None:
    """Points from above, coloured by how far they moved."""
    moved = np.linalg.norm(after - before, axis=1) * 100.0
    dots = ax.scatter(
        after[:, 0], after[:, 1], c=moved, s=0.3, linewidths=0.0, cmap="viridis", vmin=0.0,
        vmax=max(float(np.percentile(moved, 98)), 0.1), rasterized=True,
    )  # fmt: skip
    low, high = np.percentile(after[:, :2], [2, 98], axis=0)
    centred(ax, low, high)
    metres(ax)
    ax.set_title("from above; orange: the surface beside")
    bar = figure.colorbar(dots, ax=ax, location="bottom", shrink=0.8, pad=0.02)
    bar.set_label("moved by [cm]")


def _surface(
    figure: Figure,
    axes: Sequence[Axes],
    clouds: Sequence[Cloud],
    found: FieldPlane,
    labels: Sequence[str],
) -> None:
    """The same returns edge-on, about the plane that fits them best with each calibration."""
    fits = [fit_plane(cloud.xyz[found.rows]) for cloud in clouds]
    half_cm = 100.0 * HALF_HEIGHT * float(np.std(fits[0].residuals))
    # Along the surface: across the normal, level where the surface is upright.
    normal = found.fit.plane.normal
    along = np.array([normal[1], -normal[0], 0.0])
    if np.linalg.norm(along) < 0.3:
        along = np.array([1.0, 0.0, 0.0])
    along /= np.linalg.norm(along)
    for ax, cloud, fit, label in zip(axes, clouds, fits, labels, strict=True):
        dots = ax.scatter(
            cloud.xyz[found.rows] @ along, 100.0 * fit.residuals, c=cloud.laser_id[found.rows] + 1,
            s=0.8, linewidths=0.0, cmap="turbo", rasterized=True,
        )  # fmt: skip
        ax.set_ylim(-half_cm, half_cm)
        ax.set_ylabel("off the plane [cm]")
        ax.set_title(f"{label}: standard deviation {100 * np.std(fit.residuals):.2f} cm")
    axes[0].sharex(axes[1])
    axes[0].tick_params(labelbottom=False)
    axes[1].set_xlabel("along the surface [m]")
    figure.colorbar(dots, ax=list(axes), label="laser", pad=0.02)
