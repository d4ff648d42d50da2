"""Whether the scanner moved during a recording, by the distances of smooth surfaces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array, joined_rows
from velocal.capture.source import ANY_SOURCE, SourceFilter
from velocal.errors import RecordingError
from velocal.recording.returns import Returns, returns_of
from velocal.recording.rotation_index import RotationIndex
from velocal.scanner.models import AZIMUTH_TICKS, Scanner

#: Rotations that are compared, evenly spaced; each with the first one.
ROTATIONS = 4
#: Width of an azimuth bin in which distances are compared, 0.01 degree.
_BIN_TICKS = 100
#: Returns of a laser in neighbouring bins that differ by less than this belong to a smooth surface,
#: metres, and a surface that is farther or nearer by this has changed.
_SMOOTH_M = 0.1
_CHANGED_M = 0.15
#: Cells that must be smooth in both rotations.
_LEAST_CELLS = 200
#: Share of the cells that has changed where the scanner has moved. People and cars change less, and
#: of a scanner on a car the ground, often half of all cells, does not change.
MOVED_SHARE = 0.2


def changed_share(
    path: Path, index: RotationIndex, scanner: Scanner, source: SourceFilter = ANY_SOURCE
) -> float:
    """Share of smooth surfaces whose distance changes during a recording.

    Parameters
    ----------
    path : Path
        Capture file.
    index : RotationIndex
        Of that file.
    scanner : Scanner
        What sent the packets.
    source : SourceFilter
        Which of several scanners, as when it was indexed.

    Returns
    -------
    float
        The largest share among the compared rotations; 0 if fewer than two are complete, or if too
        few surfaces are smooth.
    """
    complete = np.flatnonzero(index.complete)
    places = np.unique(np.linspace(0, len(complete) - 1, ROTATIONS).round().astype(int))
    if len(complete) < 2:
        return 0.0
    grids = [
        _grid(joined_rows(list(returns_of(path, index, complete[[at]], scanner, source=source))))
        for at in places
    ]
    return max(_changed(grids[0], grid) for grid in grids[1:])


def moved(
    path: Path, index: RotationIndex, scanner: Scanner, source: SourceFilter = ANY_SOURCE
) -> list[str]:
    """Tell whether the scanner moved.

    Parameters are those of `changed_share`.

    Returns
    -------
    list of str
        One remark, or none.
    """
    return _remark(changed_share(path, index, scanner, source))


def check_standing(
    path: Path, index: RotationIndex, scanner: Scanner, source: SourceFilter = ANY_SOURCE
) -> None:
    """Check that the scanner stood still, as a calibration needs it.

    Parameters are those of `changed_share`.

    Raises
    ------
    RecordingError
        If it moved.
    """
    _refuse(moved(path, index, scanner, source), str(path))


def check_cloud_standing(returns: Returns, where: str) -> None:
    """Check that the scanner stood still while a cloud was measured.

    Parameters
    ----------
    returns : Returns
        Out of the cloud.
    where : str
        The file, for the error.

    Raises
    ------
    RecordingError
        If it moved.
    """
    numbers = np.unique(returns.rotation)
    places = np.unique(np.linspace(0, len(numbers) - 1, ROTATIONS).round().astype(int))
    grids = [_grid(returns[returns.rotation == numbers[place]]) for place in places]
    _refuse(_remark(max((_changed(grids[0], grid) for grid in grids[1:]), default=0.0)), where)


def _refuse(remarks: list[str], where: str) -> None:
    """Raise an error for a scanner that moved."""
    for remark in remarks:
        raise RecordingError(
            remark,
            where=where,
            allowed=f"less than {100 * MOVED_SHARE:.0f} %",
            hint="A calibration needs recordings of a scanner that stands still.",
        )


def _remark(share: float) -> list[str]:
    """Remark on a share of changed surfaces, if it is large."""
    if share < MOVED_SHARE:
        return []
    return [f"the scanner moves: {100 * share:.0f} % of the smooth surfaces change their distance"]


def _grid(returns: Returns) -> Array:
    """Median distance of every laser and azimuth bin of a rotation; NaN without a return."""
    found, scanner = returns.seen, returns.scanner
    bins = AZIMUTH_TICKS // _BIN_TICKS
    cell = found.laser_id.astype(np.int64) * bins + found.azimuth.astype(np.int64) // _BIN_TICKS
    ascending = np.lexsort((found.distance, cell))
    distance = found.distance[ascending]
    cells, first, count = np.unique(cell[ascending], return_index=True, return_counts=True)
    grid = np.full(scanner.n_lasers * bins, np.nan)
    grid[cells] = distance[first + count // 2] * scanner.distance_tick_m
    return grid.reshape(scanner.n_lasers, bins)


def _changed(before: Array, after: Array) -> float:
    """Share of the cells that are smooth in both rotations in which the distance has changed."""
    smooth = _smooth(before) & _smooth(after)
    if np.count_nonzero(smooth) < _LEAST_CELLS:
        return 0.0
    change = np.abs(after - before)[smooth]
    return float(np.mean(change > _CHANGED_M))


def _smooth(grid: Array) -> NDArray[np.bool_]:
    """Whether the distance of a cell is between those of its neighbours, or nearly."""
    either = [np.abs(grid - np.roll(grid, shift, axis=1)) < _SMOOTH_M for shift in (-1, 1)]
    return np.asarray(either[0] & either[1])
