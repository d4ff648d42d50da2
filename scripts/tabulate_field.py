"""Put the planes of all samples without a survey into one table."""

from pathlib import Path

import pandas as pd

from velocal.io import storage
from velocal.io.scripts import run
from velocal.reporting.figures.unsurveyed import TABLE, field_markdown


def main(
    *,
    planes: list[Path],
    csv: Path,
    md: Path,
) -> None:
    """Write one row per sample and plane as CSV and Markdown; a finding is a row of its own."""
    rows = []
    for found in map(storage.read_json, planes):
        heading = {"sample": found["sample"], "scanner": found["scanner"]}
        rows += [{**heading, **plane} for plane in found["planes"]]
        rows += [{**heading, "finding": finding} for finding in found["findings"]]
    table = pd.DataFrame(rows, columns=list(TABLE))
    storage.write_csv(csv, table)
    storage.write_text(md, field_markdown(table))


if "snakemake" in globals():
    run(main, snakemake)
