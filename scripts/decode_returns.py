"""Decode the rotations of a window to a table of returns."""

from pathlib import Path

from velocal.capture.source import SourceFilter
from velocal.errors import reported
from velocal.recording.returns import write_returns
from velocal.recording.windows import read_index, window_rotations
from velocal.scanner.models import scanner_named


def main(
    recording: Path,
    rotations: Path,
    returns: Path,
    *,
    scanner: str,
    window: str,
    length: int | None,
    source: SourceFilter,
    which: str,
) -> None:
    """Write the returns of the window's rotations as Parquet."""
    index = read_index(rotations)
    chosen = window_rotations(index, window, length, str(recording))
    known = scanner_named(scanner)
    write_returns(recording, index, chosen, known, returns, returns=which, source=source)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.recording),
            Path(snakemake.input.rotations),
            Path(snakemake.output.returns),
            scanner=snakemake.params.scanner,
            window=snakemake.wildcards.window,
            length=snakemake.params.length,
            source=SourceFilter(snakemake.params.port, snakemake.params.address),
            which=snakemake.params.which,
        )
