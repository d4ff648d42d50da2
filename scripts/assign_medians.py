"""Find the surveyed plane that every median lies on."""

from pathlib import Path

from velocal.calibration.files.formats import read_or_nominal
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.reduction.scans import assigned_scan
from velocal.scanner.models import scanner_named
from velocal.study.config import Limits
from velocal.survey.station import patches_of


def main(
    *,
    medians: Path,
    survey: Path,
    calibration: Path | None,
    assigned: Path,
    scanner: str,
    limits: Limits,
) -> None:
    """Write the medians that lie on a plane as Parquet."""
    known = scanner_named(scanner)
    patches = patches_of(storage.read_json(survey))
    columns, facts = storage.read_table(medians, schemas.MEDIANS)
    parameters = read_or_nominal(calibration, known)
    rows = assigned_scan(
        columns,
        known,
        facts["rotation_rate_hz"],
        parameters,
        patches,
        limits.gates(),
    )
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
