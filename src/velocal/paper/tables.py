"""Tables II to V: statistics of every window before and after, as CSV, Markdown and LaTeX."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from velocal.errors import ConfigError, VelocalError
from velocal.evaluation.statistics import KEYS, ROTATIONS_FROM, summary_row
from velocal.io.markup import latex_tabular, latex_text, markdown_table
from velocal.paper.best_set import BEFORE, Shown, shown_after
from velocal.study import figures
from velocal.study.windows import WINDOWS

#: Number of a table as the paper writes it.
ROMAN = {"2": "II", "3": "III", "4": "IV", "5": "V"}

#: Columns of the numbers, their decimals, and the statistics that they show. What the paper calls
#: standard deviation is the root mean square about zero.
DECIMALS = {"std_cm": 2, "within_1sigma_pct": 1, "within_3sigma_pct": 1}
STATISTICS = {**{name: name for name in DECIMALS}, "std_cm": "rms_cm"}

#: Columns of the CSV: those of the paper, then which calibration a row shows.
COLUMNS = (
    "table", "scanner", "sample", "window", "calibration", *DECIMALS, "role", "parameter_set",
)  # fmt: skip

#: Said beside every table and figure of a simulated study.
SIMULATED = "The recordings are simulated: the authors of the paper never published theirs."

#: What the numbers are.
QUANTITIES = (
    "Standard deviation: mean over the lasers of the root mean square of s about zero. Shares: of "
    "all s within one and three standard deviations of the datasheet."
)

#: What the rows are made from, by `data`.
DATA = {
    "calibration": "medians of the windows",
    "validation": "single rotations next to the windows",
}

_HEADINGS = {
    "sample": "Sample",
    "window": "Window",
    "calibration": "Calibration",
    "std_cm": "Std [cm]",
    "within_1sigma_pct": "Within 1 sigma [%]",
    "within_3sigma_pct": "Within 3 sigma [%]",
}
_NUMERIC = [column in DECIMALS for column in _HEADINGS]


@dataclass(frozen=True)
class Table:
    """A table of windows before and after calibration.

    Attributes
    ----------
    number : str
        Roman.
    frame : DataFrame
        Columns `COLUMNS`, numbers with all digits; all rows before, then all rows after.
    caption : str
        What is shown.
    notes : tuple of str
        Which parameters "after" stands for, what the numbers are, whether they are simulated.
    """

    number: str
    frame: pd.DataFrame
    caption: str
    notes: tuple[str, ...]


def summarised(lasers: pd.DataFrame) -> pd.DataFrame:
    """Reduce the statistics of all lasers to one row per window, data and calibration.

    Parameters
    ----------
    lasers : DataFrame
        Columns of `statistics_table`.

    Returns
    -------
    DataFrame
        Columns `KEYS`, `ROTATIONS_FROM`, and those of `summary_row`.
    """
    keys = [*KEYS, ROTATIONS_FROM]
    rows = [
        {**dict(zip(keys, key, strict=True)), **summary_row({str(k): v for k, v in group.items()})}
        for key, group in lasers.groupby(keys, sort=False)
    ]
    return pd.DataFrame(rows)


def build(
    number: str, selection: figures.Table, summary: pd.DataFrame, *, simulated: bool
) -> Table:
    """Put a table together.

    Parameters
    ----------
    number : str
        Arabic number of the table, a key of `ROMAN`.
    selection : figures.Table
        Entry of the configuration.
    summary : DataFrame
        Statistics of all windows.
    simulated : bool
        Whether the recordings are simulated.

    Returns
    -------
    Table

    Raises
    ------
    VelocalError
        If the number is not one of the paper's, or a window is missing in the summary.
    """
    if number not in ROMAN:
        raise ConfigError(f"no table {number!r}", where="tables", allowed=", ".join(ROMAN))
    scanner, data, samples = selection.scanner, selection.data, selection.samples
    after = shown_after(summary, scanner, samples, data, f"tables.{number}")
    of_data = summary[(summary["scanner"] == scanner) & (summary["data"] == data)]
    wanted = pd.MultiIndex.from_product([samples, WINDOWS], names=["sample", "window"])
    halves = []
    for calibration, shown in (("before", BEFORE), ("after", after)):
        rows = shown.rows(of_data).set_index(wanted.names)
        missing = [each for each in wanted if each not in rows.index]
        if missing:
            sample, window = missing[0]
            raise VelocalError(
                f"no statistics of {scanner}, sample {sample!r}, window {window!r}, "
                f"{data} data, {calibration} calibration",
                where=f"tables.{number}",
                allowed="samples of that scanner: " + ", ".join(dict.fromkeys(of_data["sample"])),
            )
        numbers = rows.loc[wanted, list(STATISTICS.values())].astype(float)
        halves.append(
            numbers.set_axis(list(STATISTICS), axis=1)
            .reset_index()
            .assign(table=ROMAN[number], scanner=scanner)
            .assign(calibration=calibration, **shown.identity)
        )
    return Table(
        ROMAN[number],
        pd.concat(halves, ignore_index=True)[list(COLUMNS)],
        f"{scanner}, {data} data ({DATA[data]}): residuals s before and after calibration.",
        (
            _after_note(after),
            QUANTITIES,
            *_without_spare(of_data[of_data["sample"].isin(samples)]),
            *([SIMULATED] if simulated else []),
        ),
    )


def _without_spare(rows: pd.DataFrame) -> list[str]:
    """Note on validation data that are not independent of the window's medians."""
    own = rows[(rows["data"] == "validation") & (rows[ROTATIONS_FROM] == "window")]
    if own.empty:
        return []
    which = ", ".join(dict.fromkeys(own["sample"] + " " + own["window"]))
    return [
        f"The windows of these recordings leave no rotations outside, so that rotations of the "
        f"window itself are shown, from which its medians were made as well: {which}."
    ]


