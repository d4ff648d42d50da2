"""Figure of the stability of a unit: changes of its distances over some times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from velocal.evaluation.stability import Changes, verdict
from velocal.reporting.style import AFTER, CONNECTION, GREY, finish, laser_axis, style

#: More names of times than this are written upright.
_MOST_LEVEL = 6


def draw(
    changes: Mapping[str, Changes],
    times: Mapping[str, Sequence[tuple[str, str, float]]],
    title: str,
    *,
    simulated: bool = False,
) -> Figure:
    """Draw a row of panels for every comparison: over the times, and the last time by laser.

    Parameters
    ----------
    changes, times : mapping of str
        As for `stability.tabulate`.
    title : str
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
        Left: change of every laser relative to the mean of the lasers, and this mean with its
        interval of 95 %. Right: the changes of the lasers at the last time with their intervals.
    """
    with style():
        rows = max(len(changes), 1)
        figure = Figure(figsize=(9.0, 1.2 + 2.6 * rows))
        axes = figure.subplots(rows, 2, squeeze=False, width_ratios=(1, 1.3))
        for row, (compared, found) in zip(axes, changes.items(), strict=False):
            _over_time(row[0], found, times[compared])
            _last(row[1], found, times[compared])
            by_name = compared == "recordings"
            row[0].set_title("recordings" if by_name else f"windows of {compared}")
        if not changes:
            for ax in axes[0]:
                ax.set_axis_off()
        said = [line for each in verdict(changes).splitlines() for line in wrap(each, 105)]
        legend = [axes[0, 0]] if changes else []
        finish(figure, legend, "\n".join([title, *said]), simulated=simulated)
    return figure


def _over_time(ax: Axes, found: Changes, times: Sequence[tuple[str, str, float]]) -> None:
    at = np.arange(len(times))
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    seen = np.isfinite(found.single_m).all(axis=0)
    lines = ax.plot(at, found.single_m[:, seen] * 1e2, color=CONNECTION, linewidth=0.6, zorder=1)
    lines[0].set_label("one laser relative to the mean")
    ax.errorbar(
        at, found.common_m * 1e2, yerr=found.common_half_m * 1e2, fmt="o-", markersize=3.6,
        linewidth=1.2, color=AFTER, zorder=3, label="mean of all lasers, 95 % interval",
    )  # fmt: skip
    several = len({recording for recording, _, _ in times}) > 1
    names = ["\n".join(_named(time, several)) for time in times]
    upright = len(names) > _MOST_LEVEL
    ax.set_xticks(at, names, fontsize=7.5, rotation=90 if upright else 0)
    ax.set_xlim(-0.4, len(times) - 0.6)
    ax.set_ylabel("change [cm]")


def _last(ax: Axes, found: Changes, times: Sequence[tuple[str, str, float]]) -> None:
    time, several = times[-1], len({recording for recording, _, _ in times}) > 1
    seen = np.flatnonzero(np.isfinite(found.single_m[-1]))
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    ax.errorbar(
        seen + 1, found.single_m[-1, seen] * 1e2, yerr=found.single_half_m[-1, seen] * 1e2,
        fmt="o", markersize=3.2, linewidth=0.9, color=AFTER,
    )  # fmt: skip
    laser_axis(ax, found.single_m.shape[1])
    ax.set_xlabel("laser")
    ax.set_title(
        f"{', '.join(_named(time, several))}: lasers relative to their mean, 95 % interval"
    )


def _named(time: tuple[str, str, float], several: bool) -> list[str]:
    """Lines of the name of a time; the recording is one of them where there are several."""
    recording, window, warmth = time
    lines = [recording] if several or not window else []
    lines += [window if several else f"window {window}"] if window else []
    return lines if np.isnan(warmth) else [*lines, f"{warmth:.0f} °C"]
