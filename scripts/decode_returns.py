"""Decode the rotations of a window to a table of returns."""

from pathlib import Path

from velocal.capture.source import SourceFilter
from velocal.io.scripts import run
from velocal.recording.returns import write_returns
from velocal.recording.windows import read_index, window_rotations
from velocal.scanner.models import scanner_named


def main(
    *,
    recording: Path,
    rotations: Path,
    returns: Path,
    scanner: str,
    window: str,
    length: int | None,
    port: int | None,
    address: str | None,
    which: str,
) -> None:
    """Write the returns of the window's rotations as Parquet."""
    index = read_index(rotations)
    chosen = window_rotations(index, window, length, str(recording))
    known, source = scanner_named(scanner), SourceFilter(port, address)
    write_returns(recording, index, chosen, known, returns, returns=which, source=source)


if "snakemake" in globals():
    run(main, snakemake)
