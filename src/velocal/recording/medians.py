"""Medians of a table of returns, from file to file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from velocal.errors import RecordingError
from velocal.io import schemas, storage
from velocal.reduction.medians import medians_of
from velocal.scanner.models import Scanner


def write_medians(
    returns: Path, medians: Path, scanner: Scanner, *, bin_ticks: int, min_count: int
) -> None:
    """Reduce a table of returns to medians per laser and azimuth bin.

    Parameters
    ----------
    returns, medians : Path
        Parquet files to read and to write; the facts of the returns are kept.
    scanner : Scanner
    bin_ticks : int
        Width of an azimuth bin, ticks of the encoder.
    min_count : int
        Returns that a median needs.

    Raises
    ------
    StorageError
        If the table of returns cannot be read.
    RecordingError
        If there is no median: a study without medians would end with an error that tells less.
    """
    columns, facts = storage.read_table(
        returns, schemas.RETURNS, ["azimuth", "laser_id", "distance"]
    )
    reduced = medians_of(columns, scanner, bin_ticks=bin_ticks, min_count=min_count)
    if not len(reduced.laser_id):
        raise RecordingError(
            f"there are no medians: no azimuth bin of a laser has {min_count} returns",
            where=str(returns),
            hint="Lower `reduction: min_count`, or use more rotations (`windows: rotations`).",
        )
    facts |= {"cell_ticks": bin_ticks, "min_count": min_count}
    storage.write_table(medians, schemas.MEDIANS, asdict(reduced), **facts)
