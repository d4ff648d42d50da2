"""What the configuration says of the reduction to medians and of their planes."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from velocal.reduction.assignment import Limits
from velocal.scanner.models import AZIMUTH_TICKS, SCANNERS, Scanner
from velocal.study.model import (
    AcuteAngle,
    Count,
    NotNegative,
    Positive,
    ScannerName,
    Section,
    Texts,
    fault,
)


class Reduction(Section):
    """Reduction of returns to medians."""

    min_count: Count = Field(description="returns that an azimuth bin needs to give a median")
    which: Literal["strongest", "last"] = Field(
        default="strongest", alias="return", description="return that is used where a shot has two"
    )
    azimuth_bin_deg: dict[ScannerName, float] = Field(
        default={},
        description="width of an azimuth bin, a multiple of 0.01 that divides 360; the default "
        "depends on the scanner: "
        + ", ".join(
            f"{name} {scanner.azimuth_bin_ticks / 100:g}" for name, scanner in SCANNERS.items()
        ),
    )

    @model_validator(mode="after")
    def _bins_divide_the_turn(self) -> Reduction:
        for scanner, width in self.azimuth_bin_deg.items():
            ticks, usual = round(width * 100), SCANNERS[scanner].azimuth_bin_ticks / 100
            if not 0 < ticks <= 1000 or abs(ticks - width * 100) > 1e-6 or AZIMUTH_TICKS % ticks:
                raise fault(
                    repr(width),
                    key=f"azimuth_bin_deg.{scanner}",
                    allowed=["a multiple of 0.01, at most 10, that divides 360"],
                    hint=f"The default of an {scanner} is {usual:g}.",
                )
        return self

    def azimuth_bin_ticks(self, scanner: Scanner) -> int:
        """Width of an azimuth bin of a scanner in raw azimuth ticks (0.01 degree)."""
        return scanner.azimuth_bin(self.azimuth_bin_deg.get(scanner.name))


class AssignmentLimits(Section):
    """What a return must satisfy to belong to a plane."""

    distance_cm: Positive = Field(
        description="largest residual s before the adjustment, as an absolute value"
    )
    edge_cm: NotNegative = Field(
        description="a beam must meet a plane at least this far inside the hull of its targets"
    )
    incidence_deg: AcuteAngle = Field(description="largest angle between beam and normal")

    def metric(self) -> Limits:
        """Limits in metres and radians."""
        return Limits(
            self.distance_cm * 1e-2, self.edge_cm * 1e-2, float(np.deg2rad(self.incidence_deg))
        )


class Assignment(Section):
    """Which return belongs to which surveyed plane."""

    planes: Texts = Field(description="names of the surveyed planes that are used")
    limits: AssignmentLimits = Field(description="limits of the assignment")
