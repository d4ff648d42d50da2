"""Mean and spread of every cell of the tables over the seeds."""

from pathlib import Path

import pandas as pd

from velocal.errors import reported
from velocal.io import storage
from velocal.paper.replicate import spread


def main(replicas: list[Path], agreement: Path) -> None:
    """Write the comparison; the seed is the name of a replica's file."""
    storage.write_csv(agreement, spread({int(path.stem): pd.read_csv(path) for path in replicas}))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main([Path(path) for path in snakemake.input.replicas], Path(snakemake.output.agreement))
