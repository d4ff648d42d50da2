"""Every printed entry of the paper's tables, and every number of its text, beside ours."""

from pathlib import Path

import pandas as pd

from velocal.evaluation.statistics import KEYS
from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper import agreement as paper


def _frame(path: Path) -> pd.DataFrame:
    return pd.DataFrame(storage.read_csv(path, text=(*KEYS, "table")))


def main(
    *,
    summary: Path,
    tables: list[Path],
    surveys: list[Path],
    accuracy: Path,
    facts: list[Path],
    agreement: Path,
) -> None:
    """Write the comparison as CSV; facts are tables with columns `item` and `value`."""
    every = pd.concat([_frame(path) for path in tables], ignore_index=True)
    shown = paper.statistics_shown(_frame(summary), every)
    found = paper.said_by_tables(shown)
    found |= paper.said_by_surveys([storage.read_json(path) for path in surveys])
    found |= paper.said_by_accuracy(_frame(accuracy))
    for path in facts:
        table = _frame(path)
        found |= dict(zip(table["item"], table["value"].astype(float), strict=True))
    parts = [paper.of_cells(shown), paper.of_statements(found)]
    storage.write_csv(agreement, pd.concat(parts, ignore_index=True))


if "snakemake" in globals():
    run(main, snakemake)
