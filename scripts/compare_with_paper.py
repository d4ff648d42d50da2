"""Every printed cell of the paper's tables, and every number of its text, beside ours."""

from pathlib import Path

import pandas as pd

from velocal.errors import reported
from velocal.evaluation.statistics import KEYS
from velocal.io import storage
from velocal.paper import agreement


def _frame(path: Path) -> pd.DataFrame:
    return pd.DataFrame(storage.read_csv(path, text=(*KEYS, "table")))


def main(
    summary: Path,
    tables: list[Path],
    surveys: list[Path],
    accuracy: Path,
    facts: list[Path],
    output: Path,
) -> None:
    """Write the comparison as CSV; facts are tables with columns `item` and `value`."""
    every = pd.concat([_frame(path) for path in tables], ignore_index=True)
    shown = agreement.statistics_shown(_frame(summary), every)
    found = agreement.said_by_tables(shown)
    found |= agreement.said_by_surveys([storage.read_json(path) for path in surveys])
    found |= agreement.said_by_accuracy(_frame(accuracy))
    for path in facts:
        table = _frame(path)
        found |= dict(zip(table["item"], table["value"].astype(float), strict=True))
    parts = [agreement.of_cells(shown), agreement.of_statements(found)]
    storage.write_csv(output, pd.concat(parts, ignore_index=True))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.summary),
            [Path(path) for path in snakemake.input.tables],
            [Path(path) for path in snakemake.input.surveys],
            Path(snakemake.input.accuracy),
            [Path(path) for path in snakemake.input.facts],
            Path(snakemake.output.agreement),
        )
