"""Faults of calibration files that reading stops at, or that no reader notices."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.calibration.dialects import DIALECTS
from velocal.calibration.files import document as lasers
from velocal.calibration.files.decimals import UNCHANGED
from velocal.calibration.files.document import Document
from velocal.calibration.files.formats import format_of, read_calibration
from velocal.calibration.fit import FIT_RAD, closest, fitting, is_like, misfit_rad
from velocal.errors import CalibrationFileError
from velocal.scanner.models import SCANNERS, Scanner
from velocal.scanner.parameters import NEAR_POINT, PARAMETERS, TWO_POINT

#: Ticks of the raw distance that scanners have, metres.
TICKS_M = sorted({scanner.distance_tick_m for scanner in SCANNERS.values()})
#: Scanners of that many lasers exist, known here or not.
COUNTS = (16, 32, 64, 128)
#: Of the HDL-64E, whose units differ: no unit known is further from nominal.
_VERTICAL_RAD, _ROTATIONAL_RAD = np.deg2rad(3.0), np.deg2rad(4.0)


@dataclass(frozen=True)
class Finding:
    """A probable fault of a file.

    Attributes
    ----------
    code : str
        What kind, for programs.
    text : str
        What, where, and in comparison with what.
    """

    code: str
    text: str


#: Values of every laser by our names; NaN where absent or no finite number.
Columns = dict[str, Array]


def lint(path: str | Path, scanner: Scanner | None = None) -> list[Finding]:
    """Look for faults in a calibration file of any format.

    Parameters
    ----------
    path : str or Path
    scanner : Scanner, optional
        What the file is for; found by the vertical angles if left out.

    Returns
    -------
    list of Finding
        Empty if no fault is found.

    Examples
    --------
    >>> [finding.code for finding in velocal.lint("missing.yaml")]
    ['unreadable']
    """
    path = Path(path)
    try:
        document = format_of(path).codec().parse(path)
    except CalibrationFileError as error:
        return [Finding("unreadable", error.what)]
    found = [*_document(document, scanner)]
    ids, columns, faults = _columns(document)
    found += faults
    found += _ids(ids, scanner)
    if len(ids):
        if scanner is None:
            scanner = closest(_by_laser(ids, columns["v"]))
        for check in CHECKS:
            found += check(document, ids, columns, scanner)
    if not found:
        try:
            read_calibration(path, scanner=scanner.name if scanner else None)
        except CalibrationFileError as error:  # what reading checks and nothing above does
            found.append(Finding("unreadable", error.what))
    return found


def _document(document: Document, scanner: Scanner | None) -> Iterator[Finding]:
    try:
        tick = lasers.tick_m(document)
        ticks = TICKS_M if scanner is None else sorted({*TICKS_M, scanner.distance_tick_m})
        if not np.isclose(tick, ticks, rtol=1e-6).any():
            known = " or ".join(f"{each:g}" for each in ticks)
            yield Finding("tick", f"the distance tick is {tick:g} m; {known} are known")
    except CalibrationFileError as error:
        yield Finding("tick", f"{error.what}; 0.002 m, or 0.004 m for a VLP-32C or VLS-128")
    if document.dialect is not None and document.dialect not in DIALECTS:
        yield Finding("dialect", f"unknown dialect {document.dialect!r}")
    if document.disabled:
        yield Finding(
            "disabled",
            f"laser {_listed(list(document.disabled))}: turned off by enabled_, but with values, "
            "which programs leave out",
        )
    if document.stated is not None and document.stated != len(document.lasers):
        yield Finding(
            "count", f"num_lasers is {document.stated}, but there are {len(document.lasers)}"
        )
    if len(set(document.listed.values())) > 1:
        sizes = ", ".join(f"{tag} {size}" for tag, size in document.listed.items())
        yield Finding("lists", f"lists beside the lasers differ in length: {sizes}")


def _columns(document: Document) -> tuple[list[int], Columns, list[Finding]]:
    """Ids and values, as far as they are numbers, in the order of the file."""
    ids, faults = [], []
    columns: Columns = {name: np.full(len(document.lasers), np.nan) for name in document.keys}
    for index, (place, entry) in enumerate(document.lasers):
        try:
            ids.append(lasers.laser_id(entry.get(document.id_key), document.id_key, place))
        except CalibrationFileError as error:
            faults.append(Finding("id", f"{place}: {error.what}"))
            ids.append(-1 - index)
        for name in document.keys:
            where = f"laser {ids[-1]}" if ids[-1] >= 0 else place
            try:
                value = lasers.value(document, name, entry, where)
            except CalibrationFileError as error:
                code = "missing-value" if entry.get(document.keys[name][0]) is None else "number"
                faults.append(Finding(code, f"{where}: {error.what}"))
                continue
            columns[name][index] = np.nan if value is None else value
    if np.isnan(columns["dl"]).all() and "dl" not in document.required:
        columns["dl"][:] = 0.0
    return ids, columns, faults


def _ids(ids: list[int], scanner: Scanner | None) -> Iterator[Finding]:
    if not ids:
        yield Finding("no-lasers", "holds no lasers")
        return
    counts = Counter(laser for laser in ids if laser >= 0)
    for laser, count in counts.items():
        if count > 1:
            yield Finding("doubled", f"laser {laser} occurs {count} times")
    n = scanner.n_lasers if scanner else min((c for c in COUNTS if c >= len(counts)), default=128)
    if missing := sorted(set(range(n)) - set(counts)):
        yield Finding("missing-laser", f"of {n} lasers are missing: {_listed(missing)}")
    if unknown := sorted(set(counts) - set(range(n))):
        whose = f"the {scanner.name} has {n}" if scanner else f"ids end at {n - 1}"
        hint = "; do they count from 1?" if 0 not in counts else ""
        yield Finding("unknown-laser", f"laser {_listed(unknown)}: {whose}{hint}")


def _listed(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers[:8])) + (" ..." if len(numbers) > 8 else "")


def _by_laser(ids: list[int], values: Array) -> Array:
    return values[np.argsort(ids, kind="stable")]


def _of(ids: list[int], where: NDArray[np.bool_]) -> str:
    return f"laser {_listed([ids[k] for k in np.flatnonzero(where)])}"


def _units(
    document: Document, ids: list[int], columns: Columns, scanner: Scanner | None
) -> Iterator[Finding]:
    size = {name: np.nan_to_num(np.abs(columns[name])) for name in columns}
    in_degrees = document.angle_hint is None  # what files in degrees have nothing to say of
    for name in ("v", "alpha"):
        key = document.keys[name][0]
        if (big := size[name] > (np.pi / 2 if name == "v" else 0.5)).any():
            what = "an impossible angle" if in_degrees else "degrees for radians"
            yield Finding("angle", f"{key} of {_of(ids, big)}: {what}")
    known = columns["v"][np.isfinite(columns["v"])]
    if len(known) > 8 and 0.0 < (spread := np.ptp(known)) < np.deg2rad(2.0):
        yield Finding("angle", f"{document.keys['v'][0]} spans {spread:.2g} rad: wrong unit")
    turned = scanner is not None and bool(scanner.rotational_rad.any())
    if turned and 0.0 < size["alpha"].max() < np.deg2rad(0.5):
        yield Finding("angle", f"{document.keys['alpha'][0]} is within 0.5 deg: wrong unit")
    design = _design_m(scanner) if scanner and scanner.n_lasers == len(ids) else {}
    heights_m = min(1.0, 10.0 * design.get("voff", 1.0))
    limits = {"dl": 10.0, "voff": heights_m, "hoff": 0.5, "focal_distance": 100.0}
    for name, limit in (limits | dict.fromkeys(NEAR_POINT, 10.0)).items():
        if (big := size[name] > limit).any():
            key, unit = document.keys[name]
            larger = (
                "centimetres for metres" if unit == UNCHANGED else "millimetres for centimetres"
            )
            yield Finding("length", f"{key} of {_of(ids, big)} is beyond {limit:g} m: {larger}")
    for name, usual in design.items():
        largest, limit = size[name].max(), usual / 25.0
        if 0.0 < largest < limit:
            key = document.keys[name][0]
            yield Finding("length", f"{key} is within {limit:.2g} m: wrong unit?")


def _design_m(scanner: Scanner) -> dict[str, float]:
    """Largest length of every kind by which a wrong unit shows, where the scanner has any."""
    sizes = {
        "dl": 1.25 if scanner.has_factory_file else 0.0,
        "voff": float(np.abs(scanner.vertical_offset_m).max()),
        "hoff": float(np.abs(scanner.horizontal_offset_m).max()),
    }
    return {name: size for name, size in sizes.items() if size}


def _distances(
    document: Document, ids: list[int], columns: Columns, scanner: Scanner | None
) -> Iterator[Finding]:
    dl = columns["dl"]
    outlying = (
        np.abs(dl - np.median(dl[np.isfinite(dl)])) > 0.6 if np.isfinite(dl).any() else dl > 0
    )
    if outlying.any() and not (np.abs(dl) > 10.0).any():
        yield Finding(
            "distance", f"distance correction of {_of(ids, outlying)} is unlike the others"
        )
    if ((zero := dl == 0).any()) and not zero.all():
        yield Finding("distance", f"distance correction of {_of(ids, zero)} is zero")
    x, y = (columns[name] for name in NEAR_POINT)
    flag = columns[TWO_POINT] != 0 if TWO_POINT in columns else np.ones(len(ids), dtype=bool)
    nothing = flag & (x == 0) & (y == 0) & (dl != 0)
    if nothing.any():
        yield Finding(
            "two-point",
            f"near-point corrections of {_of(ids, nothing)} are zero, but enabled: "
            "programs interpolate from the distance correction to zero",
        )
    for name, near in zip(NEAR_POINT, (x, y), strict=True):
        far = flag & ~nothing & (np.abs(near - dl) > 0.25) & (np.abs(near) <= 10.0)
        if far.any():
            key = document.keys[name][0]
            yield Finding("two-point", f"{key} of {_of(ids, far)} is far from the far point's")


def _nominal(
    document: Document, ids: list[int], columns: Columns, scanner: Scanner | None
) -> Iterator[Finding]:
    """Signs and order, by the nominal values of the scanner."""
    if scanner is None or set(ids) != set(range(scanner.n_lasers)):
        return
    at = np.array(ids)
    if not is_like(columns["v"], scanner):
        other = next(fitting(_by_laser(ids, columns["v"])), None)
        key = document.keys["v"][0]
        if other is not None:
            yield Finding(
                "scanner", f"{key} has the angles of the {other.name}, not of the {scanner.name}"
            )
        return  # another model, or a fault of units
    parts = {
        "v": (scanner.vertical_rad[at], _VERTICAL_RAD),
        "alpha": (scanner.rotational_rad[at], _ROTATIONAL_RAD),
        "hoff": (scanner.horizontal_offset_m[at], 0.02),
        "voff": (scanner.vertical_offset_m[at], 0.15),
    }
    for name, (nominal, limit) in parts.items():
        values = columns[name]
        if not np.isfinite(values).any() or not np.nan_to_num(values).any() or not nominal.any():
            continue
        key, away = document.keys[name][0], np.abs(values - nominal) > limit
        if np.nanmax(np.abs(values)) > 1.6:
            continue  # the unit is wrong, which is said already
        mirrored = away & (np.abs(values + nominal) <= limit)
        if mirrored.sum() > len(ids) / 2:
            yield Finding("sign", f"{key} has the wrong sign throughout")
        elif mirrored.any():
            yield Finding("sign", f"{key} of {_of(ids, mirrored)} has the wrong sign")
        elif name == "v" and away.sum() > len(ids) / 4:
            yield Finding("order", f"{key} is not in the order of the {scanner.name}")
        elif name in ("v", "alpha") and away.any():
            yield Finding("value", f"{key} of {_of(ids, away)} is far from the nominal value")


def _offsets(
    document: Document, ids: list[int], columns: Columns, scanner: Scanner | None
) -> Iterator[Finding]:
    """Vertical offsets that converters and old files leave out."""
    if scanner is None or np.nan_to_num(columns["voff"]).any():
        return
    if misfit_rad(_by_laser(ids, columns["v"]), scanner) <= FIT_RAD:
        nominal = 1e3 * scanner.vertical_offset_m
        yield Finding(
            "offsets",
            f"{document.keys['voff'][0]} is zero for every laser; the {scanner.name} has "
            f"offsets from {nominal.min():.1f} to {nominal.max():.1f} mm",
        )


def _twins(
    document: Document, ids: list[int], columns: Columns, scanner: Scanner | None
) -> Iterator[Finding]:
    first: dict[tuple[float, ...], int] = {}
    for index, laser in enumerate(ids):
        row = tuple(float(columns[name][index]) for name in PARAMETERS[:3])
        if row in first and laser != first[row]:
            yield Finding("twins", f"lasers {first[row]} and {laser} have the same values")
        first.setdefault(row, laser)


def _intensities(
    document: Document, ids: list[int], columns: Columns, scanner: Scanner | None
) -> Iterator[Finding]:
    low, high = columns["min_intensity"], columns["max_intensity"]
    for name, values in (("min_intensity", low), ("max_intensity", high)):
        absent = np.isnan(values)
        stated = [entry.get(document.keys[name][0]) for _, entry in document.lasers]
        if absent.any() and not absent.all() and None in stated:
            yield Finding(
                "intensity",
                f"{document.keys[name][0]} is given for {int((~absent).sum())} of {len(ids)} "
                "lasers: converters that leave out defaults have moved values to other lasers",
            )
        if (wild := (values < 0) | (values > 255)).any():
            yield Finding("intensity", f"{name} of {_of(ids, wild)} is not within 0 to 255")
    if (swapped := low > high).any():
        yield Finding("intensity", f"least above largest intensity of {_of(ids, swapped)}")


def _partly(
    document: Document, ids: list[int], columns: Columns, scanner: Scanner | None
) -> Iterator[Finding]:
    for name in ("dl", "voff", "hoff", *NEAR_POINT):
        key = document.keys[name][0]
        given = np.array([entry.get(key) is not None for _, entry in document.lasers])
        if given.any() and not given.all():
            yield Finding("missing-value", f"{key} of {_of(ids, ~given)} is missing")


Check = Callable[[Document, list[int], Columns, Scanner | None], Iterator[Finding]]
CHECKS: tuple[Check, ...] = (
    _units, _distances, _nominal, _offsets, _twins, _intensities, _partly,
)  # fmt: skip
