"""Scan a recording once: ledger and index of rotations."""

from pathlib import Path

from velocal.capture.source import SourceFilter
from velocal.errors import reported
from velocal.io import storage
from velocal.recording.identify import check_scanner
from velocal.recording.scan import inspect
from velocal.recording.windows import write_index
from velocal.scanner.models import scanner_named


def main(
    recording: Path, ledger: Path, rotations: Path, *, scanner: str, source: SourceFilter
) -> None:
    """Write the ledger as JSON and the index as Parquet."""
    inspection = inspect(recording, source=source)
    remarks = check_scanner(inspection, scanner_named(scanner), str(recording))
    write_index(rotations, inspection.index)
    facts = {"scanner": scanner, **inspection.as_dict(), "remarks": remarks}
    storage.write_json(ledger, {"file": recording.name, **facts})


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.recording),
            Path(snakemake.output.ledger),
            Path(snakemake.output.rotations),
            scanner=snakemake.params.scanner,
            source=SourceFilter(snakemake.params.port, snakemake.params.address),
        )
