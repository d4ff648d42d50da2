"""Write the factory's calibration of a simulated unit, and the truth beside it."""

from pathlib import Path

from velocal.calibration.files import formats
from velocal.io.scripts import run
from velocal.simulation import world
from velocal.simulation.truth import factory_parameters, unit_truth


def main(
    *,
    world_file: Path,
    factory: Path,
    truth: Path,
    scanner: str,
) -> None:
    """Write db.xml of the factory, and the true parameters as CSV."""
    simulated = world.read(world_file)
    formats.write(factory, factory_parameters(simulated, scanner))
    formats.write(truth, unit_truth(simulated, scanner).parameters)


if "snakemake" in globals():
    run(main, snakemake)
