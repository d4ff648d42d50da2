"""Velodyne's `db.xml`, an archive of boost_serialization, in degrees and centimetres.

The lists of the file have 64 items for scanners of 16 and 32 lasers too; `enabled_` tells which
lasers exist, the others are filled with zeros.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from velocal.calibration.files import document as lasers
from velocal.calibration.files.decimals import (
    METRES_PER_CENTIMETRE,
    RADIANS_PER_DEGREE,
    UNCHANGED,
    number,
    text,
)
from velocal.calibration.files.document import CalibrationFile, Document
from velocal.errors import CalibrationFileError
from velocal.io import storage
from velocal.scanner.parameters import NEAR_POINT, TWO_POINT

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

#: Tags of one laser in the order of the archive, which boost relies on.
TAGS = {
    "alpha": ("rotCorrection_", RADIANS_PER_DEGREE),
    "v": ("vertCorrection_", RADIANS_PER_DEGREE),
    "dl": ("distCorrection_", METRES_PER_CENTIMETRE),
    "dist_correction_x": ("distCorrectionX_", METRES_PER_CENTIMETRE),
    "dist_correction_y": ("distCorrectionY_", METRES_PER_CENTIMETRE),
    "voff": ("vertOffsetCorrection_", METRES_PER_CENTIMETRE),
    "hoff": ("horizOffsetCorrection_", METRES_PER_CENTIMETRE),
    "focal_distance": ("focalDistance_", METRES_PER_CENTIMETRE),
    "focal_slope": ("focalSlope_", UNCHANGED),
}
#: Lists that stand outside the lasers' items.
INTENSITIES = {"min_intensity": "minIntensity_", "max_intensity": "maxIntensity_"}
KEYS: lasers.Keys = TAGS | {name: (tag, UNCHANGED) for name, tag in INTENSITIES.items()}
#: The comment in which files of this project say which point formula their numbers belong to.
DIALECT = re.compile(rb"<!-- velocal: for the point formula of (\w+)(?: at ([\d.]+) Hz)? -->")
#: Known misspellings of tags (VLS-128 files).
MISSPELT = {"horizOffsetCorection_": "horizOffsetCorrection_"}
#: Lists are never shorter.
N_ITEMS = 64


def parse(path: Path) -> Document:
    """Parse the file; lasers that are not enabled, or only fill the lists up, are left out.

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
    data = lasers.content(path)
    database = _database(data, path)
    enabled = [number(item, "enabled_", str(path)) for item in _list(database, "enabled_")]
    intensities = {tag: _list(database, tag) for tag in INTENSITIES.values()}
    found, disabled = [], []
    for index, px in enumerate(database.iterfind("points_/item/px")):
        entry: dict[str, object] = {MISSPELT.get(c.tag, c.tag): c.text for c in px}
        place = f"item {index}"
        try:
            laser = lasers.laser_id(entry.get("id_"), "id_", place)
        except CalibrationFileError:  # checked later
            laser = index
        if laser < len(enabled) and not enabled[laser]:
            if not lasers.is_filler(KEYS, entry):
                disabled.append(laser)
            continue
        entry |= {tag: items[laser] for tag, items in intensities.items() if laser < len(items)}
        found.append((place, entry))
    if not enabled:  # fillers are known by their place behind the last laser, and by their zeros
        while found and lasers.is_filler(KEYS, found[-1][1]):
            found.pop()
    stated = DIALECT.search(data[-300:])
    return Document(
        path,
        KEYS,
        "id_",
        found,
        tick=("distLSB_", database.findtext("distLSB_"), METRES_PER_CENTIMETRE),
        dialect=stated[1].decode() if stated else None,
        rotation_rate_hz=stated[2].decode() if stated and stated[2] else None,
        angle_hint=None,
        listed={tag: len(items) for tag, items in intensities.items() if items}
        | ({"enabled_": len(enabled)} if enabled else {}),
        disabled=tuple(disabled),
    )


def _database(data: bytes, path: Path) -> Element:
    try:
        # Its DTD is only a name; defusedxml refuses the entities that make a DTD dangerous.
        root = fromstring(data, forbid_dtd=False)
    except DefusedXmlException:
        raise CalibrationFileError(
            "declares XML entities, which no calibration file needs", where=str(path)
        ) from None
    except (ParseError, ValueError, LookupError) as error:  # the latter two: unknown encodings
        raise CalibrationFileError(f"is not XML: {error}", where=str(path)) from None
    database: Element | None = root.find("DB")
    if database is None or database.find("points_") is None:
        raise CalibrationFileError(
            "is XML, but not a Velodyne calibration",
            where=str(path),
            allowed="lasers in boost_serialization/DB/points_/item/px",
        )
    return database


