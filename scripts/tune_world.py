"""Fit constants of the simulated world to the printed tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper.tuning import tune
from velocal.study.config import read_study
from velocal.study.sheets import read_yaml


def main(
    *,
    world_file: Path,
    constants: Path,
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
    run(main, snakemake)
