"""Residuals of the medians that a window was adjusted on, before and after."""

from pathlib import Path

from velocal.adjustment.result import CalibrationSet
from velocal.calibration.files import formats
from velocal.evaluation.candidates import Candidate, Role
from velocal.evaluation.statistics import ROTATIONS_FROM, statistics_table
from velocal.io import schemas, storage
from velocal.io.scripts import for_each, run
from velocal.scanner.beam import points
from velocal.scanner.models import scanner_named
from velocal.survey.station import read_station


@for_each("assigned", "adjusted", "residuals", "statistics", "window")
def main(
    *,
    assigned: Path,
    adjusted: Path,
    survey: Path,
    calibration: Path | None,
    residuals: Path,
    statistics: Path,
    sample: str,
    window: str,
    scanner: str,
    unit: str,
    sigma_cm: float,
    near_points: bool,
) -> None:
    """Write s of every median as Parquet and its statistics per laser as CSV.

    `adjusted` is the file of the calibration `unit`, or the window's own adjustment without one.
    """
    known = scanner_named(scanner)
    columns, facts = storage.read_table(assigned, schemas.ASSIGNED)
    data = read_station(survey).observations(columns)
    factory = formats.read_or_nominal(calibration, known)
    after = (
        Candidate(Role.UNIT, formats.read(adjusted, known.n_lasers), unit)
        if unit
        else Candidate(
            Role.WINDOW,
            CalibrationSet.from_columns(storage.read_csv(adjusted), factory).adjusted,
        )
    )
    before = Candidate(Role.FACTORY, factory, "", near_points)
    corrected = before.observed(data)
    xyz = points(corrected.distance_m, data.phi, data.laser_id, factory).T
    rows = {name: columns[name] for name in ("laser_id", "plane")}
    rows |= dict(zip(("x_m", "y_m", "z_m"), xyz, strict=True))
    rows |= {"before_m": before.misclosure(data), "after_m": after.misclosure(data)}
    storage.write_table(residuals, schemas.RESIDUALS, rows, **facts)
    heading = {"scanner": scanner, "sample": sample, "window": window, "data": "calibration"}
    heading |= {ROTATIONS_FROM: "window"}
    table = statistics_table(heading, [before, after], data, sigma_cm * 1e-2)
    storage.write_csv(statistics, table)


if "snakemake" in globals():
    run(main, snakemake)
