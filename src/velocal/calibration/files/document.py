"""What all formats share: from what a file holds of single lasers to a checked calibration.

A format's ``parse`` gives a `Document`, which is as the file is, right or wrong; `checked`
checks it and stops at the first fault, `velocal.calibration.lint` names all of them.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from velocal.arrays import Array
from velocal.calibration.files.decimals import UNCHANGED, number
from velocal.errors import CalibrationFileError
from velocal.geometry.covariance import covariance_fault
from velocal.scanner.models import DISTANCE_TICK_M, SCANNERS
from velocal.scanner.parameters import (
    NEAR_POINT,
    PARAMETERS,
    TWO_POINT,
    UNITS,
    LaserParameters,
)

#: What files hold besides the parameters, by its name in ROS YAML, with our unit. The near-point
#: corrections and the focal distance are in metres whatever the file's unit is.
CARRIED = {
    "dist_correction_x": "m",
    "dist_correction_y": "m",
    TWO_POINT: "",
    "focal_distance": "m",
    "focal_slope": "",
    "min_intensity": "",
    "max_intensity": "",
}
#: Hint of the formats in radians for a vertical angle beyond the vertical.
DEGREES_HINT = "The file seems to hold degrees where radians are expected."

#: Key of the rotation rate in files of this project, and the largest one that is believed.
RATE_KEY, MAX_RATE_HZ = "rotation_rate_hz", 50.0

_Key = TypeVar("_Key")
#: Values of one laser by our names, metres and radians.
Values = Mapping[str, float]
#: Key of a file, and the file's unit in ours, by our names.
Keys = Mapping[str, tuple[str, Decimal]]

#: Names of columns and keys in formats of our own, unit at the end.
OWN_KEYS: Keys = {
    name: (f"{name}_{unit}" if unit else name, UNCHANGED)
    for name, unit in {**UNITS, **CARRIED}.items()
}


@dataclass(frozen=True)
class CalibrationFile:
    """All that a calibration file holds: the parameters and what is known of them.

    Attributes
    ----------
    parameters : LaserParameters
    dialect : str or None
        Name of the point formula that the numbers belong to; None where the file does not say.
    scanner : str or None
        Name of the scanner; None where the file does not say.
    tick_m : float
        Metres of one unit of raw distance.
    std : mapping of str to ndarray, shape (n,)
        Standard deviations by parameter; NaN where unknown.
    covariance : mapping of (str, str) to ndarray, shape (n,)
        Covariances of two parameters of a laser, where they are known.
    provenance : mapping of str to object
        Where the numbers come from: plain values for JSON.
    disabled : tuple of int
        Lasers that the file turns off although it has values of them (XML only).
    rotation_rate_hz : float or None
        Rotation rate for which the rotational angles are, where a program turns the azimuths within
        a firing in another way than the model; None if they are for any rate.
    """

    parameters: LaserParameters
    dialect: str | None = None
    scanner: str | None = None
    tick_m: float = DISTANCE_TICK_M
    std: Mapping[str, Array] = field(default_factory=dict)
    covariance: Mapping[tuple[str, str], Array] = field(default_factory=dict)
    provenance: Mapping[str, object] = field(default_factory=dict)
    disabled: tuple[int, ...] = ()
    rotation_rate_hz: float | None = None


@dataclass(frozen=True)
class Document:
    """What a file holds, before it is checked.

    Attributes
    ----------
    path : Path
    keys : mapping
        The file's keys and units by our names.
    id_key : str
    lasers : sequence of (str, mapping of str to object)
        Of every laser: where in the file, and its values under the file's keys.
    required : tuple of str
        Names without which a laser is not calibrated; others get `neutral` values.
    tick : (str, object, Decimal) or None
        Key, value and unit of the raw distance, if stated.
    stated : object
        Number of lasers that the file states, if it does.
    dialect : str or None
    angle_hint : str or None
        What to say of a vertical angle beyond the vertical.
    listed : mapping of str to int
        Lengths of lists beside the lasers (XML only).
    scanner : str or None
    std : mapping of str to str
        Keys of standard deviations in the part ``std`` of a laser, by parameter.
    covariance : mapping of (str, str) to str
        Keys of covariances in the part ``covariance`` of a laser, by two parameters.
    provenance : mapping of str to object
    disabled : tuple of int
        Lasers that are left out because the file turns them off, and that hold values.
    rotation_rate_hz : object
        Rotation rate that the file states, if it does.
    """

    path: Path
    keys: Keys
    id_key: str
    lasers: Sequence[tuple[str, Mapping[str, object]]]
    required: tuple[str, ...] = ("dl", "alpha", "v")
    tick: tuple[str, object, Decimal] | None = None
    stated: object = None
    dialect: str | None = None
    angle_hint: str | None = DEGREES_HINT
    listed: Mapping[str, int] = field(default_factory=dict)
    scanner: str | None = None
    std: Mapping[str, str] = field(default_factory=dict)
    covariance: Mapping[tuple[str, str], str] = field(default_factory=dict)
    provenance: Mapping[str, object] = field(default_factory=dict)
    disabled: tuple[int, ...] = ()
    rotation_rate_hz: object = None


def is_filler(document_keys: Keys, entry: Mapping[str, object]) -> bool:
    """Whether an entry has no value: lists of some files are filled up to 64 entries.

    Parameters
    ----------
    document_keys : mapping
        Keys of the format by our names.
    entry : mapping of str to object
        Values of a laser under the keys of the file.
    """
    names = (*PARAMETERS, *NEAR_POINT, "focal_distance", "focal_slope")
    values = (entry.get(document_keys[name][0]) for name in names)
    return all(
        re.fullmatch(r"-?0*\.?0*", each) if isinstance(each, str) else not each for each in values
    )


def content(path: Path) -> bytes:
    """Read a file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    bytes

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

    Parameters
    ----------
    value : object
        What the file holds; None if it has no such key.
    key, where : str
        Named in errors.

    Returns
    -------
    int

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


