"""Simulate the recordings of a building, one per position, and the survey of the positions."""

from pathlib import Path

from velocal.errors import reported
from velocal.io.storage import write_blocks
from velocal.simulation import building, capture, world
from velocal.study.sheets import read_yaml
from velocal.survey.targets import write_targets

ROTATIONS = 1  # complete ones; a scan is no more


def main(world_file: Path, recordings: list[Path], base: Path) -> None:
    """Write the records of every position, in the order of the world file, and base targets."""
    simulated = world.load(read_yaml(world_file))
    described = building.described(simulated)
    scanner = described["scanner"]
    for position, recording in zip(described["positions"], recordings, strict=True):
        scene = building.scene(simulated, position)
        write_blocks(recording, capture.records(simulated, scanner, scene, position, ROTATIONS))
    write_targets(base, "position", building.base_targets(simulated))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.world),
            [Path(path) for path in snakemake.output.recordings],
            Path(snakemake.output.base),
        )
