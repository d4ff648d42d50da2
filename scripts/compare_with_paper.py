"""Every printed cell of the paper's tables, and every number of its text, beside ours."""

from pathlib import Path

import pandas as pd

from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper import printed as published
from velocal.paper import statements


def _frame(path: Path) -> pd.DataFrame:
    return pd.DataFrame(storage.read_csv(path))


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
    shown = pd.concat([_frame(path) for path in tables], ignore_index=True)
    every = _frame(summary)
    found = statements.of_tables(published.sources_of(every, shown))
    found |= statements.of_surveys([storage.read_json(path) for path in surveys])
    found |= statements.of_accuracy(_frame(accuracy))
    for path in facts:
        table = _frame(path)
        found |= dict(zip(table["item"], table["value"].astype(float), strict=True))
    parts = [published.agreement(every, shown), statements.agreement(found)]
    storage.write_csv(agreement, pd.concat(parts, ignore_index=True))


if "snakemake" in globals():
    run(main, snakemake)
