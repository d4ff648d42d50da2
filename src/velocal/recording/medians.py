"""Returns and their medians, as files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from velocal.errors import RecordingError
from velocal.io import schemas, storage
from velocal.recording.returns import Returns
from velocal.reduction.medians import medians_of
from velocal.scanner.models import Scanner

#: Columns of returns of which medians are made, with their types.
_REDUCED = {"azimuth": np.uint16, "laser_id": np.uint8, "distance": np.uint16}


def write_reduced(
    parts: Iterable[Returns],
    facts: Mapping[str, Any],
    returns: Path,
    medians: Path,
    scanner: Scanner,
    *,
    bin_ticks: int,
    min_count: int,
) -> None:
    """Write returns as they come, and then their medians per laser and azimuth bin.

    Parameters
    ----------
    parts : iterable of Returns
        Consecutive rows of the table of returns.
    facts : mapping of str to object
        What is kept with both tables (`returns.table_facts`).
    returns, medians : Path
        Parquet files to write.
    scanner : Scanner
    bin_ticks : int
        Width of an azimuth bin, ticks of the encoder.
    min_count : int
        Returns that a median needs.

    Raises
    ------
    RecordingError
        If there is no median: a study without medians would end with an error that tells less.
    """
    kept = {name: [np.empty(0, kind)] for name, kind in _REDUCED.items()}
    with storage.table_writer(returns, schemas.RETURNS, **facts) as writer:
        for part in parts:
            writer.write(part.columns())
            for name, values in kept.items():
                values.append(getattr(part, name))
    columns = {name: np.concatenate(kept.pop(name)) for name in _REDUCED}
    reduced = medians_of(columns, scanner, bin_ticks=bin_ticks, min_count=min_count)
    if not len(reduced.laser_id):
        raise RecordingError(
            f"there are no medians: no azimuth bin of a laser has {min_count} returns",
            where=str(returns),
            hint="Lower `reduction: min_count`, or use more rotations (`windows: rotations`).",
        )
    limits = {"cell_ticks": bin_ticks, "min_count": min_count}
    storage.write_table(medians, schemas.MEDIANS, asdict(reduced), **facts, **limits)
