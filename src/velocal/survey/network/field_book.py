"""Observation files of a survey: points, polar and image observations, base coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from velocal.errors import SurveyError
from velocal.io import storage
from velocal.survey.network.model import ControlPoints, ImageObservations, PolarObservations
from velocal.survey.tables import Table, check_unique, read_table
from velocal.survey.targets import COORDINATES, DEVIATIONS, Targets, read_targets, target_table

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
    points = read_table(
        paths["points"], ("target", "plane"), COORDINATES, {}, may_be_empty=("plane",)
    )
    check_unique(points, ("target",), "point", where)
    xyz = points.numbers(COORDINATES)
    known = np.asarray(np.isfinite(xyz).all(axis=1))
    if known.sum() < 3:
        raise SurveyError(
            f"{known.sum()} points with approximate coordinates",
            where=where,
            allowed="3 or more control points",
            hint="Their approximate coordinates define the site frame.",
        )
    base_polar = _polar_rows(paths["base_sights"], "position", "station", "target")
    base = read_targets(paths["base_readings"], "scanner", repeated=True)
    return FieldBook(
        control=ControlPoints(points.take(known).text("target"), xyz[known]),
        planes={
            target: plane
            for target, plane in zip(points.text("target"), points.text("plane"), strict=True)
            if plane
        },
        polar=_polar(_polar_rows(paths["network"], "station", "target")),
        images=_images(paths["images"]) if paths.get("images") else ImageObservations.joined([]),
        base_polar={
            name: _polar(base_polar.take(base_polar.columns["position"] == name))
            for name in dict.fromkeys(base_polar.text("position"))
        },
        base_coordinates={
            name: base.of(name, where=str(paths["base_readings"]))
            for name in dict.fromkeys(base.group)
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
    storage.write_csv(paths["points"], table)
    storage.write_csv(paths["network"], _polar_table(book.polar))
    columns = {"position": [n for n, part in book.base_polar.items() for _ in part.target]}
    together = PolarObservations.joined(list(book.base_polar.values()))
    storage.write_csv(paths["base_sights"], columns | _polar_table(together))
    value = book.images.value * principal_distance_mm
    images = {
        "image": list(book.images.setup),
        "target": list(book.images.target),
        "x_mm": np.round(value[:, 0], 5),
        "y_mm": np.round(value[:, 1], 5),
        "std_um": np.round(book.images.std[:, 0] * principal_distance_mm * 1e3, 3),
        "principal_distance_mm": np.full(len(value), principal_distance_mm),
    }
    storage.write_csv(paths["images"], images)
    base = target_table("scanner", list(book.base_coordinates.values()))
    first = ("scanner", "target", *COORDINATES, *DEVIATIONS)
    storage.write_csv(paths["base_readings"], {name: base[name] for name in first})


def _polar_table(polar: PolarObservations) -> dict[str, Any]:
    """Columns of observations, by name."""
    value, std = polar.value / POLAR_UNITS, polar.std / DEVIATION_UNITS
    value[:, 0] = np.mod(value[:, 0], 360.0)
    return {
        "station": list(polar.setup),
        "target": list(polar.target),
        **{c: np.round(value[:, i], 6 if i < 2 else 5) for i, c in enumerate(POLAR)},
        **{c: np.round(std[:, i], 3) for i, c in enumerate(POLAR_DEVIATIONS)},
    }


def _polar_rows(path: Path, *names: str) -> Table:
    positive = dict(zip(POLAR, POLAR_DEVIATIONS, strict=True))
    return read_table(path, names, (*POLAR, *POLAR_DEVIATIONS), positive, gaps=True)


def _polar(table: Table) -> PolarObservations:
    return PolarObservations(
        table.text("station"),
        table.text("target"),
        table.numbers(POLAR) * POLAR_UNITS,
        table.numbers(POLAR_DEVIATIONS) * DEVIATION_UNITS,
    )


def _images(path: Path) -> ImageObservations:
    positive = {"x_mm": "std_um", "y_mm": "std_um", "std_um": "principal_distance_mm"}
    table = read_table(path, ("image", "target"), IMAGE, positive)
    distance = table.numbers(("principal_distance_mm",))
    return ImageObservations(
        table.text("image"),
        table.text("target"),
        table.numbers(("x_mm", "y_mm")) / distance,
        table.numbers(("std_um", "std_um")) * 1e-3 / distance,
    )
