"""Put the statistics of all windows together, and reduce each window to one row."""

from pathlib import Path

import pandas as pd

from velocal.errors import reported
from velocal.io import storage
from velocal.paper.tables import summarised


def main(parts: list[Path], lasers: Path, summary: Path) -> None:
    """Write one table of all lasers and one of all windows."""
    every = pd.concat([pd.read_csv(part) for part in parts], ignore_index=True)
    storage.write_csv(lasers, every)
    storage.write_csv(summary, summarised(every))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            [Path(path) for path in snakemake.input.statistics],
            Path(snakemake.output.lasers),
            Path(snakemake.output.summary),
        )
