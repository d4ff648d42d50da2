"""What all formats share: from the values of single lasers to a checked set, and back."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from decimal import Decimal
from pathlib import Path

import numpy as np

from velocal.calibration_files.decimals import number
from velocal.errors import CalibrationFileError
from velocal.parameters import PARAMETERS, ParameterSet
from velocal.sensors import DISTANCE_TICK_M

#: What files hold besides the parameters, by its name in ROS YAML, with our unit. The near-point
#: corrections and the focal distance are in metres whatever the file's unit is.
CARRIED = {
    "dist_correction_x": "m",
    "dist_correction_y": "m",
    "focal_distance": "m",
    "focal_slope": "",
    "min_intensity": "",
    "max_intensity": "",
}
#: Without these a file is no calibration.
REQUIRED = ("dl", "alpha", "v")
#: Hint of the formats in radians for a vertical angle beyond the vertical.
DEGREES_HINT = "The file seems to hold degrees where radians are expected."

#: Values of one laser by our names, metres and radians.
Values = Mapping[str, float]
#: Key of a file, and the file's unit in ours, by our names.
Keys = Mapping[str, tuple[str, Decimal]]


def content(path: Path) -> bytes:
    """Read a file.

    Raises
    ------
    CalibrationFileError
        If it cannot be read, or is a web page.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CalibrationFileError(f"cannot be read: {error.strerror}", where=str(path)) from None
    if re.search(rb"<!doctype\s+html|<html\b", data[:1000].lower()):
        raise CalibrationFileError(
            "is a web page, not a calibration file",
            where=str(path),
            hint="Download the file itself, not the page that shows it.",
        )
    return data


def laser_id(value: object, key: str, where: str) -> int:
    """Convert a laser id, which some files write as `0.0`.

    Raises
    ------
    CalibrationFileError
        If it is not a whole number from 0 on.
    """
    found = number(value, key, where)
    if found < 0 or not found.is_integer():
        raise CalibrationFileError(
            f"{key} is {found}", where=where, allowed="whole numbers from 0 on"
        )
    return int(found)


def values(found: Mapping[str, object], keys: Keys, where: str) -> dict[str, float]:
    """Convert what a file holds of one laser; optional keys may be absent.

    Raises
    ------
    CalibrationFileError
        If a required key is missing, or a value is not a finite number.
    """
    return {
        name: number(found.get(key), key, where, unit)
        for name, (key, unit) in keys.items()
        if name in REQUIRED or found.get(key) is not None
    }


def neutral(known: Values) -> dict[str, float]:
    """Complete the values of a laser by ones that leave every reader's points as they are.

    Near-point corrections equal to the distance correction make the two-point interpolation vanish.
    """
    return {
        "voff": 0.0,
        "hoff": 0.0,
        "dist_correction_x": known["dl"],
        "dist_correction_y": known["dl"],
        "focal_distance": 0.0,
        "focal_slope": 0.0,
        "min_intensity": 0.0,
        "max_intensity": 255.0,
        **known,
    }


def check_tick(tick_m: float, key: str, path: Path) -> None:
    """Refuse a file made for another distance tick (metres): its scanner is not one of ours.

    Raises
    ------
    CalibrationFileError
        If the tick differs.
    """
    if not np.isclose(tick_m, DISTANCE_TICK_M, rtol=1e-6):
        raise CalibrationFileError(
            f"{key} is {tick_m:g} m", where=str(path), allowed=f"{DISTANCE_TICK_M} m"
        )


def parameter_set(
    path: Path,
    lasers: Iterable[tuple[int, Values]],
    n_lasers: int | None,
    angle_hint: str | None = None,
) -> ParameterSet:
    """Put the values of the lasers together.

    Parameters
    ----------
    path : Path
        Named in errors.
    lasers : iterable of (int, mapping of str to float)
        Laser id and values, in any order.
    n_lasers : int, optional
        Number of lasers of the scanner; if None, as many as there are.
    angle_hint : str, optional
        What to say if a vertical angle is beyond the vertical.

    Raises
    ------
    CalibrationFileError
        If lasers are missing, doubled or too many, or an angle is impossible.
    """
    by_id: dict[int, Values] = {}
    for laser, known in lasers:
        where = f"{path}, laser {laser}"
        if laser in by_id:
            raise CalibrationFileError("the laser id is doubled", where=where)
        if abs(known["v"]) > np.pi / 2:
            raise CalibrationFileError(
                f"the vertical angle is {known['v']:g} rad",
                where=where,
                allowed="-pi/2 to pi/2",
                hint=angle_hint,
            )
        by_id[laser] = known
    _check_ids(path, set(by_id), n_lasers)
    carried = [name for name in CARRIED if any(name in known for known in by_id.values())]
    rows = [neutral(by_id[laser]) for laser in sorted(by_id)]
    columns = {
        name: np.array([row[name] for row in rows], dtype=np.float64)
        for name in (*PARAMETERS, *carried)
    }
    return ParameterSet(
        **{name: columns[name] for name in PARAMETERS},
        carried={name: columns[name] for name in carried},
    )


def _check_ids(path: Path, ids: set[int], n_lasers: int | None) -> None:
    wanted = set(range(len(ids) if n_lasers is None else n_lasers))
    if not ids:
        raise CalibrationFileError("holds no lasers", where=str(path))
    if ids == wanted:
        return
    if ids == set(range(len(ids))):
        raise CalibrationFileError(
            f"holds {len(ids)} lasers",
            where=str(path),
            allowed=f"{n_lasers}, as the scanner has",
            hint="Is this the file of another scanner?",
        )
    odd = {"missing": wanted - ids, "unknown": ids - wanted}
    raise CalibrationFileError(
        "; ".join(
            f"laser ids {what}: {', '.join(map(str, sorted(some)))}"
            for what, some in odd.items()
            if some
        ),
        where=str(path),
        allowed=f"each of 0 to {len(wanted) - 1} once",
    )


def rows(path: Path, parameters: ParameterSet) -> list[dict[str, float]]:
    """Take a set apart into the values of its lasers, for writing.

    Raises
    ------
    CalibrationFileError
        If a value is not finite, or a carried array does not belong to the same lasers.
    """
    columns = {name: getattr(parameters, name) for name in PARAMETERS}
    columns |= {name: parameters.carried[name] for name in CARRIED if name in parameters.carried}
    for name, column in columns.items():
        if column.shape != parameters.dl.shape:
            raise CalibrationFileError(f"{name} has shape {column.shape}", where=str(path))
        if not np.isfinite(column).all():
            raise CalibrationFileError(
                f"{name} of laser {np.flatnonzero(~np.isfinite(column))[0]} is not finite",
                where=str(path),
                hint="Drivers cannot use it; write the value from before the adjustment.",
            )
    return [
        {name: float(column[laser]) for name, column in columns.items()}
        for laser in range(len(parameters))
    ]
