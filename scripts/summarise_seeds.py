"""Mean and spread of every entry of the tables over the seeds."""

from pathlib import Path

import pandas as pd

from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper.replicate import spread


def main(
    *,
    replicas: list[Path],
    agreement: Path,
    seeds: list[int],
) -> None:
    """Write the comparison; `seeds` are those of every replica."""
    cells = [pd.read_csv(path) for path in replicas]
    storage.write_csv(agreement, spread(dict(zip(seeds, cells, strict=True))))


if "snakemake" in globals():
    run(main, snakemake)
