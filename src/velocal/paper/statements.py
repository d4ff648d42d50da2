"""Numbers in the paper's text, beside the reproduced ones.

``data/statements.csv`` holds them as printed, each with a tolerance of its own. What a
number is reproduced by is named here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal.errors import VelocalError
from velocal.paper.printed import COLUMNS, TOLERANCES_OF_MEAN, Source, judged, printed_rows
from velocal.scanner.models import scanner_named

PRINTED = Path(__file__).parent / "data" / "statements.csv"

#: What begins the item of a statement in the agreement.
PREFIX = "text "
#: Tables behind the statements about indoor samples: calibration and validation data.
TABLES = {("calibration", "64"): "II", ("calibration", "32"): "III"}
TABLES |= {("validation", "64"): "IV", ("validation", "32"): "V"}


def printed() -> pd.DataFrame:
    """Statements as printed: item, what, where, paper, unit, tolerance, tolerance_of_mean."""
    return pd.read_csv(PRINTED, comment="#")


def tolerances_of_mean() -> dict[str, float]:
    """By item of the agreement, how far the mean over many seeds may be from the printed one."""
    rows = printed()
    cells = {
        row.item(quantity): tolerance
        for row in printed_rows()
        for quantity, tolerance in TOLERANCES_OF_MEAN.items()
    }
    return cells | {
        PREFIX + str(item): float(tolerance)
        for item, tolerance in zip(rows["item"], rows["tolerance_of_mean"], strict=True)
    }


def of_tables(sources: Mapping[tuple[str, str], Source]) -> dict[str, float]:
    """Statements that are means over the rows of a table, out of `published.sources_of`.

    Lasers: those whose variance about zero is significantly below sigma^2. About the laser's own
    mean nearly all of them comply before any calibration, which is not what was printed.
    """
    found = {}
    for (data, scanner), table in TABLES.items():
        for calibration in ("before", "after"):
            rows = pd.DataFrame(sources[table, calibration].values())
            found[f"lasers_{calibration}_{data}_{scanner}"] = float(rows["complies_zero"].mean())
            if data == "validation":
                found[f"indoor_{calibration}_{scanner}"] = float(rows["std_cm"].mean())
    return found


#: Items of a survey's accuracy, by what the statement is about.
ACCURACY = {"gcp": "control_points", "target": "targets", "base_local": "base_field",
            "base_scanner": "base_scanner"}  # fmt: skip


def of_accuracy(accuracy: pd.DataFrame) -> dict[str, float]:
    """Accuracy (mm) and number of points, out of the accuracy of the adjusted survey."""
    rows = accuracy.set_index("item")
    found = {f"{name}_mse": float(rows["value_mm"][item]) for name, item in ACCURACY.items()}
    found |= {f"{name}_count": float(rows["points"][ACCURACY[name]]) for name in ("gcp", "target")}
    return found


def of_surveys(surveys: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """Flatness of the walls (mm) and number of base targets, out of surveys of positions."""
    found: dict[str, float] = {}
    for survey in surveys:
        scanner = scanner_named(survey["scanner"])
        found[f"base_targets_{scanner.short_name}"] = len(survey["pose"]["targets"])
        for plane in survey["planes"]:
            wall = {"short_wall": "short", "long_wall": "long"}.get(plane["name"])
            if wall:
                found[f"flatness_{wall}_mean"] = plane["flatness_mean_m"] * 1e3
                found[f"flatness_{wall}_max"] = plane["flatness_max_m"] * 1e3
    return found


def agreement(found: Mapping[str, float], *, partial: bool = False) -> pd.DataFrame:
    """Compare every statement with the reproduced number.

    Parameters
    ----------
    found : mapping of str to float
        Reproduced numbers by item.
    partial : bool
        Leave out the statements that are not reproduced.

    Raises
    ------
    VelocalError
        If a statement is not reproduced, unless `partial`.
    """
    rows = []
    for row in printed().to_dict(orient="records"):
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
