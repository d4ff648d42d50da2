"""A sketch of a site that is to be surveyed: walls, floor, stations, accuracy of the survey.

Coordinates are those of the site frame: X and Y level, Z up. `velocal plan` reads it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from velocal.errors import ConfigError
from velocal.io import yaml_text
from velocal.study.model import (
    Name,
    Placeholder,
    ScannerName,
    Section,
    Text,
    fault,
    validated,
)

PlaneName = Annotated[Name, Placeholder("{plane}")]
StationName = Annotated[Name, Placeholder("{station}")]
#: Coordinates of a sketch need no origin far away, and nothing is smaller than its targets.
Coordinate = Annotated[float, Field(ge=-1e4, le=1e4)]
LEAST_M = 0.1
#: Corners of a surface lie as far as this beside its plane.
UNEVEN_M = 0.05
_Level = Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]
_Point = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]
Angle = Annotated[float, Field(ge=-360, le=360)]
#: Standard deviation in millimetres, centimetres or degrees.
Size = Annotated[float, Field(ge=1e-3, le=1e3)]


def _plane(corners: tuple[_Point, ...]) -> tuple[_Point, ...]:
    """Refuse corners that lie on a line, or not in one plane."""
    first, *others = corners
    sides = [tuple(b - a for a, b in zip(first, other, strict=True)) for other in others]
    longest = max(sides, key=lambda side: math.hypot(*side))
    area, normal = max((math.hypot(*found), found) for found in (_cross(longest, s) for s in sides))
    if area < LEAST_M**2:
        raise fault("the corners lie on one line", hint="Give corners that span a surface.")
    away = max(abs(sum(a * n for a, n in zip(side, normal, strict=True))) for side in sides) / area
    if away > UNEVEN_M:
        raise fault(
            f"a corner lies {away:.2f} m beside the plane of the others",
            allowed=[f"{UNEVEN_M:g} m at most"],
            hint="Give X, Y and Z of the corners of one flat surface.",
        )
    return corners


def _cross(first: tuple[float, ...], second: tuple[float, ...]) -> tuple[float, float, float]:
    (a, b, c), (p, q, r) = first, second
    return b * r - c * q, c * p - a * r, a * q - b * p


class Wall(Section):
    """An upright wall."""

    from_m: _Level = Field(description="X and Y of one end")
    to_m: _Level = Field(description="X and Y of the other end")
    bottom_m: Coordinate = Field(default=0.0, description="height of its lower edge")
    top_m: Coordinate = Field(description="height of its upper edge")

    @model_validator(mode="after")
    def _has_an_area(self) -> Wall:
        if self.top_m < self.bottom_m + LEAST_M:
            least = f"{self.bottom_m + LEAST_M:g} or more"
            raise fault(f"{self.top_m:g}", key="top_m", allowed=[least])
        if math.dist(self.from_m, self.to_m) < LEAST_M:
            raise fault(f"the wall is shorter than {LEAST_M:g} m", key="to_m")
        return self


class Surface(Section):
    """Any plane surface, as a floor or a board that leans."""

    corners_m: Annotated[
        tuple[_Point, ...], Field(strict=False, min_length=3), AfterValidator(_plane)
    ] = Field(description="X, Y and Z of its corners in order")


class SketchedSurvey(Section):
    """How many targets there will be, and how well they will be measured."""

    targets: int = Field(default=12, ge=4, le=1000, description="targets on every surface")
    targets_mm: Size = Field(
        default=1.0, description="standard deviation of a coordinate of a target on a surface"
    )
    flatness_mm: Annotated[float, Field(ge=0, le=1000)] = Field(
        default=1.0, description="standard deviation of the surfaces about their planes"
    )
    base_radius_m: Annotated[float, Field(ge=0.01, le=10)] = Field(
        default=0.1, description="distance of the targets on the scanner's base from its middle"
    )
    base_targets: int = Field(default=6, ge=3, le=100, description="their number")
    base_scanner_mm: Size = Field(
        default=0.7, description="standard deviation of their coordinates in the scanner frame"
    )
    base_site_mm: Size = Field(
        default=1.0, description="standard deviation of their coordinates in the site frame"
    )


class Stand(Section):
    """Where the scanner stands."""

    x_m: Coordinate = Field(description="X of the scanner")
    y_m: Coordinate = Field(description="Y of the scanner")
    height_m: Coordinate = Field(
        description="height of the bottom of the scanner in the site frame"
    )
    heading_deg: Angle = Field(
        default=0.0, description="where its Y axis points, clockwise from Y of the site"
    )
    tilt_deg: Annotated[float, Field(ge=0, le=90)] = Field(
        default=0.0, description="angle by which the scanner leans"
    )
    towards_deg: Angle = Field(
        default=0.0, description="where its top leans to, clockwise from Y of the site"
    )


class AssumedSizes(Section):
    """Sizes that the adjustment will find, as standard deviations; those left out are typical."""

    dl_cm: Size | None = Field(default=None, description="of the factory's distances")
    alpha_deg: Size | None = Field(default=None, description="of its rotational angles")
    v_deg: Size | None = Field(default=None, description="of its vertical angles")
    shift_mm: Size | None = Field(
        default=None, description="of the shift of the distances of a laser at a station"
    )
    common_mm: Size | None = Field(
        default=None, description="of the shift of all distances at a station"
    )
    pattern_mm: Size | None = Field(default=None, description="of the pattern along azimuth")
    pattern_deg: Size | None = Field(default=None, description="its length of correlation")
    median_mm: Size | None = Field(default=None, description="of a median without the pattern")


class Candidates(Section):
    """Places of the scanner that are compared."""

    candidates: dict[StationName, Stand] = Field(
        default={}, description="stations that are compared, by name"
    )
    assume: AssumedSizes = Field(
        default=AssumedSizes(), description="sizes that the adjustment will find"
    )
    judge_at_m: Annotated[float, Field(ge=0.1, le=1000)] = Field(
        default=10.0, description="range at which the standard deviation of a point is judged"
    )


class Sketch(Candidates):
    """A site and the stations in it."""

    scanner: ScannerName = Field(description="the scanner")
    calibration: Text | None = Field(
        default=None, description="calibration file of the factory; the design if left out"
    )
    walls: dict[PlaneName, Wall] = Field(default={}, description="upright walls by name")
    surfaces: dict[PlaneName, Surface] = Field(
        default={}, description="floor and other plane surfaces by name"
    )
    survey: SketchedSurvey = Field(default=SketchedSurvey(), description="accuracy of the survey")
    recordings: int = Field(
        default=1, ge=1, le=100, description="recordings at every station; each gives three windows"
    )
    stations: dict[StationName, Stand] = Field(
        default={}, description="stations that will be used, by name"
    )

    @model_validator(mode="after")
    def _names_differ(self) -> Sketch:
        if not self.walls and not self.surfaces:
            raise fault("there is no surface", key="walls", hint="Give walls, surfaces or both.")
        if not self.stations and not self.candidates:
            raise fault(
                "there is no station", key="stations", hint="Give stations, candidates or both."
            )
        for key, first, second in (
            ("surfaces", self.walls, self.surfaces),
            ("candidates", self.stations, self.candidates),
        ):
            if twice := [name for name in second if name in first]:
                raise fault(f"the name {twice[0]!r} occurs twice", key=key)
        return self


def read_sketch(path: Path) -> Sketch:
    """Read the sketch of a site.

    Parameters
    ----------
    path : Path
        YAML.

    Returns
    -------
    Sketch

    Raises
    ------
    ConfigError
        If it is no YAML, a key is missing or unknown, or a value is not possible.
    """
    return validated(Sketch, yaml_text.read_yaml(path, ConfigError), str(path))


def read_candidates(path: Path) -> Candidates:
    """Read the candidates for a study, a YAML file with the keys of `Candidates`.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Candidates

    Raises
    ------
    ConfigError
        As of `read_sketch`.
    """
    return validated(Candidates, yaml_text.read_yaml(path, ConfigError), str(path))


#: What `velocal plan --template` writes: two walls, a floor, two stations to choose from.
TEMPLATE = """\
# A sketch of a site for `velocal plan`. Metres in the site frame: X and Y level, Z up.
scanner: VLP-16
walls:                       # upright walls; only their surveyed part
  long_wall: {from_m: [0.0, 0.0], to_m: [6.0, 0.0], top_m: 2.5}
  short_wall: {from_m: [0.0, 0.0], to_m: [0.0, 4.0], top_m: 2.5}
