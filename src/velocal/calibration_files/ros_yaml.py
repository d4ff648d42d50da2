"""The YAML of the ROS driver `velodyne_pointcloud`, in radians and metres."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from velocal import storage
from velocal.calibration_files import lasers
from velocal.calibration_files.decimals import UNCHANGED, number
from velocal.errors import CalibrationFileError
from velocal.parameters import ParameterSet
from velocal.sensors import DISTANCE_TICK_M

#: Keys of one laser.
KEYS: lasers.Keys = {
    "dl": ("dist_correction", UNCHANGED),
    "alpha": ("rot_correction", UNCHANGED),
    "v": ("vert_correction", UNCHANGED),
    "voff": ("vert_offset_correction", UNCHANGED),
    "hoff": ("horiz_offset_correction", UNCHANGED),
    **{name: (name, UNCHANGED) for name in lasers.CARRIED},
}
NEAR_POINT = ("dist_correction_x", "dist_correction_y")
#: Whether the driver interpolates between near-point and distance corrections.
TWO_POINT = "two_pt_correction_available"


def read(path: Path, n_lasers: int) -> ParameterSet:
    """Read a calibration.

    Near-point corrections are carried only where the driver uses them, that is where
    `two_pt_correction_available` is true.

    Parameters
    ----------
    path : Path
    n_lasers : int
        Number of lasers of the scanner.

    Raises
    ------
    CalibrationFileError
        If the file is not a calibration, or not of a scanner with so many lasers.
    """
    where = str(path)
    data = lasers.content(path)
    try:
        document = yaml.safe_load(data)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        # The first line says what; the rest repeats the text.
        reason = " ".join(str(error).split("\n")[:2])
        raise CalibrationFileError(f"is not YAML: {reason}", where=where) from None
    entries = document.get("lasers") if isinstance(document, dict) else None
    if not isinstance(entries, list):
        raise CalibrationFileError(
            "holds no list 'lasers'", where=where, allowed="the YAML of velodyne_pointcloud"
        )
    if "distance_resolution" in document:
        tick_m = number(document["distance_resolution"], "distance_resolution", where)
        lasers.check_tick(tick_m, "distance_resolution", path)
    stated = number(document.get("num_lasers", len(entries)), "num_lasers", where)
    if stated != len(entries):
        raise CalibrationFileError(
            f"num_lasers is {stated:g}, but the list 'lasers' has {len(entries)} entries",
            where=where,
        )
    return lasers.parameter_set(
        path, _lasers(entries, path), n_lasers, angle_hint=lasers.DEGREES_HINT
    )


def _lasers(entries: list[Any], path: Path) -> Iterator[tuple[int, dict[str, float]]]:
    for index, entry in enumerate(entries):
        where = f"{path}, entry {index} of lasers"
        if not isinstance(entry, dict):
            raise CalibrationFileError(f"is of type {type(entry).__name__}", where=where)
        laser = lasers.laser_id(entry.get("laser_id"), "laser_id", where)
        values = lasers.values(entry, KEYS, f"{path}, laser {laser}")
        two_point = entry.get(TWO_POINT, False)
        if not isinstance(two_point, bool):
            raise CalibrationFileError(
                f"{TWO_POINT} is of type {type(two_point).__name__}",
                where=f"{path}, laser {laser}",
                allowed="true, false",
            )
        if not two_point:
            values = {name: value for name, value in values.items() if name not in NEAR_POINT}
        yield laser, values


def write(path: Path, parameters: ParameterSet) -> None:
    """Write a calibration with all the keys that drivers ask for.

    Values that the set does not carry are written such that they have no effect (see
    `lasers.neutral`).

    Raises
    ------
    CalibrationFileError
        If a value is not finite.
    """
    two_point = any(name in parameters.carried for name in NEAR_POINT)
    entries = [
        {"laser_id": laser, TWO_POINT: two_point}
        | {KEYS[name][0]: _plain(name, value) for name, value in lasers.neutral(row).items()}
        for laser, row in enumerate(lasers.rows(path, parameters))
    ]
    document = {
        "num_lasers": len(entries),
        "distance_resolution": DISTANCE_TICK_M,
        "lasers": entries,
    }
    storage.write_text(path, yaml.safe_dump(document, default_flow_style=False))


def _plain(name: str, value: float) -> float | int:
    # The driver reads intensities as whole numbers and stops at a decimal point.
    return int(value) if name.endswith("_intensity") and value.is_integer() else value
