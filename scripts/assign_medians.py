"""Find the surveyed plane that every median lies on."""

from pathlib import Path

from velocal.calibration.files.formats import read_or_nominal
from velocal.io import schemas, storage
from velocal.io.scripts import for_each, run
from velocal.reduction.assignment import assigned_rows
from velocal.scanner.beam import Beams
from velocal.scanner.models import scanner_named
from velocal.study.reduction import AssignmentLimits
from velocal.survey.station import read_station


@for_each("medians", "assigned")
def main(
    *,
    medians: Path,
    survey: Path,
    calibration: Path | None,
    assigned: Path,
    scanner: str,
    limits: AssignmentLimits,
) -> None:
    """Write the medians that lie on a plane as Parquet."""
    known = scanner_named(scanner)
    patches = read_station(survey).patches
    columns, facts = storage.read_table(medians, schemas.MEDIANS)
    parameters = read_or_nominal(calibration, known)
    beams = Beams.from_ticks(columns, known, facts["rotation_rate_hz"])
    rows = assigned_rows(beams, parameters, patches, limits.metric())
    storage.write_table(
        assigned,
        schemas.ASSIGNED,
        rows,
        **facts,
        planes=[patch.name for patch in patches],
        medians=len(columns["laser_id"]),
    )


if "snakemake" in globals():
    run(main, snakemake)
