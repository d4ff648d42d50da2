"""Our own complete format: JSON with all that is known of a calibration, a line per laser.

Numbers are in metres and radians, under the names of our CSV; each laser has its standard
deviations (`std`) and covariances (`covariance`, keys `dl_m*alpha_rad`, unit the product).
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

from velocal.calibration.files import document as lasers
from velocal.calibration.files.decimals import UNCHANGED
from velocal.calibration.files.document import OWN_KEYS, CalibrationFile, Document
from velocal.errors import CalibrationFileError
from velocal.io import storage
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import PARAMETERS, TWO_POINT

FORMAT, VERSION = "velocal calibration", 1
LASER_ID = "laser_id"
#: Keys of standard deviations and covariances.
STD = {name: OWN_KEYS[name][0] for name in PARAMETERS}
COVARIANCE = {
    pair: "*".join(STD[k] for k in pair) for pair in itertools.combinations(PARAMETERS, 2)
}
_TOP = (
    "format", "version", "scanner", "dialect", "distance_resolution_m", lasers.RATE_KEY,
    "provenance", "lasers",
)  # fmt: skip


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(lasers.content(path))
    except (ValueError, RecursionError) as error:
        raise CalibrationFileError(f"is not JSON: {error}", where=str(path)) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CalibrationFileError(
            "is JSON, but not a calibration", where=str(path), allowed=f"format {FORMAT!r}"
        )
    if content.get("version") != VERSION:
        raise CalibrationFileError(
            f"version is {content.get('version')!r}",
            where=str(path),
            allowed=str(VERSION),
            hint="Use the version of velocal that wrote it.",
        )
    _only(content, _TOP, str(path))
    for key, kind in (("lasers", list), ("provenance", dict), ("dialect", str)):
        if not isinstance(content.get(key), kind):
            raise CalibrationFileError(
                f"{key} is of type {type(content.get(key)).__name__}",
                where=str(path),
                allowed={list: "a list", dict: "an object", str: "text"}[kind],
            )
    if not isinstance(content.get("scanner"), str | None):
        raise CalibrationFileError(
            f"scanner is of type {type(content['scanner']).__name__}",
            where=str(path),
            allowed=f"null, or one of {', '.join(SCANNERS)}",
        )
    for index, entry in enumerate(content["lasers"]):
        where = f"{path}, entry {index} of lasers"
        if not isinstance(entry, dict):
            raise CalibrationFileError(f"is of type {type(entry).__name__}", where=where)
        known = (LASER_ID, *(key for key, _ in OWN_KEYS.values()), "std", "covariance")
        _only(entry, known, where)
        _only(entry.get("std", {}), STD.values(), f"{where}, std")
        _only(entry.get("covariance", {}), COVARIANCE.values(), f"{where}, covariance")
    return content


def _only(found: Any, allowed: Any, where: str) -> None:
    names = tuple(allowed)
    if not isinstance(found, dict):
        raise CalibrationFileError(f"is of type {type(found).__name__}", where=where)
    if unknown := [key for key in found if key not in names]:
        raise CalibrationFileError(
            f"unknown: {', '.join(unknown)}", where=where, allowed=", ".join(names)
        )


def parse(path: Path) -> Document:
    """Parse the file.

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
    content = _content(path)
    return Document(
        path,
        OWN_KEYS,
        LASER_ID,
        [(f"entry {index} of lasers", entry) for index, entry in enumerate(content["lasers"])],
        required=PARAMETERS,
        tick=("distance_resolution_m", content.get("distance_resolution_m"), UNCHANGED),
        dialect=content["dialect"],
        scanner=content.get("scanner"),
        std=STD,
        covariance=COVARIANCE,
        provenance=content["provenance"],
        rotation_rate_hz=content.get(lasers.RATE_KEY),
    )


def write(path: Path, found: CalibrationFile) -> None:
    """Write all that is known; what is unknown (NaN) is null.

    Parameters
    ----------
    path : Path
    found : CalibrationFile

    Raises
    ------
    CalibrationFileError
        If a value is not finite.
    """
    entries = []
    for laser, row in enumerate(lasers.rows(path, found.parameters)):
        entry: dict[str, Any] = {LASER_ID: laser}
        entry |= {OWN_KEYS[k][0]: bool(v) if k == TWO_POINT else v for k, v in row.items()}
        if found.std:
            entry["std"] = {STD[k]: float(v[laser]) for k, v in found.std.items()}
        if found.covariance:
            entry["covariance"] = {
                COVARIANCE[pair]: float(v[laser]) for pair, v in found.covariance.items()
            }
        entries.append(json.dumps(storage.finite(entry), allow_nan=False))
    head = {
        "format": FORMAT,
        "version": VERSION,
        "scanner": found.scanner,
        "dialect": found.dialect or "paper",
        "distance_resolution_m": found.tick_m,
        **({} if found.rotation_rate_hz is None else {lasers.RATE_KEY: found.rotation_rate_hz}),
        "provenance": storage.finite(dict(found.provenance)),
    }
    top = json.dumps(head, indent=1, allow_nan=False)[:-2]
    lines = ",\n  ".join(entries)
    storage.write_text(path, f'{top},\n "lasers": [\n  {lines}\n ]\n}}\n')
