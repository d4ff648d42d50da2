"""Scan a recording once: ledger, index of rotations, and the factory's calibration in it."""

from pathlib import Path

from velocal.calibration.files import db_xml
from velocal.calibration.files.document import CalibrationFile
from velocal.capture.source import SourceFilter
from velocal.io import storage
from velocal.io.scripts import run
from velocal.recording.identify import check_scanner
from velocal.recording.motion import check_standing
from velocal.recording.scan import inspect
from velocal.recording.windows import write_index
from velocal.scanner.models import scanner_named


def main(
    *,
    recording: Path,
    ledger: Path,
    rotations: Path,
    calibration: Path | None,
    scanner: str,
    port: int | None,
    address: str | None,
    max_missing: float,
) -> None:
    """Write the ledger as JSON and the index as Parquet.

    Where a file for it is given, the calibration embedded in the status bytes is written as well,
    every value as the wire holds it; that it is not there is an error then.
    """
    source = SourceFilter(port, address)
    inspection = inspect(recording, source=source, max_missing=max_missing)
    known = scanner_named(scanner)
    remarks = check_scanner(inspection, known, str(recording))
    check_standing(recording, inspection.index, known, source)
    write_index(rotations, inspection.index)
    facts = {"scanner": scanner, **inspection.as_dict(known), "remarks": remarks}
    storage.write_json(ledger, {"file": recording.name, **facts})
    if calibration:
        # Not `formats.write`: a change of another format would have every recording scanned again.
        embedded = inspection.status.calibration(str(recording))
        db_xml.write(calibration, CalibrationFile(embedded))


if "snakemake" in globals():
    run(main, snakemake)
