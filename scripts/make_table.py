"""One table of the paper, from the statistics of all windows."""

from pathlib import Path

import pandas as pd

from velocal.evaluation.statistics import KEYS
from velocal.io import storage
from velocal.io.scripts import for_each, run
from velocal.paper import tables
from velocal.study.figures import Table


@for_each("csv", "md", "tex", "table", "selection")
def main(
    *,
    summary: Path,
    csv: Path,
    md: Path,
    tex: Path,
    table: str,
    selection: Table,
    simulated: bool,
    of_paper: bool,
) -> None:
    """Write the table as CSV, Markdown and LaTeX."""
    statistics = pd.DataFrame(storage.read_csv(summary, text=KEYS))
    built = tables.build(table, selection, statistics, simulated=simulated)
    storage.write_csv(csv, tables.formatted(built.frame))
    storage.write_text(md, tables.to_markdown(built, numbered=of_paper))
    storage.write_text(tex, tables.to_latex(built))


if "snakemake" in globals():
    run(main, snakemake)
