"""Put the statistics of all windows together, and reduce each window to one row."""

from pathlib import Path

import pandas as pd

from velocal.evaluation.statistics import KEYS
from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper.tables import summarised


def main(
    *,
    statistics: list[Path],
    lasers: Path,
    summary: Path,
) -> None:
    """Write one table of all lasers and one of all windows."""
    tables = [pd.DataFrame(storage.read_csv(part, text=KEYS)) for part in statistics]
    every = pd.concat(tables, ignore_index=True)
    storage.write_csv(lasers, every)
    storage.write_csv(summary, summarised(every))


if "snakemake" in globals():
    run(main, snakemake)
