"""Adjust the parameters of every laser on the medians of one window."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from velocal.adjustment import settings
from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.result import CalibrationSet
from velocal.calibration.files.formats import read_or_nominal
from velocal.errors import reported
from velocal.io import schemas, storage
from velocal.scanner.models import scanner_named
from velocal.survey.station import read_station


def main(
    assigned: Path,
    survey: Path,
    calibration: Path | None,
    adjustment: Path,
    covariance: Path,
    *,
    scanner: str,
    config: Mapping[str, Any],
) -> None:
    """Write corrections and quality per laser, and all covariances, as CSV."""
    columns, _ = storage.read_table(assigned, schemas.ASSIGNED)
    station = read_station(survey)
    factory = read_or_nominal(calibration, scanner_named(scanner))
    results = adjust_all(
        station.observations(columns),
        factory,
        config["parameters"],
        settings.solver(config),
        settings.stochastic(config, [station.uncertainty()]),
    )
    found = CalibrationSet.from_adjustments(results, factory)
    storage.write_csv(adjustment, found.to_columns())
    storage.write_csv(covariance, found.covariance_columns())


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.assigned),
            Path(snakemake.input.survey),
            Path(c) if (c := snakemake.input.calibration) else None,
            Path(snakemake.output.adjustment),
            Path(snakemake.output.covariance),
            scanner=snakemake.params.scanner,
            config=snakemake.params.adjustment,
        )
