"""Write what the surveyor of the simulated world observed."""

from pathlib import Path

from velocal.errors import reported
from velocal.simulation import world
from velocal.simulation.survey import field_book
from velocal.study.sheets import read_yaml
from velocal.survey.network.field_book import FILES, write_field_book


def main(world_file: Path, paths: dict[str, Path]) -> None:
    """Write the observation files of the survey."""
    simulated = world.load(read_yaml(world_file))
    camera = simulated.survey["camera"]
    write_field_book(field_book(simulated), paths, camera["principal_distance_mm"])


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.world),
            {name: Path(snakemake.output[name]) for name in FILES},
        )
