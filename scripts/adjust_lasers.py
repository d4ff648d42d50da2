"""Adjust the parameters of every laser on the medians of one window."""

from pathlib import Path

from velocal.calibration.files.formats import read_or_nominal
from velocal.chain import adjust
from velocal.io import schemas, storage
from velocal.io.scripts import for_each, run
from velocal.scanner.models import scanner_named
from velocal.study.adjustment import Adjustment
from velocal.survey.station import read_station


@for_each("assigned", "adjustment", "covariance")
def main(
    *,
    assigned: Path,
    survey: Path,
    calibration: Path | None,
    checks: Path,
    adjustment: Path,
    covariance: Path,
    scanner: str,
    config: Adjustment,
) -> None:
    """Write corrections and quality per laser, and all covariances, as CSV.

    `checks` is not read: it exists only if the checks found no error of the survey.
    """
    columns, _ = storage.read_table(assigned, schemas.ASSIGNED)
    station = read_station(survey)
    factory = read_or_nominal(calibration, scanner_named(scanner))
    found = adjust(station.observations(columns), factory, config, [station.uncertainty()])
    storage.write_csv(adjustment, found.to_columns())
    storage.write_csv(covariance, found.covariance_columns())


if "snakemake" in globals():
    run(main, snakemake)
