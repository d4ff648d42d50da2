"""What every reader of clouds gives: points with what their file says of each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array, rows_of
from velocal.errors import RecordingError

#: Names of the field that says which laser a point is of, most precise first.
LASER_FIELDS = ("laser_id", "ring", "laser", "channel", "line", "beam")
_INTENSITY_FIELDS = ("intensity", "reflectivity")
#: Of the point, seconds; of Ouster (`t`) and others that write whole numbers, nanoseconds.
_TIME_FIELDS = ("time", "timestamp", "t", "time_stamp", "offset_time")
#: Largest number of a laser that a table of returns can hold.
LARGEST_LASER = 255
#: Seconds since 1970 have ten digits.
_LATEST_S = 1e11
_COORDINATE_HINT = "A cloud needs the fields x, y and z."


@dataclass(frozen=True)
class PointBlock:
    """Points of one scan, or of a part of a file.

    Attributes
    ----------
    xyz : ndarray, shape (n, 3)
        As the file has them, metres; NaN where it has no point.
    laser : ndarray of int64, shape (n,), or None
        Number of the laser as the file counts them, from 0; None where it does not say.
    laser_field : str
        Name of the field that contains it; empty if the file has no such field.
    intensity : ndarray of uint8, shape (n,)
        Zeros where the file does not say.
    rotation : ndarray of int64, shape (n,)
        Rotation of every point; that of the block for files without such a field.
    time_s : ndarray, shape (n,), or None
    """

    xyz: Array
    laser: NDArray[np.int64] | None
    laser_field: str
    intensity: NDArray[np.uint8]
    rotation: NDArray[np.int64]
    time_s: Array | None

    def __len__(self) -> int:
        return len(self.xyz)

    def __getitem__(self, rows: NDArray[Any]) -> PointBlock:
        return rows_of(self, rows)


def block_of(columns: Mapping[str, NDArray[Any]], rotation: int, where: str) -> PointBlock:
    """Points out of the fields of a file.

    Parameters
    ----------
    columns : mapping of str to ndarray, shape (n,)
        By the name of the field, whatever its type.
    rotation : int
        Number of the block, for files that do not number rotations.
    where : str
        File and message, for errors.

    Returns
    -------
    PointBlock

    Raises
    ------
    RecordingError
        If a coordinate is missing, or lasers are not numbered from 0 to 255.
    """
    given = {name.lower(): values for name, values in columns.items()}
    if missing := [axis for axis in "xyz" if axis not in given]:
        raise RecordingError(
            f"has no field {', '.join(missing)}",
            where=where,
            allowed=", ".join(columns) or None,
            hint=_COORDINATE_HINT,
        )
    with np.errstate(invalid="ignore", over="ignore"):
        xyz = np.stack([given[axis].astype(np.float64) for axis in "xyz"], axis=-1)
    name = _first(given, LASER_FIELDS)
    intensity = _first(given, _INTENSITY_FIELDS)
    time = _first(given, _TIME_FIELDS)
    numbers = given.get("rotation")
    return PointBlock(
        xyz,
        None if not name else _whole(given[name], name, LARGEST_LASER, where),
        name,
        _bytes(given[intensity]) if intensity else np.zeros(len(xyz), np.uint8),
        np.full(len(xyz), rotation, np.int64)
        if numbers is None
        else _whole(numbers, "rotation", 2**32 - 1, where),
        None if not time else _seconds(given[time]),
    )


def _first(given: Mapping[str, object], names: tuple[str, ...]) -> str:
    return next((name for name in names if name in given), "")


def _whole(values: NDArray[Any], name: str, largest: int, where: str) -> NDArray[np.int64]:
    """Numbers of lasers or rotations; some programs write them as floating point numbers."""
    with np.errstate(invalid="ignore"):
        wrong = ~((values >= 0) & (values <= largest) & (values == np.floor(values)))
    if wrong.any():
        raise RecordingError(
            f"field {name!r}: {values[wrong.argmax()]} is no number of a "
            + ("rotation" if name == "rotation" else "laser"),
            where=where,
            allowed=f"whole numbers from 0 to {largest}",
        )
    return values.astype(np.int64)


def _bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    """Intensities from 0 to 255; KITTI and others write shares of 1."""
    finite = np.nan_to_num(values.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    share = values.dtype.kind == "f" and len(finite) > 0 and finite.max() <= 1.0
    return np.clip(np.rint(finite * (255.0 if share else 1.0)), 0, 255).astype(np.uint8)


def _seconds(values: NDArray[Any]) -> Array:
    """Seconds; NaN for what is no time."""
    scale = 1.0 if values.dtype.kind == "f" else 1e-9
    with np.errstate(invalid="ignore"):
        seconds = np.asarray(values.astype(np.float64) * scale)
    return np.where(np.abs(seconds) < _LATEST_S, seconds, np.nan)
