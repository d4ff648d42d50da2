"""Apply every exported file by the formula of its program to the medians on surveyed planes."""

from pathlib import Path

from velocal.calibration.files import formats
from velocal.evaluation.exported import Observed, exported_columns
from velocal.io import schemas, storage
from velocal.io.scripts import for_each, run
from velocal.scanner.models import scanner_named
from velocal.scanner.parameters import nominal
from velocal.survey.station import read_station


@for_each("assigned", "surveys", "calibration", "csv", "files", "exports", "scanner", "positions")
def main(
    *,
    assigned: list[Path],
    surveys: list[Path],
    calibration: Path | None,
    csv: Path,
    files: list[Path],
    exports: Path,
    scanner: str,
    positions: list[str],
) -> None:
    """Write distances to the planes before and after; `positions` are those of `assigned`."""
    known = scanner_named(scanner)
    stations = {station.position: station for station in map(read_station, surveys)}
    windows = []
    for path, position in zip(assigned, positions, strict=True):
        columns, facts = storage.read_table(path, schemas.ASSIGNED)
        windows.append(
            Observed(stations[position].observations(columns), facts["rotation_rate_hz"])
        )
    factory = nominal(known) if calibration is None else formats.read_for(calibration, known)
    exported = {path.name: formats.read_for(path, known) for path in files}
    model = formats.read(csv, known.n_lasers)
    storage.write_csv(exports, exported_columns(exported, factory, model, windows, known))


if "snakemake" in globals():
    run(main, snakemake)
