"""Tables II to V: statistics of every window before and after, as CSV, Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from velocal.errors import ConfigError, VelocalError
from velocal.evaluation.statistics import calibration_after, mean_std_of_sets, summary_row
from velocal.study.samples import WINDOWS

#: Number of a table as the paper writes it.
ROMAN = {"2": "II", "3": "III", "4": "IV", "5": "V"}

#: Columns of the numbers and their decimals.
DECIMALS = {"std_cm": 2, "within_1sigma_pct": 1, "within_3sigma_pct": 1}

#: Columns of the CSV.
COLUMNS = ("table", "scanner", "sample", "window", "calibration", *DECIMALS)

#: Said beside every table and figure of a simulated study.
SIMULATED = "The recordings are simulated: the authors of the paper never published theirs."

#: What the numbers are.
QUANTITIES = (
    "Standard deviation: mean over the lasers of the root mean square of s about zero. Shares: of "
    "all s within one and three standard deviations of the datasheet."
)

#: What the rows are made from, by `data`.
DATA = {"calibration": "medians of the windows", "validation": "single scans of the windows"}

_HEADINGS = {
    "sample": "Sample",
    "window": "Window",
    "calibration": "Calibration",
    "std_cm": "Std [cm]",
    "within_1sigma_pct": "Within 1 sigma [%]",
    "within_3sigma_pct": "Within 3 sigma [%]",
}


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
    """Reduce the statistics of all lasers to one row per window, data and calibration."""
    keys = ["scanner", "sample", "window", "data", "calibration"]
    rows = [
        {**dict(zip(keys, key, strict=True)), **summary_row({str(k): v for k, v in group.items()})}
        for key, group in lasers.groupby(keys, sort=False)
    ]
    return pd.DataFrame(rows)


def build(
    number: str, selection: Mapping[str, Any], summary: pd.DataFrame, *, simulated: bool
) -> Table:
    """Put a table together.

    Parameters
    ----------
    number : str
        Arabic number of the table, a key of `ROMAN`.
    selection : mapping
        Entry of the configuration: ``scanner``, ``samples``, ``data``.
    summary : DataFrame
        Statistics of all windows.
    simulated : bool
        Whether the recordings are simulated.

    Raises
    ------
    VelocalError
        If the number is not one of the paper's, or a window is missing in the summary.
    """
    if number not in ROMAN:
        raise ConfigError(f"no table {number!r}", where="tables", allowed=", ".join(ROMAN))
    scanner, data = str(selection["scanner"]), str(selection["data"])
    samples = [str(sample) for sample in selection["samples"]]
    columns = {str(name): summary[name].to_numpy() for name in summary}
    after = calibration_after(columns, scanner, samples, data)
    of_data = summary[(summary["scanner"] == scanner) & (summary["data"] == data)]
    rows = {
        (str(row["calibration"]), str(row["sample"]), str(row["window"])): row
        for row in of_data.to_dict(orient="records")
    }
    records = []
    for calibration, shown in {"before": "before", "after": after}.items():
        for sample in samples:
            for window in WINDOWS:
                found = rows.get((shown, sample, window))
                if found is None:
                    raise VelocalError(
                        f"no statistics of {scanner}, sample {sample!r}, window {window!r}, "
                        f"{data} data, calibration {shown!r}",
                        where=f"tables.{number}",
                        allowed="samples of that scanner: "
                        + ", ".join(dict.fromkeys(map(str, of_data["sample"]))),
                    )
                values = {name: float(found[name]) for name in DECIMALS}
                key = (ROMAN[number], scanner, sample, window, calibration)
                records.append({**dict(zip(COLUMNS, key, strict=False)), **values})
    return Table(
        ROMAN[number],
        pd.DataFrame(records, columns=list(COLUMNS)),
        f"{scanner}, {data} data ({DATA[data]}): residuals s before and after calibration.",
        (
            _after_note(columns, scanner, samples, data, after),
            QUANTITIES,
            *([SIMULATED] if simulated else []),
        ),
    )


def _after_note(
    columns: Mapping[str, Any], scanner: str, samples: list[str], data: str, after: str
) -> str:
    before = "Before: the factory's parameters. "
    if data == "calibration":
        return before + "After: the parameters adjusted on the window itself."
    means = mean_std_of_sets(columns, scanner, samples)
    if len(means) == 1:
        return before + f"After: parameter set {after}, the only one."
    listed = ", ".join(f"{name} {mean:.2f} cm" for name, mean in means.items())
    return before + (
        f"After: parameter set {after}, that of least mean standard deviation over the rows of "
        f"this table ({listed}). It is chosen on the validation data themselves, as in the paper."
    )


def formatted(frame: pd.DataFrame) -> pd.DataFrame:
    """Round the numbers of a table for print, as text; an empty text where there is none."""
    text = frame.copy()
    for name, decimals in DECIMALS.items():
        text[name] = [
            "" if pd.isna(value) else f"{value:.{decimals}f}" for value in frame[name].tolist()
        ]
    return text


def to_markdown(table: Table) -> str:
    """Table as Markdown with caption and notes."""
    lines = [f"**Table {table.number}.** {table.caption}", ""]
    lines.append("| " + " | ".join(_HEADINGS.values()) + " |")
    lines.append("|" + "|".join("---:" if c in DECIMALS else "---" for c in _HEADINGS) + "|")
    for row in formatted(table.frame)[list(_HEADINGS)].to_numpy().tolist():
        lines.append("| " + " | ".join(str(cell).replace("|", r"\|") for cell in row) + " |")
    lines += ["", *(part for note in table.notes for part in (note, ""))]
    return "\n".join(lines).rstrip("\n") + "\n"


_LATEX_SPECIAL = {
    "\\": r"\textbackslash{}",
    **{character: f"\\{character}" for character in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
}


def _latex(text: str) -> str:
    return "".join(_LATEX_SPECIAL.get(character, character) for character in text)


def to_latex(table: Table) -> str:
    """Table as a LaTeX ``table`` for the package booktabs, with caption and notes."""
    alignment = "".join("r" if column in DECIMALS else "l" for column in _HEADINGS)
    headings = " & ".join(_latex(heading) for heading in _HEADINGS.values())
    rows = formatted(table.frame)[list(_HEADINGS)].to_numpy().tolist()
    half = len(rows) // 2
    lines = [
        "% needs \\usepackage{booktabs}",
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{_latex(table.caption)}}}",
        rf"\label{{tab:velocal-{table.number}}}",
        rf"\begin{{tabular}}{{{alignment}}}",
        r"\toprule",
        headings.replace("1 sigma", r"$1\sigma$").replace("3 sigma", r"$3\sigma$") + r" \\",
        r"\midrule",
    ]
    for number, row in enumerate(rows):
        if number == half:
            lines.append(r"\midrule")
        lines.append(" & ".join(_latex(str(cell)) for cell in row) + r" \\")
    lines += [r"\bottomrule", r"\end{tabular}", ""]
    lines += [rf"{{\raggedright\footnotesize {_latex(' '.join(table.notes))}\par}}"]
    lines += [r"\end{table}"]
    return "\n".join(lines) + "\n"
