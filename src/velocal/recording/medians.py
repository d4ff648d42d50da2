"""From a file of returns to a file of medians."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from velocal.io import schemas, storage
from velocal.reduction.medians import binned_medians
from velocal.scanner.models import Scanner


def write_medians(
    returns: Path, medians: Path, scanner: Scanner, *, azimuth_bin_ticks: int, min_count: int
) -> None:
    """Reduce returns to medians per laser and azimuth bin.

    Parameters
    ----------
    returns : Path
        Parquet file of `schemas.RETURNS`.
    medians : Path
        Parquet file of `schemas.MEDIANS` to write.
    scanner : Scanner
    azimuth_bin_ticks : int
        Width of a bin, 0.01 deg.
    min_count : int
        Returns that a bin must have.
    """
    names = ["azimuth", "laser_id", "distance"]
    columns, facts = storage.read_table(returns, schemas.RETURNS, names)
    reduced = binned_medians(
        columns["azimuth"],
        columns["laser_id"],
        columns["distance"],
        lasers_per_firing=scanner.lasers_per_firing,
        bin_ticks=azimuth_bin_ticks,
        min_count=min_count,
    )
    facts |= {"cell_ticks": azimuth_bin_ticks, "min_count": min_count}
    storage.write_table(medians, schemas.MEDIANS, asdict(reduced), **facts)
