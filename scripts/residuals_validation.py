"""Residuals of single scans with the factory's parameters, and with every set and calibration."""

from pathlib import Path

from velocal.calibration.files import formats
from velocal.evaluation.candidates import with_sets
from velocal.evaluation.statistics import statistics_table
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.reduction.assignment import COLUMNS, assigned_rows, first_rotations
from velocal.scanner.beam import Beams
from velocal.scanner.models import scanner_named
from velocal.study.outputs import Validation
from velocal.study.reduction import AssignmentLimits
from velocal.survey.station import read_station


def main(
    *,
    returns: Path,
    survey: Path,
    calibration: Path | None,
    sets: list[Path],
    statistics: Path,
    sample: str,
    window: str,
    scanner: str,
    candidates: list[str],
    units: list[str],
    limits: AssignmentLimits,
    validation: Validation,
) -> None:
    """Write the statistics per laser as CSV; sets are the files of `candidates` in order."""
    known = scanner_named(scanner)
    station = read_station(survey)
    rotations = validation.rotations
    columns, facts = storage.read_first(returns, schemas.RETURNS, "rotation", rotations, COLUMNS)
    factory = formats.read_or_nominal(calibration, known)
    scan = first_rotations(columns, rotations)
    beams = Beams.from_ticks(scan, known, facts["rotation_rate_hz"])
    rows = assigned_rows(beams, factory, station.patches, limits.metric())
    data = station.observations(rows)
    parameters = [formats.read(path, known.n_lasers) for path in sets]
    sets_by_name = dict(zip(candidates, parameters, strict=True))
    compared = with_sets(factory, sets_by_name, units)
    heading = {"scanner": scanner, "sample": sample, "window": window, "data": "validation"}
    table = statistics_table(heading, compared, data, validation.sigma_cm * 1e-2)
    storage.write_csv(statistics, table)


if "snakemake" in globals():
    run(main, snakemake)
