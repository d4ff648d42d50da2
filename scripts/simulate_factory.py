"""Write the factory's calibration of a simulated unit, and the truth beside it."""

from pathlib import Path

from velocal.calibration.files import formats
from velocal.errors import reported
from velocal.simulation import truth, world
from velocal.study.sheets import read_yaml


def main(world_file: Path, factory: Path, true: Path, *, scanner: str) -> None:
    """Write db.xml of the factory, and the true parameters as CSV."""
    simulated = world.load(read_yaml(world_file))
    formats.write(factory, truth.factory_parameters(simulated, scanner))
    formats.write(true, truth.unit_truth(simulated, scanner).parameters)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.world),
            Path(snakemake.output.factory),
            Path(snakemake.output.truth),
            scanner=snakemake.wildcards.scanner,
        )
