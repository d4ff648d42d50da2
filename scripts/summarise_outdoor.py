"""Put the outdoor samples together: one row each, and means per kind of sample."""

from pathlib import Path

import pandas as pd

from velocal.evaluation.candidates import IDENTITY
from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper.outdoor import HEADING, summarise
from velocal.paper.outdoor import facts as single_numbers


def main(*, panels: list[Path], summary: Path, means: Path, facts: Path) -> None:
    """Write the tables as CSV."""
    text = (*HEADING, *IDENTITY, "panel")
    tables = [pd.DataFrame(storage.read_csv(path, text=text)) for path in panels]
    samples, of_kinds = summarise(pd.concat(tables, ignore_index=True))
    storage.write_csv(summary, samples)
    storage.write_csv(means, of_kinds)
    storage.write_csv(facts, pd.DataFrame(single_numbers(of_kinds)))


if "snakemake" in globals():
    run(main, snakemake)
