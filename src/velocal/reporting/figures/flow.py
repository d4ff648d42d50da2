"""The rules of the workflow from a recording to the report, and which recording is used for what.

The table of the rules is compared with the workflow itself by a test: a rule that gets another
input makes it fail.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from velocal.arrays import Array
from velocal.paper.tables import ROMAN
from velocal.reporting.style import COLOURS, DARK, GREY, finish, style
from velocal.study.figures import Table


@dataclass(frozen=True)
class Step:
    """A rule of the workflow.

    Attributes
    ----------
    rule : str
    column, row : int
        Place in the drawing.
    makes : str
        What it makes, in words.
    per : str
        What its script does once for: all figures, say, and all parameter sets are one job.
    needs : tuple of str
        Rules whose outputs it takes, and that are drawn as arrows.
    also : tuple of str
        Rules whose outputs it takes too, and that are named in its box.
    """

    rule: str
    column: int
    row: int
    makes: str
    per: str
    needs: tuple[str, ...] = ()
    also: tuple[str, ...] = ()


#: What the box of another rule calls the output of a rule.
SHORT = {
    "adjust_survey": "survey",
    "average_set": "sets",
    "assign_medians": "medians on planes",
    "index_recording": "ledger",
    "simulate_factory": "factory",
    "simulate_recording": "recording",
}
#: Rules of the simulated world: files that a scanner, a surveyor and the factory hand over.
HANDED_OVER = ("simulate_recording", "simulate_survey", "simulate_factory")

STEPS = (
    Step("simulate_recording", 0, 0, "recording", "sample"),
    Step("index_recording", 0, 1, "ledger, rotations", "sample", ("simulate_recording",)),
    Step("reduce_recording", 0, 2, "medians per azimuth bin", "sample", ("index_recording",),
         ("simulate_recording",)),
    Step("simulate_survey", 1, 0, "observations of the survey", "study"),
    Step("adjust_network", 1, 1, "coordinates of the targets", "study", ("simulate_survey",)),
    Step("adjust_survey", 1, 2, "pose and planes", "position", ("adjust_network",)),
    Step("simulate_factory", 2, 0, "factory's calibration", "scanner"),
    Step("assign_medians", 1, 3, "medians on planes", "sample",
         ("reduce_recording", "adjust_survey"), ("simulate_factory",)),
    Step("adjust_lasers", 1, 4, "corrections of each laser", "sample", ("assign_medians",),
         ("adjust_survey", "simulate_factory")),
    Step("average_set", 1, 5, "parameter sets", "set", ("adjust_lasers",),
         ("simulate_factory", "assign_medians")),
    Step("residuals_calibration", 2, 6, "s of the medians", "sample",
         ("assign_medians", "adjust_lasers"), ("adjust_survey", "simulate_factory")),
    Step("residuals_validation", 0, 6, "s of single scans", "sample",
         ("average_set", "index_recording"),
         ("adjust_survey", "simulate_factory", "simulate_recording")),
    Step("summarise_statistics", 1, 7, "statistics per laser", "study",
         ("residuals_calibration", "residuals_validation")),
    Step("make_table", 0, 8, "tables", "study", ("summarise_statistics",)),
    Step("draw_lasers", 2, 8, "figures", "study", ("summarise_statistics",)),
    Step("write_report", 1, 9, "report", "study", ("summarise_statistics", "draw_lasers"),
         ("index_recording", "adjust_survey", "average_set", "simulate_factory")),
)  # fmt: skip

#: Size of a box, and distance of boxes, in units of the drawing.
_WIDE, _HIGH, _COLUMN, _ROW = 3.3, 0.86, 3.75, 1.22


def flow_table() -> pd.DataFrame:
    """Numbers of the figure of the rules.

    Returns
    -------
    DataFrame
        Columns ``rule``, ``makes``, ``once_per``, ``needs`` (drawn as arrows) and ``also_needs``
        (named in the box), rules with blanks between them.
    """
    return pd.DataFrame(
        {
            "rule": [each.rule for each in STEPS],
            "makes": [each.makes for each in STEPS],
            "once_per": [each.per for each in STEPS],
            "needs": [" ".join(each.needs) for each in STEPS],
            "also_needs": [" ".join(each.also) for each in STEPS],
        }
    )


def draw_flow() -> Figure:
    """Draw the rules as boxes, and what they pass on as arrows.

    Returns
    -------
    Figure
    """
    by_rule = {each.rule: each for each in STEPS}
    taken = {(each.column, each.row) for each in STEPS}
    with style():
        figure = Figure(figsize=(7.0, 7.4))
        ax = figure.subplots()
        ax.set_axis_off()
        half = 0.5 * _WIDE
        ax.set_xlim(-half - 0.45, 2 * _COLUMN + half + 0.1)
        rows = max(each.row for each in STEPS)
        ax.set_ylim(-rows * _ROW - 0.5 * _HIGH - 0.05, 0.5 * _HIGH + 0.05)
        for each in STEPS:
            for name in each.needs:
                _connect(ax, by_rule[name], each, taken)
        for each in STEPS:
            _box(ax, each)
        finish(figure, [], "From a recording to the report: rules of the workflow")
    return figure


def _centre(step: Step) -> Array:
    return np.array([step.column * _COLUMN, -step.row * _ROW])


def _box(ax: Axes, step: Step) -> None:
    x, y = _centre(step)
    given = step.rule in HANDED_OVER
    ax.add_patch(
        FancyBboxPatch(
            (x - 0.5 * _WIDE, y - 0.5 * _HIGH), _WIDE, _HIGH, linewidth=0.8, edgecolor=DARK,
            boxstyle="round,pad=0,rounding_size=0.08",
            facecolor="white" if given else "#EEF4F8",
            linestyle=(0, (4, 2)) if given else "solid", zorder=2.0,
        )
    )  # fmt: skip
    also = ", ".join(SHORT[name] for name in step.also)
    ax.text(x, y + (0.2 if also or given else 0.13), step.makes, ha="center", va="center",
            fontsize=8.2, fontweight="bold", zorder=3.0)  # fmt: skip
    rule = "handed over, or simulated" if given else f"{step.rule}, once per {step.per}"
    ax.text(x, y - (0.04 if also else 0.16), rule, ha="center", va="center", fontsize=6.4,
            color=DARK, zorder=3.0)  # fmt: skip
    if also:
        ax.text(x, y - 0.27, f"with {also}", ha="center", va="center", fontsize=6.4, color=GREY,
                fontstyle="italic", zorder=3.0)  # fmt: skip


def _connect(ax: Axes, source: Step, target: Step, taken: set[tuple[int, int]]) -> None:
    """Arrow between two boxes: straight, or with one corner that lies in no box."""
    start, end = _centre(source), _centre(target)
    side = 0.5 * _WIDE * np.sign(end[0] - start[0])
    if source.column == target.column:
        between = {(source.column, row) for row in range(source.row + 1, target.row)}
        if between & taken:
            # Around the boxes in between, on the left.
            left = start[0] - 0.5 * _WIDE - 0.28
            path = [
                (start[0] - 0.5 * _WIDE, start[1]), (left, start[1]), (left, end[1]),
                (end[0] - 0.5 * _WIDE, end[1]),
            ]  # fmt: skip
        else:
            path = [(start[0], start[1] - 0.5 * _HIGH), (end[0], end[1] + 0.5 * _HIGH)]
    elif (target.column, source.row) in taken:
        path = [(start[0], start[1] - 0.5 * _HIGH), (start[0], end[1]), (end[0] - side, end[1])]
    else:
        path = [(start[0] + side, start[1]), (end[0], start[1]), (end[0], end[1] + 0.5 * _HIGH)]
    xy = np.array(path)
    ax.plot(xy[:-1, 0], xy[:-1, 1], color=DARK, linewidth=0.9, zorder=1.0)
    ax.annotate(
        "", tuple(xy[-1]), tuple(xy[-2]), zorder=1.0,
        arrowprops={"arrowstyle": "-|>", "color": DARK, "linewidth": 0.9, "shrinkA": 0.0,
                    "shrinkB": 0.0, "mutation_scale": 9.0},
    )  # fmt: skip


#: How a sample is used, and its mark and legend.
AVERAGED, VALIDATED = "averaged", "validated"
MEDIANS, SCANS = "medians", "single scans"
_LOOKS = {
    AVERAGED: ("o", COLOURS[0], COLOURS[0], "averaged to the set, and validated with it"),
    VALIDATED: ("o", COLOURS[0], "white", "only validated with the set"),
    MEDIANS: ("s", COLOURS[1], COLOURS[1], "table of its medians"),
    SCANS: ("s", COLOURS[1], "white", "table of its single scans"),
}  # fmt: skip


@dataclass(frozen=True)
class UsedSample:
    """A surveyed sample: its name, scanner and position."""

    name: str
    scanner: str
    position: str


def procedure_table(
    samples: Sequence[UsedSample],
    parameter_sets: Mapping[str, Mapping[str, Sequence[str]]],
    tables: Mapping[str, Table],
) -> pd.DataFrame:
    """Numbers of the figure of the procedure: every use of every sample.

    Parameters
    ----------
    samples : sequence of UsedSample
    parameter_sets : mapping of str to mapping of str to sequence of str
        Samples of every set, by scanner and name.
    tables : mapping of str to Table
        Entries of the configuration.

    Returns
    -------
    DataFrame
        Columns ``sample``, ``scanner``, ``position``, ``column`` (a set with its scanner, or a
        table), and ``use``: `AVERAGED` (single scans of the sample are validated as well) or
        `VALIDATED`, `MEDIANS` or `SCANS`.
    """
    rows = []
    for each in samples:
        same = {"sample": each.name, "scanner": each.scanner, "position": each.position}
        for name, of_set in parameter_sets.get(each.scanner, {}).items():
            use = AVERAGED if each.name in of_set else VALIDATED
            rows.append(same | {"column": f"{name}\n{each.scanner}", "use": use})
        for number, table in tables.items():
            if each.name in table.samples:
                use = MEDIANS if table.data == "calibration" else SCANS
                rows.append(same | {"column": f"Table {ROMAN[number]}", "use": use})
    return pd.DataFrame(rows, columns=["sample", "scanner", "position", "column", "use"])


def draw_procedure(numbers: pd.DataFrame, *, simulated: bool) -> Figure:
    """Draw the numbers of `procedure_table`: samples down, sets and tables across.

    Parameters
    ----------
    numbers : DataFrame
    simulated : bool
        Whether a note says that the recordings are simulated.

    Returns
    -------
    Figure
    """
    names = list(dict.fromkeys(numbers["sample"]))
    of_sets = numbers["use"].isin([AVERAGED, VALIDATED])
    columns = [*dict.fromkeys(numbers.loc[of_sets, "column"])]
    n_sets = len(columns)
    columns += sorted(set(numbers["column"]) - set(columns), key=_by_number)
    with style():
        figure = Figure(figsize=(7.0, 1.6 + 0.32 * len(names)))
        ax = figure.subplots()
        for use, (marker, colour, face, label) in _LOOKS.items():
            own = numbers[numbers["use"] == use]
            if own.empty:
                continue
            ax.plot(
                own["column"].map(columns.index), own["sample"].map(names.index), marker,
                linestyle="none", color=colour, markerfacecolor=face, markersize=7.0,
                markeredgewidth=1.3, label=label,
            )  # fmt: skip
        ax.set_xticks(range(len(columns)), columns)
        ax.xaxis.tick_top()
        first = numbers.drop_duplicates("sample").set_index("sample")
        labels = [f"{n}: {first['scanner'][n]} at {first['position'][n]}" for n in names]
        ax.set_yticks(range(len(names)), labels)
        ax.set_xlim(-0.6, len(columns) - 0.4)
        ax.set_ylim(len(names) - 0.4, -0.6)
        ax.grid(visible=True, axis="both")
        ax.axvline(n_sets - 0.5, color=GREY, linewidth=0.8)
        ax.tick_params(length=0)
        for spine in ax.spines.values():
            spine.set_visible(False)
        finish(figure, [ax], "Recordings that are calibrated on, and that are validated on",
               simulated=simulated, ncols=2)  # fmt: skip
    return figure


def _by_number(table: str) -> int:
    return list(ROMAN.values()).index(table.removeprefix("Table "))
