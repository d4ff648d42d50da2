"""Residuals of single scans with the factory's parameters and with every parameter set."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from velocal.calibration.files import formats
from velocal.errors import reported
from velocal.evaluation.candidates import with_sets
from velocal.evaluation.statistics import statistics_table
from velocal.io import schemas, storage
from velocal.reduction.assignment import COLUMNS, Limits, assigned_rows, first_rotations
from velocal.scanner.beam import Beams
from velocal.scanner.models import scanner_named
from velocal.survey.station import read_station


def main(
    returns: Path,
    survey: Path,
    calibration: Path | None,
    sets: list[Path],
    statistics: Path,
    *,
    sample: str,
    window: str,
    scanner: str,
    parameter_sets: list[str],
    gates: Mapping[str, float],
    config: Mapping[str, Any],
) -> None:
    """Write the statistics per laser as CSV; sets are the files of `parameter_sets` in order."""
    known = scanner_named(scanner)
    station = read_station(survey)
    columns, facts = storage.read_table(returns, schemas.RETURNS, COLUMNS)
    factory = formats.read_or_nominal(calibration, known)
    scan = first_rotations(columns, config["rotations"])
    beams = Beams.from_ticks(scan, known, facts["rotation_rate_hz"])
    rows = assigned_rows(beams, factory, station.patches, Limits.from_config(gates))
    data = station.observations(rows)
    parameters = [formats.read(path, known.n_lasers) for path in sets]
    candidates = with_sets(factory, dict(zip(parameter_sets, parameters, strict=True)))
    heading = {"scanner": scanner, "sample": sample, "window": window, "data": "validation"}
    table = statistics_table(heading, candidates, data, config["sigma_cm"] * 1e-2)
    storage.write_csv(statistics, table)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.returns),
            Path(snakemake.input.survey),
            Path(c) if (c := snakemake.input.calibration) else None,
            [Path(path) for path in snakemake.input.sets],
            Path(snakemake.output.statistics),
            sample=snakemake.wildcards.sample,
            window=snakemake.wildcards.window,
            scanner=snakemake.params.scanner,
            parameter_sets=snakemake.params.parameter_sets,
            gates=snakemake.params.gates,
            config=snakemake.params.validation,
        )
