"""Simulate the recordings of a building, one per position, and the survey of the positions."""

from pathlib import Path

from velocal.io.scripts import run
from velocal.io.storage import write_blocks
from velocal.simulation import building, capture, world
from velocal.survey.targets import write_targets

ROTATIONS = 1  # complete ones; a scan is no more


def main(
    *,
    world_file: Path,
    recordings: list[Path],
    base: Path,
    positions: list[str],
) -> None:
    """Write the records of every position, one recording each, and the base targets."""
    simulated = world.read(world_file)
    scanner = simulated.mapped_building().scanner
    for recording, position in zip(recordings, positions, strict=True):
        scene = building.scene(simulated, position)
        write_blocks(recording, capture.records(simulated, scanner, scene, position, ROTATIONS))
    write_targets(base, "position", building.base_targets(simulated))


if "snakemake" in globals():
    run(main, snakemake)
