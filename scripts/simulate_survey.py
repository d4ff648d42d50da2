"""Write what the surveyor of the simulated world observed."""

from pathlib import Path

from velocal.io.scripts import run
from velocal.simulation import world
from velocal.simulation.survey import field_book
from velocal.survey.network.field_book import write_field_book


def main(
    *,
    world_file: Path,
    points: Path,
    network: Path,
    images: Path,
    base_sights: Path,
    base_readings: Path,
) -> None:
    """Write the observation files of the survey."""
    simulated = world.read(world_file)
    camera = simulated.survey.camera
    paths = {"points": points, "network": network, "images": images}
    paths |= {"base_sights": base_sights, "base_readings": base_readings}
    write_field_book(field_book(simulated), paths, camera.principal_distance_mm)


if "snakemake" in globals():
    run(main, snakemake)
