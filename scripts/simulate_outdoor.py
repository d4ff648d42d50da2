"""Simulate the recording of one outdoor sample."""

from pathlib import Path

from velocal.errors import reported
from velocal.io.storage import write_blocks
from velocal.simulation import capture, world
from velocal.simulation.outdoor import outdoor_scene
from velocal.study.sheets import read_yaml


def main(
    world_file: Path, recording: Path, *, sample: str, scanner: str, scene: str, rotations: int
) -> None:
    """Write the records that the scanner would have sent."""
    simulated = world.load(read_yaml(world_file))
    duration_s = rotations / simulated.scanner(scanner).rotation_rate_hz
    around = outdoor_scene(simulated, scanner, scene, duration_s)
    write_blocks(recording, capture.records(simulated, scanner, around, sample, rotations))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.world),
            Path(snakemake.output.recording),
            sample=snakemake.wildcards.outdoor,
            scanner=snakemake.params.scanner,
            scene=snakemake.params.scene,
            rotations=snakemake.params.rotations,
        )
