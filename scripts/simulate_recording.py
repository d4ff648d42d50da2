"""Simulate the recording of one sample."""

from pathlib import Path

from velocal.io.scripts import run
from velocal.io.storage import write_blocks
from velocal.simulation import capture, world


def main(
    *,
    world_file: Path,
    recording: Path,
    sample: str,
    scanner: str,
    position: str,
    rotations: int,
) -> None:
    """Write the records that the scanner would have sent."""
    simulated = world.read(world_file)
    simulated.check_position(position, scanner)
    write_blocks(recording, capture.records(simulated, scanner, position, sample, rotations))


if "snakemake" in globals():
    run(main, snakemake)
