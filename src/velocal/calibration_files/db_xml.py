"""Velodyne's `db.xml`, an archive of boost_serialization, in degrees and centimetres.

The lists of the file have 64 items for scanners of 16 and 32 lasers too; `enabled_` tells which
lasers exist, the others are filled with zeros.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from velocal import storage
from velocal.calibration_files import lasers
from velocal.calibration_files.decimals import (
    METRES_PER_CENTIMETRE,
    RADIANS_PER_DEGREE,
    UNCHANGED,
    number,
    text,
)
from velocal.errors import CalibrationFileError
from velocal.parameters import ParameterSet
from velocal.sensors import DISTANCE_TICK_M

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

#: Tags of one laser in the order of the archive, which boost relies on.
TAGS: lasers.Keys = {
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
#: Known misspellings of tags (VLS-128 files).
MISSPELT = {"horizOffsetCorection_": "horizOffsetCorrection_"}
#: Lists are never shorter.
N_ITEMS = 64


def read(path: Path, n_lasers: int) -> ParameterSet:
    """Read a calibration.

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
    database = _database(path)
    tick_cm = database.findtext("distLSB_")
    if tick_cm is not None:
        tick_m = number(tick_cm, "distLSB_", str(path), METRES_PER_CENTIMETRE)
        lasers.check_tick(tick_m, "distLSB_", path)
    return lasers.parameter_set(path, _lasers(database, path, n_lasers), n_lasers)


def _database(path: Path) -> Element:
    data = lasers.content(path)
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


def _lasers(database: Element, path: Path, n_lasers: int) -> Iterator[tuple[int, dict[str, float]]]:
    enabled = _list(database, "enabled_", path)
    intensities = {name: _list(database, tag, path) for name, tag in INTENSITIES.items()}
    for index, px in enumerate(database.iterfind("points_/item/px")):
        found = {MISSPELT.get(child.tag, child.tag): child.text for child in px}
        laser = lasers.laser_id(found.get("id_"), "id_", f"{path}, item {index}")
        values = lasers.values(found, TAGS, f"{path}, laser {laser}")
        if laser < len(enabled):
            filler = not enabled[laser]
        else:  # without the list, fillers are known by their place and by being zero throughout
            filler = laser >= n_lasers and not any(values.values())
        if not filler:
            for name, items in intensities.items():
                if laser < len(items):
                    values[name] = items[laser]
            yield laser, values


def _list(database: Element, tag: str, path: Path) -> list[float]:
    """Read a list of numbers by laser id; empty if the file has none."""
    return [number(item.text, tag, str(path)) for item in database.iterfind(f"{tag}/item")]


def write(path: Path, parameters: ParameterSet) -> None:
    """Write a calibration in the structure of the manufacturer's files.

    The numbers are the shortest that `read` turns into the same floats. Values that the set does
    not carry are written such that they have no effect (see `lasers.neutral`).

    Raises
    ------
    CalibrationFileError
        If a value is not finite.
    """
    rows = [lasers.neutral(row) for row in lasers.rows(path, parameters)]
    n_fillers = max(0, N_ITEMS - len(rows))
    rows += [lasers.neutral({"dl": 0.0, "alpha": 0.0, "v": 0.0})] * n_fillers
    enabled = [1] * len(parameters) + [0] * n_fillers
    lines = [
        '<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>',
        "<!DOCTYPE boost_serialization>",
        '<boost_serialization signature="serialization::archive" version="4">',
        '<DB class_id="0" tracking_level="1" version="0" object_id="_0">',
        f"<distLSB_>{text(DISTANCE_TICK_M, METRES_PER_CENTIMETRE)}</distLSB_>",
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