def value(document: Document, name: str, found: Mapping[str, object], where: str) -> float | None:
    """Convert one value of a laser.

    Parameters
    ----------
    document : Document
    name : str
        Our name of the value.
    found : mapping of str to object
        Values of the laser under the keys of the file.
    where : str
        Named in errors.

    Returns
    -------
    float or None
        Metres, radians, or a plain number; None if an optional value is absent.

    Raises
    ------
    CalibrationFileError
        If a required value is missing, or a value is not a finite number.
    """
    key, unit = document.keys[name]
    entry = found.get(key)
    if name == TWO_POINT and key in found:
        if not isinstance(entry, bool) and entry not in ("0", "1", "0.0", "1.0"):
            raise CalibrationFileError(
                f"{key} is of type {type(entry).__name__}", where=where, allowed="true, false"
            )
        return float(entry)
    if entry is None and name not in document.required:
        return None
    return number(entry, key, where, unit)


def neutral(known: Values) -> dict[str, float]:
    """Complete the values of a laser by ones that leave every reader's points as they are.

    Near-point corrections equal to the distance correction make the two-point interpolation vanish.

    Parameters
    ----------
    known : mapping of str to float
        Values of the laser by our names.

    Returns
    -------
    dict of str to float
        All values that any format writes.
    """
    dl = known.get("dl", 0.0)
    return {
        "dl": dl,
        "voff": 0.0,
        "hoff": 0.0,
        **dict.fromkeys(NEAR_POINT, dl),
        TWO_POINT: 0.0,
        "focal_distance": 0.0,
        "focal_slope": 0.0,
        "min_intensity": 0.0,
        "max_intensity": 255.0,
        **known,
    }


def tick_m(document: Document) -> float:
    """Find the size of one unit of raw distance.

    Parameters
    ----------
    document : Document

    Returns
    -------
    float
        Metres; 2 mm if the file does not state it.

    Raises
    ------
    CalibrationFileError
        If it is not a positive number, or is beyond 2 cm, ten times that of any scanner.
    """
    if document.tick is None or document.tick[1] is None:
        return DISTANCE_TICK_M
    key, stated, unit = document.tick
    found = number(stated, key, str(document.path), unit)
    if not 0.0 < found <= 0.02:
        raise CalibrationFileError(
            f"{key} is {found:g} m",
            where=str(document.path),
            allowed="0.002 m, or 0.004 m for a VLP-32C or VLS-128",
            hint="Centimetres where metres are expected?" if np.isclose(found, 0.2) else None,
        )
    # Files in centimetres give 0.2: the decimal is exact, and so is what is compared with it.
    return DISTANCE_TICK_M if np.isclose(found, DISTANCE_TICK_M, rtol=1e-6) else found


