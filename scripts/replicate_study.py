"""The study in memory with another seed of the simulated world, and fewer rotations."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper import replicate
from velocal.simulation import world
from velocal.study.config import read_study
from velocal.study.sheets import read_yaml


def main(
    *,
    world_file: Path,
    agreement: Path,
    seed: int,
    rotations: int,
    config: Mapping[str, Any],
    schemas: Path,
) -> None:
    """Write every cell of the tables beside the printed one."""
    simulated = replace(world.load(read_yaml(world_file)), seed=seed)
    study = read_study(config, schemas, "configuration")
    storage.write_csv(agreement, replicate.agreement(simulated, study, rotations))


if "snakemake" in globals():
    run(main, snakemake)
