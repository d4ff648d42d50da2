"""How close a study comes to the paper: every printed entry and statement beside ours.

The paper's recordings were never published: on simulated recordings agreement shows that the
simulator was calibrated well, and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from velocal.errors import VelocalError
from velocal.evaluation.statistics import KEYS
from velocal.paper.printed import DATA, LABELS, PREFIX, TOLERANCES, printed_rows, printed_statements
from velocal.paper.tables import DECIMALS, STATISTICS
from velocal.scanner.models import scanner_named

#: Columns of the agreement.
COLUMNS = ("item", "paper", "reproduced", "difference", "tolerance", "within")
#: Items of a survey's accuracy, by what the statement is about.
ACCURACY = {"gcp": "control_points", "target": "targets", "base_local": "base_field",
            "base_scanner": "base_scanner"}  # fmt: skip
_WALLS = {"short_wall": "short", "long_wall": "long"}


def statistics_shown(summary: pd.DataFrame, tables: pd.DataFrame) -> pd.DataFrame:
    """Statistics behind the rows of the reproduced tables, with all their digits.

    Parameters
    ----------
    summary : DataFrame
        Statistics of all windows.
    tables : DataFrame
        Reproduced Tables II to V, one below the other, columns `tables.COLUMNS`.

    Returns
    -------
    DataFrame
        A row per row of the tables: ``table``, ``calibration`` and the columns of the summary.

    Raises
    ------
    VelocalError
        If a table shows other numbers than the statistics.
    """
    shown = tables.assign(data=tables["table"].map(DATA))
    joined = shown.merge(
        summary, on=list(KEYS), how="left", suffixes=("_shown", ""), validate="many_to_one"
    )
    for name, of in STATISTICS.items():
        printed = shown[name].replace("", np.nan).to_numpy(dtype=float)
        rounding = 0.51 * 10.0 ** -DECIMALS[name]
        same = np.isclose(joined[of], printed, rtol=0.0, atol=rounding, equal_nan=True)
        if not same.all():
            row = joined[~same].iloc[0]
            raise VelocalError(
                f"the rows {row['calibration']!r} do not show numbers of the statistics",
                where=f"table {row['table']}",
                hint="The table was made from other statistics; make it again.",
            )
    return joined[["table", "calibration", *summary.columns]]


def of_cells(shown: pd.DataFrame) -> pd.DataFrame:
    """Compare every printed entry with the reproduced one.

    Parameters
    ----------
    shown : DataFrame
        As `statistics_shown` gives it.

    Returns
    -------
    DataFrame
        One row per printed row and quantity, columns `COLUMNS`. Numbers have three decimals, and
        `within` is what they say: "true" if the difference is not larger than the tolerance.

    Raises
    ------
    VelocalError
        If a printed row has no counterpart, or one without residuals.
    """
    found = {
        tuple(str(row[key]) for key in LABELS): row
        for row in shown.dropna(subset=list(STATISTICS.values())).to_dict(orient="records")
    }
    cells: list[dict[str, Any]] = []
    for row in printed_rows():
        ours = found.get(row.key)
        if ours is None:
            raise VelocalError(
                f"nothing is reproduced for {row.item('').strip()!r}",
                where=f"table {row.table}",
                allowed=f"a row of {row.scanner}, sample {row.reproduced_sample}, "
                f"window {row.window}, with residuals",
                hint="The paper's Tables II to V need its own samples sa1 to sa6 and tables 2 to "
                "5; in a study of your own leave out compare_with_paper.",
            )
        cells += [
            judged(row.item(name), row.values[name], ours[STATISTICS[name]], tolerance)
            for name, tolerance in TOLERANCES.items()
        ]
    return pd.DataFrame(cells, columns=list(COLUMNS))


def unexpected(agreement: pd.DataFrame, known: Mapping[str, str]) -> list[str]:
    """What of an agreement is not as it was, a line each.

    Parameters
    ----------
    agreement : DataFrame
        Columns `COLUMNS`, all items of the study.
    known : mapping of str to str
        Items that are known to be missed, with the reason (`printed.known_misses`).

    Returns
    -------
    list of str
        Items that are missed and not known to be, then known misses that are met or do not exist.
    """
    missed = agreement[agreement["within"] != "true"]
    fresh = missed[~missed["item"].isin(list(known))]
    lines = [
        f"{row['item']}: printed {row['paper']:g}, reproduced {row['reproduced']:g}, "
        f"allowed difference {row['tolerance']:g}"
        for row in fresh.to_dict(orient="records")
    ]
    return lines + [
        f"{item}: is listed as a known miss, but it is not missed"
        for item in known
        if item not in set(missed["item"])
    ]


def check(agreement: pd.DataFrame, known: Mapping[str, str]) -> pd.DataFrame:
    """Refuse an agreement that has become another one.

    Parameters
    ----------
    agreement, known
        As for `unexpected`.

    Returns
    -------
    DataFrame
        The items that are missed, with the column ``reason``.

    Raises
    ------
    VelocalError
        If an item is missed that is not known to be, or a known miss is met or does not exist.
    """
    if lines := unexpected(agreement, known):
        raise VelocalError(
            f"{len(lines)} of {len(agreement)} items are not as they were:\n  "
            + "\n  ".join(lines),
            where="agreement with the paper",
            allowed="the misses of known_misses.csv and no others",
            hint="Numbers of the study have changed. If that is meant, change known_misses.csv and "
            "give the reason of every miss.",
        )
    missed = agreement[agreement["within"] != "true"]
    return missed.assign(reason=missed["item"].map(known))


def judged(item: str, paper: float, reproduced: float, tolerance: float) -> dict[str, Any]:
    """Row of the agreement: numbers with three decimals, and the verdict that they give.

    Parameters
    ----------
    item : str
    paper, reproduced, tolerance : float

    Returns
    -------
    dict
        Columns `COLUMNS`.
    """
    reproduced = round(reproduced, 3)
    difference = round(reproduced - paper, 3) + 0.0  # no -0.0
    within = "true" if abs(difference) <= tolerance else "false"
    values = (item, paper, reproduced, difference, tolerance, within)
    return dict(zip(COLUMNS, values, strict=True))


def of_statements(found: Mapping[str, float], *, partial: bool = False) -> pd.DataFrame:
    """Compare every statement of the text with the reproduced number.

    Parameters
    ----------
    found : mapping of str to float
        Reproduced numbers by item.
    partial : bool
        Leave out the statements that are not reproduced.

    Returns
    -------
    DataFrame
        Columns `COLUMNS`.

    Raises
    ------
    VelocalError
        If a statement is not reproduced, unless `partial`.
    """
    rows = []
    for row in printed_statements().to_dict(orient="records"):
        name = str(row["item"])
        if name not in found:
            if partial:
                continue
            raise VelocalError(
                f"nothing is reproduced for statement {name!r}",
                where="agreement with the paper",
                hint="In a study of your own leave out compare_with_paper.",
            )
        rows.append(judged(PREFIX + name, row["paper"], found[name], row["tolerance"]))
    return pd.DataFrame(rows, columns=list(COLUMNS))


def said_by_tables(shown: pd.DataFrame) -> dict[str, float]:
    """Numbers of the text that are means over the rows of a table.

    Lasers: those whose variance about zero is significantly below sigma^2 by the paper's test,
    which takes residuals as independent; the test for correlated residuals has no printed number.
    About the laser's own mean nearly all of them comply before any calibration, which is not what
    was printed.

    Parameters
    ----------
    shown : DataFrame
        As `statistics_shown` gives it.

    Returns
    -------
    dict of str to float
        By item.
    """
    found = {}
    for (scanner, data, calibration), rows in shown.groupby(["scanner", "data", "calibration"]):
        short = scanner_named(str(scanner)).short_name
        found[f"lasers_{calibration}_{data}_{short}"] = float(rows["complies_zero"].mean())
        if data == "validation":
            found[f"indoor_{calibration}_{short}"] = float(rows["rms_cm"].mean())
    return found


def said_by_accuracy(accuracy: pd.DataFrame) -> dict[str, float]:
    """Accuracy (mm) and number of points, out of the accuracy of the adjusted survey."""
    rows = accuracy.set_index("item")
    found = {f"{name}_mse": float(rows["value_mm"][item]) for name, item in ACCURACY.items()}
    found |= {f"{name}_count": float(rows["points"][ACCURACY[name]]) for name in ("gcp", "target")}
    return found


def said_by_surveys(surveys: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """Flatness of the walls (mm) and number of base targets, out of surveys of positions."""
    found: dict[str, float] = {}
    for survey in surveys:
        short = scanner_named(survey["scanner"]).short_name
        found[f"base_targets_{short}"] = len(survey["pose"]["targets"])
        for plane in survey["planes"]:
            if wall := _WALLS.get(plane["name"]):
                found[f"flatness_{wall}_mean"] = plane["flatness_mean_m"] * 1e3
                found[f"flatness_{wall}_max"] = plane["flatness_max_m"] * 1e3
    return found


@dataclass(frozen=True)
class Cell:
    """A printed number beside ours.

    Attributes
    ----------
    item : str
    paper, reproduced, difference, tolerance : float
    within : bool
        Whether the difference is within the tolerance.
    """

    item: str
    paper: float
    reproduced: float
    difference: float
    tolerance: float
    within: bool


@dataclass(frozen=True)
class Count:
    """How many entries of a quantity are within their tolerance.

    Attributes
    ----------
    quantity : str
    of : dict of str to (int, int)
        Entries within their tolerance and all entries, by table and for "all".
    """

    quantity: str
    of: dict[str, tuple[int, int]]


def cells(table: pd.DataFrame | None) -> dict[str, Cell]:
    """Rows of the agreement by item, also where they were read from a file."""
    if table is None:
        return {}
    rows = table[list(COLUMNS)].assign(within=table["within"].astype(str).str.lower() == "true")
    return {row[0]: Cell(*row) for row in rows.itertuples(index=False)}


def counts(judged_cells: Mapping[str, Cell]) -> list[Count]:
    """Count the entries within their tolerance: per quantity for every table, and in all."""
    if not judged_cells:
        return []
    found = []
    for quantity in TOLERANCES:
        verdicts: dict[str, list[bool]] = {}
        for row in printed_rows():
            verdicts.setdefault(row.table, []).append(judged_cells[row.item(quantity)].within)
        verdicts["all"] = [verdict for each in verdicts.values() for verdict in each]
        found.append(Count(quantity, {name: (sum(v), len(v)) for name, v in verdicts.items()}))
    return found


def statements_of(judged_cells: Mapping[str, Cell]) -> list[dict[str, Any]]:
    """Statements of the text: ``what`` they say, ``where``, ``unit``, and the ``cell``."""
    return [
        {"cell": judged_cells[item], **{key: row[key] for key in ("what", "where", "unit")}}
        for row in printed_statements().to_dict(orient="records")
        if (item := PREFIX + str(row["item"])) in judged_cells
    ]
