"""One table of the paper, from the statistics of all windows."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal.errors import reported
from velocal.evaluation.statistics import KEYS
from velocal.io import storage
from velocal.paper import tables


def main(
    summary: Path,
    csv: Path,
    md: Path,
    tex: Path,
    *,
    number: str,
    selection: Mapping[str, Any],
    simulated: bool,
) -> None:
    """Write the table as CSV, Markdown and LaTeX."""
    statistics = pd.DataFrame(storage.read_csv(summary, text=KEYS))
    table = tables.build(number, selection, statistics, simulated=simulated)
    storage.write_csv(csv, tables.formatted(table.frame))
    storage.write_text(md, tables.to_markdown(table))
    storage.write_text(tex, tables.to_latex(table))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.summary),
            Path(snakemake.output.csv),
            Path(snakemake.output.md),
            Path(snakemake.output.tex),
            number=snakemake.params.number,
            selection=snakemake.params.table,
            simulated=snakemake.params.simulated,
        )
