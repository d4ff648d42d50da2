"""Scan a recording once: ledger and index of rotations."""

from pathlib import Path

from velocal.capture.reading import Choice
from velocal.io import storage
from velocal.io.scripts import run
from velocal.recording.identify import check_scanner
from velocal.recording.scan import inspect
from velocal.recording.windows import write_index
from velocal.scanner.models import scanner_named


def main(
    *,
    recording: Path,
    ledger: Path,
    rotations: Path,
    scanner: str,
    port: int | None,
    address: str | None,
) -> None:
    """Write the ledger as JSON and the index as Parquet."""
    inspection = inspect(recording, choice=Choice(port, address))
    remarks = check_scanner(inspection, scanner_named(scanner), str(recording))
    write_index(rotations, inspection.index)
    facts = {"scanner": scanner, **inspection.as_dict(), "remarks": remarks}
    storage.write_json(ledger, {"file": recording.name, **facts})


if "snakemake" in globals():
    run(main, snakemake)
