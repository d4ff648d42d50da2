"""Write the survey of the simulated world."""

from pathlib import Path

from velocal.errors import reported
from velocal.simulation import survey, world
from velocal.study import read_yaml
from velocal.survey import write_targets


def main(world_file: Path, planes: Path, base_scanner: Path, base_field: Path) -> None:
    """Write targets of the planes, of the scanners' bases, and of the bases in the field."""
    simulated = world.load(read_yaml(world_file))
    positions = {name: where["scanner"] for name, where in simulated.positions.items()}
    bases = [survey.base_targets_scanner(simulated, scanner) for scanner in simulated.scanners]
    in_field = [survey.base_targets_field(simulated, s, p) for p, s in positions.items()]
    write_targets(planes, "plane", survey.field_targets(simulated))
    write_targets(base_scanner, "scanner", bases)
    write_targets(base_field, "position", in_field)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.world),
            Path(snakemake.output.planes),
            Path(snakemake.output.base_scanner),
            Path(snakemake.output.base_field),
        )
