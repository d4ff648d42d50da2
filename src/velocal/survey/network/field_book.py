"""Observation files of a survey: points, polar and image observations, base coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from velocal.errors import SurveyError
from velocal.io import storage
from velocal.survey.network.model import ControlPoints, ImageObservations, PolarObservations
from velocal.survey.targets import COORDINATES, DEVIATIONS, Targets

Array = NDArray[np.float64]

POLAR = ("direction_deg", "zenith_deg", "distance_m")
POLAR_DEVIATIONS = ("std_direction_arcsec", "std_zenith_arcsec", "std_distance_mm")
#: Inside units (radians, metres) of a unit of the columns above.
POLAR_UNITS = np.array([np.pi / 180.0, np.pi / 180.0, 1.0])
DEVIATION_UNITS = np.array([np.pi / 648e3, np.pi / 648e3, 1e-3])
IMAGE = ("x_mm", "y_mm", "std_um", "principal_distance_mm")
#: Files of a field book, as the configuration names them. Without images the targets of the planes
#: stand in `network`.
FILES = ("points", "network", "images", "base_sights", "base_readings")


@dataclass(frozen=True)
class FieldBook:
    """What was observed.

    Attributes
    ----------
    control : ControlPoints
        Control points with approximate coordinates; they define the datum.
    planes : dict of str to str
        Plane of every target on walls and floor.
    polar : PolarObservations
        Of the control points, and of other points that were observed with them.
    images : ImageObservations
        Without rows if no images were taken.
    base_polar : dict of str to PolarObservations
        By position: observations of control points and of the targets of the scanner's base.
    base_coordinates : dict of str to Targets
        By scanner: repeated coordinates of the targets of its base in the scanner frame. A target
        has several rows, with the stated standard deviation of a single measurement.
    """

    control: ControlPoints
    planes: dict[str, str]
    polar: PolarObservations
    images: ImageObservations = field(default_factory=lambda: ImageObservations.joined([]))
    base_polar: dict[str, PolarObservations] = field(default_factory=dict)
    base_coordinates: dict[str, Targets] = field(default_factory=dict)


def read_field_book(paths: Mapping[str, Path]) -> FieldBook:
    """Read the observation files of a survey.

    Parameters
    ----------
    paths : mapping of str to Path
        `FILES`; ``images`` may be missing. Columns and units: ``config/README.md``.

    Raises
    ------
    SurveyError
        If a file is missing, a column is missing or unknown, a value is no number, a standard
        deviation is missing or not positive, or a point is named twice.
    """
    where = str(paths["points"])
    points = _table(paths["points"], ("target", "plane"), COORDINATES)
    twice = points["target"].duplicated()
    if twice.any():
        row = int(np.flatnonzero(twice)[0])
        raise SurveyError(
            f"point {points['target'][row]!r} occurs twice", where=f"{where}, row {row + 2}"
        )
    xyz = points[list(COORDINATES)].to_numpy(dtype=float)
    known = np.isfinite(xyz).all(axis=1)
    if known.sum() < 3:
        raise SurveyError(
            f"{known.sum()} points with approximate coordinates",
            where=where,
            allowed="3 or more control points",
            hint="Their approximate coordinates define the site frame.",
        )
    on_plane = (points["plane"] != "").to_numpy()
    base_polar = _table(
        paths["base_sights"], ("position", "station", "target"), (*POLAR, *POLAR_DEVIATIONS)
    )
    base = _table(paths["base_readings"], ("scanner", "target"), (*COORDINATES, *DEVIATIONS))
    _check_values(base, COORDINATES, DEVIATIONS, str(paths["base_readings"]))
    polar = _table(paths["network"], ("station", "target"), (*POLAR, *POLAR_DEVIATIONS))
    return FieldBook(
        control=ControlPoints(tuple(points["target"][known]), xyz[known]),
        planes=dict(zip(points["target"][on_plane], points["plane"][on_plane], strict=True)),
        polar=_polar(polar, str(paths["network"])),
        images=(_images(paths["images"]) if paths.get("images") else ImageObservations.joined([])),
        base_polar={
            str(name): _polar(part, str(paths["base_sights"]))
            for name, part in base_polar.groupby("position", sort=False)
        },
        base_coordinates={
            str(name): Targets(
                tuple(part["target"]),
                tuple(part["scanner"]),
                part[list(COORDINATES)].to_numpy(dtype=float),
                part[list(DEVIATIONS)].to_numpy(dtype=float) * 1e-3,
            )
            for name, part in base.groupby("scanner", sort=False)
        },
    )


def write_field_book(
    book: FieldBook, paths: Mapping[str, Path], principal_distance_mm: float
) -> None:
    """Write the observation files: angles to 1e-6 deg, lengths to 0.01 mm, images to 10 nm.

    Parameters
    ----------
    book : FieldBook
    paths : mapping of str to Path
        `FILES`.
    principal_distance_mm : float
        Of the camera that took all images.
    """
    names = list(dict.fromkeys((*book.control.name, *book.planes)))
    xyz = dict(zip(book.control.name, (np.round(book.control.xyz, 5) + 0.0).tolist(), strict=True))
    table: dict[str, Sequence[object]] = {
        "target": names,
        "plane": [book.planes.get(name, "") for name in names],
    }
    for axis, column in enumerate(COORDINATES):
        table[column] = [xyz[name][axis] if name in xyz else np.nan for name in names]
    storage.write_csv(paths["points"], pd.DataFrame(table))
    storage.write_csv(paths["network"], _polar_table(book.polar))
    parts = [
        _polar_table(part).assign(position=name)[
            ["position", "station", "target", *POLAR, *POLAR_DEVIATIONS]
        ]
        for name, part in book.base_polar.items()
    ]
    storage.write_csv(paths["base_sights"], pd.concat(parts, ignore_index=True))
    value = book.images.value * principal_distance_mm
    images = {
        "image": book.images.setup,
        "target": book.images.target,
        "x_mm": np.round(value[:, 0], 5),
        "y_mm": np.round(value[:, 1], 5),
        "std_um": np.round(book.images.std[:, 0] * principal_distance_mm * 1e3, 3),
        "principal_distance_mm": np.full(len(value), principal_distance_mm),
    }
    storage.write_csv(paths["images"], pd.DataFrame(images))
    coordinates = [
        pd.DataFrame(
            {
                "scanner": part.group,
                "target": part.name,
                **{c: np.round(part.xyz[:, i], 5) for i, c in enumerate(COORDINATES)},
                **{c: np.round(part.std[:, i] * 1e3, 3) for i, c in enumerate(DEVIATIONS)},
            }
        )
        for part in book.base_coordinates.values()
    ]
    storage.write_csv(paths["base_readings"], pd.concat(coordinates, ignore_index=True))


def _polar_table(polar: PolarObservations) -> pd.DataFrame:
    value, std = polar.value / POLAR_UNITS, polar.std / DEVIATION_UNITS
    value[:, 0] = np.mod(value[:, 0], 360.0)
    return pd.DataFrame(
        {
            "station": polar.setup,
            "target": polar.target,
            **{c: np.round(value[:, i], 6 if i < 2 else 5) for i, c in enumerate(POLAR)},
            **{c: np.round(std[:, i], 3) for i, c in enumerate(POLAR_DEVIATIONS)},
        }
    )


def _table(path: Path, names: Sequence[str], numbers: Sequence[str]) -> pd.DataFrame:
    where, columns = str(path), [*names, *numbers]
    try:
        table = pd.read_csv(path, comment="#", dtype=str, keep_default_na=False)
    except (OSError, ValueError) as error:
        raise SurveyError(f"cannot be read: {error}", where=where) from None
    if set(table.columns) != set(columns):
        odd = sorted(set(table.columns) ^ set(columns))
        raise SurveyError(
            f"missing or unknown column {odd[0]!r}", where=where, allowed=", ".join(columns)
        )
    for column in numbers:
        text = table[column].str.strip()
        table[column] = pd.to_numeric(text.where(text != ""), errors="coerce")
        bad = np.flatnonzero((text != "").to_numpy() & ~np.isfinite(table[column].to_numpy()))
        if len(bad):
            raise SurveyError(
                f"{column} is no number: {text[bad[0]]!r}", where=f"{where}, row {bad[0] + 2}"
            )
    return table


def _check_values(
    table: pd.DataFrame, values: Sequence[str], deviations: Sequence[str], where: str
) -> None:
    """Check that every value has a positive standard deviation, and is there (unless polar)."""
    for value, deviation in zip(values, deviations, strict=True):
        there = np.isfinite(table[value].to_numpy(dtype=float))
        good = table[deviation].to_numpy(dtype=float) > 0.0
        if values is not POLAR and not there.all():
            row = int(np.flatnonzero(~there)[0])
            raise SurveyError(f"{value} is missing", where=f"{where}, row {row + 2}")
        if (there & ~good).any():
            row = int(np.flatnonzero(there & ~good)[0])
            raise SurveyError(
                f"{deviation} is missing or not positive",
                where=f"{where}, row {row + 2}",
                hint="State how good each observation is.",
            )


def _polar(table: pd.DataFrame, where: str) -> PolarObservations:
    _check_values(table, POLAR, POLAR_DEVIATIONS, where)
    return PolarObservations(
        tuple(table["station"]),
        tuple(table["target"]),
        table[list(POLAR)].to_numpy(dtype=float) * POLAR_UNITS,
        table[list(POLAR_DEVIATIONS)].to_numpy(dtype=float) * DEVIATION_UNITS,
    )


def _images(path: Path) -> ImageObservations:
    table = _table(path, ("image", "target"), IMAGE)
    _check_values(table, IMAGE[:2], ("std_um", "std_um"), str(path))
    _check_values(table, ("std_um",), ("principal_distance_mm",), str(path))
    distance = table["principal_distance_mm"].to_numpy(dtype=float)[:, None]
    std = table[["std_um", "std_um"]].to_numpy(dtype=float) * 1e-3 / distance
    return ImageObservations(
        tuple(table["image"]),
        tuple(table["target"]),
        table[["x_mm", "y_mm"]].to_numpy(dtype=float) / distance,
        std,
    )
