"""The YAML of the ROS driver `velodyne_pointcloud` and of velodyne_decoder: radians, metres."""

from __future__ import annotations

from pathlib import Path

import yaml

from velocal.calibration.files import document as lasers
from velocal.calibration.files.decimals import UNCHANGED
from velocal.calibration.files.document import CalibrationFile, Document
from velocal.errors import CalibrationFileError
from velocal.io import storage
from velocal.io.yaml_text import parse_yaml
from velocal.scanner.parameters import NEAR_POINT, TWO_POINT

#: Lists of scanners with so few lasers are filled up to this length by some converters.
FILLED, FEW = 64, (16, 32)
#: Keys of one laser.
KEYS: lasers.Keys = {
    "dl": ("dist_correction", UNCHANGED),
    "alpha": ("rot_correction", UNCHANGED),
    "v": ("vert_correction", UNCHANGED),
    "voff": ("vert_offset_correction", UNCHANGED),
    "hoff": ("horiz_offset_correction", UNCHANGED),
    **{name: (name, UNCHANGED) for name in lasers.CARRIED},
}


def parse(path: Path) -> Document:
    """Parse the file; a laser without the two-point flag has it off, as in ROS.

    Entries that only fill the list up to 64, as in files of 32 lasers, are left out.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Document
        As the file is, right or wrong.

    Raises
    ------
    CalibrationFileError
        If the file cannot be read, or is not of this format.
    """
    where = str(path)
    # Drivers take the last of two equal keys.
    document = parse_yaml(lasers.content(path), where, CalibrationFileError, unique_keys=False)
    entries = document.get("lasers") if isinstance(document, dict) else None
    if not isinstance(entries, list):
        raise CalibrationFileError(
            "holds no list 'lasers'", where=where, allowed="the YAML of velodyne_pointcloud"
        )
    found = []
    for index, entry in enumerate(entries):
        place = f"entry {index} of lasers"
        if not isinstance(entry, dict):
            raise CalibrationFileError(
                f"is of type {type(entry).__name__}", where=f"{where}, {place}"
            )
        found.append((place, {TWO_POINT: False} | entry))
    stated = document.get("num_lasers")
    for n_lasers in FEW:
        rest = found[n_lasers:]
        if len(found) == FILLED and all(lasers.is_filler(KEYS, entry) for _, entry in rest):
            stated = n_lasers if stated == FILLED else stated
            del found[n_lasers:]
    dialect = document.get("dialect")
    return Document(
        path,
        KEYS,
        "laser_id",
        found,
        required=("alpha", "v"),  # velodyne_decoder leaves out a distance correction of zero
        tick=("distance_resolution", document.get("distance_resolution"), UNCHANGED),
        stated=stated,
        dialect=None if dialect is None else str(dialect),
        rotation_rate_hz=document.get(lasers.RATE_KEY),
    )


def write(path: Path, found: CalibrationFile) -> None:
    """Write all the keys that drivers ask for.

    Where the set carries no flag, it is set as the ROS driver's converter of XML does: where both
    near-point corrections are other than zero. The dialect and the rotation rate stand under keys
    that no reader asks for.

    Parameters
    ----------
    path : Path
    found : CalibrationFile

    Raises
    ------
    CalibrationFileError
        If a value is not finite.
    """
    carried = found.parameters.carried
    two_point = NEAR_POINT[0] in carried and TWO_POINT not in carried
    entries = []
    for laser, row in enumerate(lasers.rows(path, found.parameters)):
        row = lasers.neutral(row)
        if two_point:
            row[TWO_POINT] = float(row[NEAR_POINT[0]] != 0 and row[NEAR_POINT[1]] != 0)
        entries.append({"laser_id": laser} | {KEYS[k][0]: _plain(k, v) for k, v in row.items()})
    document = {
        "num_lasers": len(entries),
        "distance_resolution": found.tick_m,
        "lasers": entries,
    }
    if found.dialect is not None:
        document["dialect"] = found.dialect
    if found.rotation_rate_hz is not None:
        document[lasers.RATE_KEY] = found.rotation_rate_hz
    storage.write_text(path, yaml.safe_dump(document, default_flow_style=False))


def _plain(name: str, value: float) -> float | int | bool:
    if name == TWO_POINT:
        return value != 0
    # The driver reads intensities as whole numbers and stops at a decimal point.
    return int(value) if name.endswith("_intensity") and value.is_integer() else value
