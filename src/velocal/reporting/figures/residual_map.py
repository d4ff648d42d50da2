"""Residuals of all lasers along the azimuth, before and after, as two images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from velocal.evaluation.residual_map import BINS, STEP_DEG, ResidualMap, as_image
from velocal.reporting.style import finish, style

#: Colours end at so many standard deviations of the datasheet.
_LIMIT = 3.0
_MARGIN_BINS = 6
#: Least height of the picture, inches: the names of the axes need as much.
_LEAST_HEIGHT = 3.9
#: A plane narrower than this share of the picture gets no name.
_LEAST_WIDTH = 0.04
#: Share of the picture that the title of a panel takes.
_OF_TITLE = 0.12


def residual_images(
    found: ResidualMap,
    planes: Sequence[str],
    order: Sequence[int],
    title: str,
    sigma_m: float,
    *,
    simulated: bool,
) -> Figure:
    """Draw s of every laser along the azimuth, before above after.

    Parameters
    ----------
    found : ResidualMap
    planes : sequence of str
        Names of the planes.
    order : sequence of int
        Lasers from the lowest beam to the highest.
    title : str
    sigma_m : float
        Standard deviation of the datasheet, metres; colours end at three of them.
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    start = _start(found.azimuth_bin)
    shown = (found.azimuth_bin.astype(np.int64) - start) % BINS
    width = int(shown.max(initial=0)) + 1 + _MARGIN_BINS
    n_lasers = len(order)
    limit_cm = _LIMIT * sigma_m * 1e2
    with style():
        figure = Figure(figsize=(9.0, max(2.2 + 0.055 * n_lasers, _LEAST_HEIGHT)))
        axes = [figure.add_subplot(2, 1, 1)]
        axes.append(figure.add_subplot(2, 1, 2, sharex=axes[0]))
        states = (("before", found.before_m), ("after", found.after_m))
        for ax, (state, residual_m) in zip(axes, states, strict=True):
            image = np.roll(as_image(found, residual_m, order), -start, axis=1)
            drawn = ax.imshow(
                image[:, :width] * 1e2, aspect="auto", origin="lower", cmap="RdBu_r",
                vmin=-limit_cm, vmax=limit_cm, interpolation="nearest",
                extent=(0.0, width * STEP_DEG, 0.0, n_lasers),
            )  # fmt: skip
            ax.set_facecolor("#EDEDED")
            ax.grid(visible=False)
            ax.set_title(state)
            ax.set_ylabel("laser, lowest beam first")
            ax.set_yticks([])
        axes[0].tick_params(labelbottom=False)
        every = 30.0 if width * STEP_DEG > 120.0 else 10.0
        angles = np.arange(
            np.ceil(start * STEP_DEG / every) * every, (start + width) * STEP_DEG, every
        )
        axes[1].set_xticks(angles - start * STEP_DEG)
        axes[1].set_xticklabels([f"{angle % 360.0:.0f}" for angle in angles])
        axes[1].set_xlabel("rotational angle [deg]")
        if _names(axes[0], shown, found.plane, planes, width) < _OF_TITLE * width * STEP_DEG:
            axes[0].set_title("before", pad=16.0)
        bar = figure.colorbar(drawn, ax=axes, extend="both", fraction=0.03, pad=0.01)
        bar.set_label("s [cm]")
        finish(figure, [], title, simulated=simulated)
    return figure


def _start(bins: NDArray[np.integer]) -> int:
    """Cell where the picture begins: after the widest empty sector."""
    seen = np.unique(bins.astype(np.int64))
    if not len(seen):
        return 0
    gaps = np.diff(np.append(seen, seen[0] + BINS))
    return int((seen[(int(np.argmax(gaps)) + 1) % len(seen)] - _MARGIN_BINS) % BINS)


def _names(
    ax: Axes,
    shown: NDArray[np.integer],
    plane: NDArray[np.integer],
    planes: Sequence[str],
    width: int,
) -> float:
    """Write the names of planes above the bins where they are seen most.

    Returns
    -------
    float
        Angle from the left at which the first name stands, degrees; infinite if no plane is seen.
    """
    first = np.inf
    for number, name in enumerate(planes):
        bins = shown[plane == number]
        if len(bins) and np.ptp(bins) > _LEAST_WIDTH * width:
            centre = float(np.median(bins)) * STEP_DEG
            first = min(first, centre)
            ax.annotate(
                name.replace("_", " "), (centre, 1.0),
                xycoords=("data", "axes fraction"), xytext=(0, 3), textcoords="offset points",
                ha="center", fontsize=7.5,
            )  # fmt: skip
    return first
