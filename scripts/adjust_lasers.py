"""Adjust the parameters of every laser on the medians of one window."""

from pathlib import Path

from velocal.adjustment import tabulate
from velocal.adjustment.lasers import adjust_all
from velocal.calibration.files.formats import read_or_nominal
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.scanner.models import scanner_named
from velocal.study.config import Adjustment
from velocal.survey.station import observations, patches_of, uncertainty_of


def main(
    *,
    assigned: Path,
    survey: Path,
    calibration: Path | None,
    adjustment: Path,
    covariance: Path,
    scanner: str,
    config: Adjustment,
) -> None:
    """Write corrections and quality per laser, and all covariances, as CSV."""
    columns, _ = storage.read_table(assigned, schemas.ASSIGNED)
    station = storage.read_json(survey)
    results = adjust_all(
        observations(columns, patches_of(station)),
        read_or_nominal(calibration, scanner_named(scanner)),
        config.parameters,
        config.solver(),
        config.stochastic([uncertainty_of(station)]),
    )
    storage.write_csv(adjustment, tabulate.corrections(results))
    storage.write_csv(covariance, tabulate.covariances(results))


if "snakemake" in globals():
    run(main, snakemake)
