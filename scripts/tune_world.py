"""Fit constants of the simulated world to the printed tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from velocal.errors import reported
from velocal.io import storage
from velocal.paper.tuning import tune
from velocal.study.config import read_study
from velocal.study.sheets import read_yaml


def main(
    world_file: Path,
    constants: Path,
    *,
    seeds: int,
    rotations: int,
    iterations: int,
    config: Mapping[str, Any],
    schemas: Path,
) -> None:
    """Write what the constants are and what would fit better; the world file is left alone."""
    study = read_study(config, schemas, "configuration")
    content, chosen = read_yaml(world_file), range(1, seeds + 1)
    storage.write_csv(constants, tune(content, study, chosen, rotations, iterations=iterations))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.world),
            Path(snakemake.output.constants),
            seeds=snakemake.params.tuning["seeds"],
            rotations=snakemake.params.rotations,
            iterations=snakemake.params.tuning["iterations"],
            config=snakemake.params.study,
            schemas=Path(snakemake.params.schemas),
        )
