"""Fit constants of the simulated world to the printed tables."""

from pathlib import Path

from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper.tuning import tune
from velocal.simulation import world
from velocal.study.config import StudyConfig
from velocal.study.study import with_samples


def main(
    *,
    world_file: Path,
    constants: Path,
    seeds: int,
    rotations: int,
    iterations: int,
    config: StudyConfig,
) -> None:
    """Write what the constants are and what would fit better; the world file is left alone."""
    study = with_samples(config, "configuration")
    content, chosen = world.read(world_file).plain(), range(1, seeds + 1)
    storage.write_csv(constants, tune(content, study, chosen, rotations, iterations=iterations))


if "snakemake" in globals():
    run(main, snakemake)
