"""Decode the rotations of a window, and reduce the returns to medians per laser and azimuth bin."""

from pathlib import Path

from velocal.capture.source import SourceFilter
from velocal.io.scripts import for_each, run
from velocal.recording.medians import write_reduced
from velocal.recording.returns import returns_of, table_facts
from velocal.recording.windows import read_index, window_rotations
from velocal.scanner.models import scanner_named


@for_each("returns", "medians", "window")
def main(
    *,
    recording: Path,
    rotations: Path,
    returns: Path,
    medians: Path,
    window: str,
    scanner: str,
    port: int | None,
    address: str | None,
    which: str,
    length: int | None,
    azimuth_bin_ticks: int,
    min_count: int,
) -> None:
    """Write the returns of the window's rotations, and their medians, as Parquet."""
    index = read_index(rotations)
    chosen = window_rotations(index, window, length, str(recording))
    known, source = scanner_named(scanner), SourceFilter(port, address)
    parts = returns_of(recording, index, chosen, known, returns=which, source=source)
    facts = table_facts(known, len(chosen), index.rate_for(known, chosen), which)
    limits = {"bin_ticks": azimuth_bin_ticks, "min_count": min_count}
    write_reduced(parts, facts, returns, medians, known, **limits)


if "snakemake" in globals():
    run(main, snakemake)