def _list(database: Element, tag: str) -> list[str | None]:
    """Items of a list by laser id; empty if the file has none."""
    return [item.text for item in database.iterfind(f"{tag}/item")]


def write(path: Path, found: CalibrationFile) -> None:
    """Write the structure of the manufacturer's files, with the shortest exact numbers.

    Near-point corrections that a flag turns off are written without effect, as the file has no
    flag. The dialect is in a comment at the end of the file, which readers ignore.

    Parameters
    ----------
    path : Path
    found : CalibrationFile

    Raises
    ------
    CalibrationFileError
        If a value is not finite.
    """
    parameters = found.parameters
    rows = [lasers.neutral(row) for row in lasers.rows(path, parameters)]
    if TWO_POINT in parameters.carried:
        rows = [
            row if row[TWO_POINT] else row | dict.fromkeys(NEAR_POINT, row["dl"]) for row in rows
        ]
    n_fillers = max(0, N_ITEMS - len(rows))
    rows += [lasers.neutral({"dl": 0.0, "alpha": 0.0, "v": 0.0})] * n_fillers
    enabled = [1] * len(parameters) + [0] * n_fillers
    lines = [
        '<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>',
        "<!DOCTYPE boost_serialization>",
        '<boost_serialization signature="serialization::archive" version="4">',
        '<DB class_id="0" tracking_level="1" version="0" object_id="_0">',
        f"<distLSB_>{text(found.tick_m, METRES_PER_CENTIMETRE)}</distLSB_>",
        '<position_ class_id="1" tracking_level="0" version="0">',
        *_items("xyz", [0, 0, 0]),
        "</position_>",
        '<orientation_ class_id="2" tracking_level="0" version="0">',
        *_items("rpy", [0, 0, 0]),
        "</orientation_>",
        *_colors(len(rows)),
        *_items("enabled_", enabled),
        *_items("intensity_", enabled),
    ]
    for name, tag in INTENSITIES.items():
        lines += _items(tag, (text(row[name]) for row in rows), item_version=0)
    lines += [
        '<points_ class_id="7" tracking_level="0" version="0">',
        f"<count>{len(rows)}</count>",
        "<item_version>1</item_version>",
    ]
    for laser, row in enumerate(rows):
        lines += _item(laser, row)
    lines += ["</points_>", "</DB>", "</boost_serialization>", ""]
    if found.dialect is not None:
        rate = "" if found.rotation_rate_hz is None else f" at {found.rotation_rate_hz!r} Hz"
        lines.insert(-1, f"<!-- velocal: for the point formula of {found.dialect}{rate} -->")
    storage.write_text(path, "\n".join(lines))


def _items(tag: str, items: Iterable[object], item_version: int | None = None) -> list[str]:
    rows = [f"<item>{item}</item>" for item in items]
    version = [] if item_version is None else [f"<item_version>{item_version}</item_version>"]
    return [f"<{tag}>", f"<count>{len(rows)}</count>", *version, *rows, f"</{tag}>"]


def _colors(n_items: int) -> list[str]:
    """Colours in which the manufacturer's viewer paints the lasers: white."""
    first = '<item class_id="4" tracking_level="0" version="0">'
    lines = ['<colors_ class_id="3" tracking_level="0" version="0">']
    lines += [f"<count>{n_items}</count>", "<item_version>0</item_version>"]
    for index in range(n_items):
        lines += ["<item>" if index else first, *_items("rgb", [1, 1, 1]), "</item>"]
    return [*lines, "</colors_>"]


def _item(laser: int, row: lasers.Values) -> list[str]:
    # Boost describes a class where it occurs first and refers to that afterwards.
    item = "" if laser else ' class_id="8" tracking_level="0" version="1"'
    px = 'class_id_reference="9"' if laser else 'class_id="9" tracking_level="1" version="1"'
    return [
        f"<item{item}>",
        f'<px {px} object_id="_{laser + 1}">',
        f"<id_>{laser}</id_>",
        *(f"<{tag}>{text(row[name], unit)}</{tag}>" for name, (tag, unit) in TAGS.items()),
        "</px>",
        "</item>",
    ]
