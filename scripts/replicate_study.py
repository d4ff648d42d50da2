"""The study in memory with another seed of the simulated world, and fewer rotations."""

from dataclasses import replace
from pathlib import Path

from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper import replicate
from velocal.simulation import world
from velocal.study.config import StudyConfig
from velocal.study.study import with_samples


def main(
    *,
    world_file: Path,
    agreement: Path,
    seed: int,
    rotations: int,
    config: StudyConfig,
) -> None:
    """Write every entry of the tables beside the printed one."""
    simulated = replace(world.read(world_file), seed=seed)
    study = with_samples(config, "configuration")
    storage.write_csv(agreement, replicate.agreement(simulated, study, rotations))


if "snakemake" in globals():
    run(main, snakemake)
