"""Mean and spread of every cell of the tables over the seeds."""

from pathlib import Path

import pandas as pd

from velocal.errors import reported
from velocal.io import storage
from velocal.paper.replicate import spread


def main(replicas: list[Path], agreement: Path, *, seeds: list[int]) -> None:
    """Write the comparison; replicas are the files of the seeds in order."""
    cells = [pd.read_csv(path) for path in replicas]
    storage.write_csv(agreement, spread(dict(zip(seeds, cells, strict=True))))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            [Path(path) for path in snakemake.input.replicas],
            Path(snakemake.output.agreement),
            seeds=snakemake.params.seeds,
        )
