"""Simulate the recording of one outdoor sample."""

from functools import cache
from pathlib import Path

from velocal.io.scripts import for_each, run
from velocal.io.storage import write_blocks
from velocal.simulation import capture, world
from velocal.simulation.outdoor import outdoor_scene

#: All samples are of one world.
_read = cache(world.read)


@for_each("recording", "sample", "scanner", "scene")
def main(
    *,
    world_file: Path,
    recording: Path,
    sample: str,
    scanner: str,
    scene: str,
    rotations: int,
) -> None:
    """Write the records that the scanner would have sent."""
    simulated = _read(world_file)
    duration_s = rotations / simulated.scanner(scanner).rotation_rate_hz
    around = outdoor_scene(simulated, scanner, scene, duration_s)
    write_blocks(recording, capture.records(simulated, scanner, around, sample, rotations))


if "snakemake" in globals():
    run(main, snakemake)
