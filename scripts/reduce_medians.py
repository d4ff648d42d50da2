"""Reduce returns to medians per laser and azimuth bin."""

from dataclasses import asdict
from pathlib import Path

from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.reduction.medians import binned_medians
from velocal.scanner.models import scanner_named


def main(
    *,
    returns: Path,
    medians: Path,
    scanner: str,
    azimuth_bin_ticks: int,
    min_count: int,
) -> None:
    """Write the medians as Parquet."""
    known = scanner_named(scanner)
    columns, facts = storage.read_table(
        returns, schemas.RETURNS, ["azimuth", "laser_id", "distance"]
    )
    reduced = binned_medians(
        columns["azimuth"],
        columns["laser_id"],
        columns["distance"],
        lasers_per_firing=known.lasers_per_firing,
        bin_ticks=azimuth_bin_ticks,
        min_count=min_count,
    )
    facts |= {"cell_ticks": azimuth_bin_ticks, "min_count": min_count}
    storage.write_table(medians, schemas.MEDIANS, asdict(reduced), **facts)


if "snakemake" in globals():
    run(main, snakemake)
