"""What the configuration says of validation and of the files for drivers."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from velocal.calibration.dialects import DIALECTS
from velocal.study.model import (
    Count,
    Positive,
    Section,
    enum,
    known_as,
)

_PROGRAMS = [name for name in DIALECTS if name != "paper"]


#: Program for which a file is always written beside those of `Export`: it reads near-point
#: corrections up to the far point, and accepts the YAML of ROS with other points.
DECODER = "velodyne_decoder"

Program = Annotated[str, known_as("program", _PROGRAMS), enum(_PROGRAMS)]


class Export(Section):
    """Programs that the files of the parameter sets are written for."""

    yaml: Program = Field(
        default="ros",
        description="program that reads the `.yaml` files; `docs/dialects.md` lists them",
    )
    xml: Program = Field(default="veloview", description="program that reads the `.xml` files")
    distance: Literal["safe", "single"] = Field(
        default="safe",
        description="what the files of `calibrations` hold for a scanner with a two-point file if "
        "the program cannot fade a correction to that of the factory at long range: `safe` leaves "
        "the distance corrections of the factory, `single` gives those that are right at the "
        "ranges of the calibration and wrong at long range",
    )


class Validation(Section):
    """Residuals of single rotations."""

    sigma_cm: Positive | None = Field(
        default=None,
        description="standard deviation of a distance in the datasheet; that of each scanner if "
        "left out",
    )
    rotations: Count = Field(
        description="single rotations that are used for each window: the nearest ones that belong "
        "to no window, or its own if there are too few"
    )