def _after_note(after: Shown) -> str:
    before = "Before: the factory's parameters. "
    if not after.parameter_set:
        return before + "After: the parameters adjusted on the window itself."
    if len(after.means_cm) == 1:
        return before + f"After: parameter set {after.parameter_set}, the only one."
    listed = ", ".join(f"{name} {mean:.2f} cm" for name, mean in after.means_cm.items())
    return before + (
        f"After: parameter set {after.parameter_set}, that of least mean standard deviation over "
        f"the rows of this table ({listed}). It is chosen on the validation data themselves, as in "
        "the paper."
    )


def formatted(frame: pd.DataFrame) -> pd.DataFrame:
    """Round the numbers of a table for print, as text; an empty text where there is none."""
    text = frame.copy()
    for name, decimals in DECIMALS.items():
        text[name] = [
            "" if pd.isna(value) else f"{value:.{decimals}f}" for value in frame[name].tolist()
        ]
    return text


def _cells(table: Table) -> list[list[str]]:
    rows: list[list[str]] = formatted(table.frame)[list(_HEADINGS)].to_numpy().tolist()
    return rows


def to_markdown(table: Table, *, numbered: bool = True) -> str:
    """Table as Markdown with caption and notes; with the paper's number where it is one of it."""
    number = f"**Table {table.number}.** " if numbered else ""
    lines = [number + table.caption, ""]
    lines += markdown_table(list(_HEADINGS.values()), _cells(table), _NUMERIC)
    return "\n".join([*lines, "", "\n\n".join(table.notes)]) + "\n"


def to_latex(table: Table) -> str:
    """Table as a LaTeX ``table`` for the package booktabs, with caption and notes."""
    headings = [
        latex_text(each).replace("1 sigma", r"$1\sigma$").replace("3 sigma", r"$3\sigma$")
        for each in _HEADINGS.values()
    ]
    rows = _cells(table)
    lines = [
        "% needs \\usepackage{booktabs}",
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{latex_text(table.caption)}}}",
        rf"\label{{tab:velocal-{table.number}}}",
        *latex_tabular(headings, rows, _NUMERIC, block=len(rows) // 2),
        "",
        rf"{{\raggedright\footnotesize {latex_text(' '.join(table.notes))}\par}}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"