def checked(
    document: Document, n_lasers: int | None = None, scanner: str | None = None
) -> CalibrationFile:
    """Check what a file holds, and take it as a calibration.

    Parameters
    ----------
    document : Document
    n_lasers : int, optional
        Number of lasers of the scanner; if None, as many as there are.
    scanner : str, optional
        Name of the scanner, which a file may have described: then it is not among `SCANNERS`.

    Returns
    -------
    CalibrationFile

    Raises
    ------
    CalibrationFileError
        If a value is missing or no finite number, lasers are missing, doubled or too many, or an
        angle, a covariance or the scanner is impossible.
    """
    path, by_id, entries = document.path, dict[int, Values](), dict[int, Mapping[str, Any]]()
    tick = tick_m(document)
    if document.stated is not None:
        stated = number(document.stated, "num_lasers", str(path))
        if stated != len(document.lasers):
            raise CalibrationFileError(
                f"num_lasers is {stated:g}, but the list 'lasers' has {len(document.lasers)} "
                "entries",
                where=str(path),
            )
    for place, found in document.lasers:
        laser = laser_id(found.get(document.id_key), document.id_key, f"{path}, {place}")
        where = f"{path}, laser {laser}"
        converted = {name: value(document, name, found, where) for name in document.keys}
        known = {name: entry for name, entry in converted.items() if entry is not None}
        if laser in by_id:
            raise CalibrationFileError("the laser id is doubled", where=where)
        if abs(known["v"]) > np.pi / 2:
            raise CalibrationFileError(
                f"the vertical angle is {known['v']:g} rad",
                where=where,
                allowed="-pi/2 to pi/2",
                hint=document.angle_hint,
            )
        by_id[laser], entries[laser] = known, found
    _check_ids(path, set(by_id), n_lasers, document.disabled)
    carried = [name for name in CARRIED if any(name in known for known in by_id.values())]
    rows = [neutral(by_id[laser]) for laser in sorted(by_id)]
    columns = {
        name: np.array([row[name] for row in rows], dtype=np.float64)
        for name in (*PARAMETERS, *carried)
    }
    parameters = LaserParameters(
        **{name: columns[name] for name in PARAMETERS},
        carried={name: columns[name] for name in carried},
    )
    ordered = [entries[laser] for laser in sorted(entries)]
    if document.scanner not in (None, scanner, *SCANNERS):
        raise CalibrationFileError(
            f"unknown scanner {document.scanner!r}",
            where=str(path),
            allowed=", ".join(SCANNERS),
            hint="If a YAML file describes the scanner, name that file as the scanner.",
        )
    calibration = CalibrationFile(
        parameters,
        document.dialect,
        document.scanner,
        tick,
        std=_columns(ordered, "std", document.std, path),
        covariance=_columns(ordered, "covariance", document.covariance, path),
        provenance=document.provenance,
        disabled=document.disabled,
        rotation_rate_hz=_rate_hz(document),
    )
    _check_covariances(path, calibration)
    return calibration


def _check_covariances(path: Path, found: CalibrationFile) -> None:
    """Check that the standard deviations and covariances of every laser can be ones."""
    names = [name for name in PARAMETERS if name in found.std]
    for laser in range(len(found.parameters)):
        where = f"{path}, laser {laser}"
        std = {name: float(found.std[name][laser]) for name in names}
        for name, value in std.items():
            if value < 0.0:
                raise CalibrationFileError(
                    f"the standard deviation of {name} is {value:g}",
                    where=where,
                    allowed="0 or more, or null where it is unknown",
                )
        known = [name for name in names if np.isfinite(std[name])]
        matrix = np.diag([std[name] ** 2 for name in known])
        for row, column in itertools.combinations(range(len(known)), 2):
            values = found.covariance.get((known[row], known[column]))
            value = 0.0 if values is None else float(np.nan_to_num(values[laser]))
            matrix[row, column] = matrix[column, row] = value
        if fault := covariance_fault(matrix):
            raise CalibrationFileError(
                f"the covariance is impossible: {fault}",
                where=where,
                allowed="a symmetric, positive semidefinite matrix",
                hint="No covariance exceeds the product of the two standard deviations.",
            )


def _rate_hz(document: Document) -> float | None:
    if document.rotation_rate_hz is None:
        return None
    where = str(document.path)
    found = number(document.rotation_rate_hz, RATE_KEY, where)
    if not 0.0 < found <= MAX_RATE_HZ:
        raise CalibrationFileError(
            f"{RATE_KEY} is {found:g}", where=where, allowed=f"above 0, up to {MAX_RATE_HZ:g} Hz"
        )
    return found


def _columns(
    entries: Sequence[Mapping[str, Any]], part: str, keys: Mapping[_Key, str], path: Path
) -> dict[_Key, Array]:
    """Columns of those numbers in a part of every laser that any of them has; NaN for null."""
    found = {}
    for name, key in keys.items():
        parts = [entry.get(part, {}) for entry in entries]
        if any(key in each for each in parts):
            values = [each.get(key) for each in parts]
            where = f"{path}, {part}"
            found[name] = np.array([np.nan if v is None else number(v, key, where) for v in values])
    return found


def _check_ids(
    path: Path, ids: set[int], n_lasers: int | None, disabled: Sequence[int] = ()
) -> None:
    wanted = set(range(len(ids) if n_lasers is None else n_lasers))
    if not ids:
        raise CalibrationFileError("holds no lasers", where=str(path))
    if ids == wanted:
        return
    off = "The file turns lasers off (enabled_) that have values: set enabled_ to 1 to use them."
    hint = off if (wanted - ids) & set(disabled) else None
    if ids == set(range(len(ids))):
        raise CalibrationFileError(
            f"holds {len(ids)} lasers",
            where=str(path),
            allowed=f"{n_lasers}, as the scanner has",
            hint=hint or "Is this the file of another scanner?",
        )
    faults = {"missing": wanted - ids, "unknown": ids - wanted}
    raise CalibrationFileError(
        "; ".join(
            f"laser ids {what}: {', '.join(map(str, sorted(some)))}"
            for what, some in faults.items()
            if some
        ),
        where=str(path),
        allowed=f"each of 0 to {len(wanted) - 1} once",
        hint=hint,
    )


def rows(path: Path, parameters: LaserParameters) -> list[dict[str, float]]:
    """List the values of each laser, for writing.

    Parameters
    ----------
    path : Path
        Named in errors.
    parameters : LaserParameters

    Returns
    -------
    list of dict of str to float
        By laser: its parameters and carried values, by our names.

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
