"""Residuals of single rotations with the factory's parameters, every set and every calibration."""

from dataclasses import replace
from pathlib import Path

from velocal.arrays import joined_rows
from velocal.calibration.files import formats
from velocal.capture.source import SourceFilter
from velocal.evaluation.candidates import with_sets
from velocal.evaluation.statistics import ROTATIONS_FROM, statistics_table
from velocal.io import storage
from velocal.io.scripts import for_each, run
from velocal.recording.returns import returns_of
from velocal.recording.windows import read_index, single_rotations
from velocal.reduction.assignment import assigned_rows
from velocal.scanner.models import scanner_named
from velocal.study.outputs import Validation
from velocal.study.reduction import AssignmentLimits
from velocal.survey.station import read_station


@for_each("statistics", "window")
def main(
    *,
    recording: Path,
    rotations: Path,
    survey: Path,
    calibration: Path | None,
    sets: list[Path],
    statistics: Path,
    sample: str,
    window: str,
    scanner: str,
    port: int | None,
    address: str | None,
    which: str,
    length: int,
    candidates: list[str],
    units: list[str],
    limits: AssignmentLimits,
    validation: Validation,
    sigma_cm: float,
    near_points: bool,
) -> None:
    """Write the statistics per laser as CSV; sets are the files of `candidates` in order."""
    known, source = scanner_named(scanner), SourceFilter(port, address)
    index = read_index(rotations)
    single = single_rotations(index, window, length, validation.rotations, str(recording))
    returns = joined_rows(
        list(returns_of(recording, index, single.numbers, known, returns=which, source=source))
    )
    # The duration of a single rotation is known to a packet only.
    beams = replace(returns, rotation_rate_hz=index.rate_for(known)).beams()
    station, factory = read_station(survey), formats.read_or_nominal(calibration, known)
    rows = assigned_rows(beams, factory, station.patches, limits.metric())
    data = station.observations(rows)
    parameters = [formats.read(path, known.n_lasers) for path in sets]
    sets_by_name = dict(zip(candidates, parameters, strict=True))
    compared = with_sets(factory, sets_by_name, units, near_points=near_points)
    heading = {"scanner": scanner, "sample": sample, "window": window, "data": "validation"}
    heading |= {ROTATIONS_FROM: single.origin}
    table = statistics_table(heading, compared, data, sigma_cm * 1e-2)
    storage.write_csv(statistics, table)


if "snakemake" in globals():
    run(main, snakemake)