surfaces:                    # floor, boards: corners in order
  floor: {corners_m: [[0.0, 0.0, 0.0], [6.0, 0.0, 0.0], [6.0, 4.0, 0.0], [0.0, 4.0, 0.0]]}
survey:                      # standard deviations of coordinates, numbers of targets
  targets: 12
  targets_mm: 1.0
  flatness_mm: 1.0
  base_radius_m: 0.1
  base_targets: 6
  base_scanner_mm: 0.7
  base_site_mm: 1.0
recordings: 1                # at every station; each gives three windows
stations:                    # that will be used
  P1: {x_m: 2.0, y_m: 1.9, height_m: 0.8, heading_deg: 35.0}
candidates:                  # that are compared: other places, heights and tilts
  opposite: {x_m: 4.1, y_m: 2.7, height_m: 0.8, heading_deg: -120.0}
  high: {x_m: 2.0, y_m: 1.9, height_m: 1.6, heading_deg: 35.0}
  tilted: {x_m: 4.1, y_m: 2.7, height_m: 0.8, heading_deg: -120.0, tilt_deg: 15.0, towards_deg: 45}
# assume: {pattern_mm: 4.0, median_mm: 5.0}   # sizes that the adjustment will find
judge_at_m: 10.0             # range at which the standard deviation of a point is judged
"""
