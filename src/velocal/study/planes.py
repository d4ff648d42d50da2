"""What the configuration says of planes that are found in the data: boxes, panels, search."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from velocal.study.model import (
    AcuteAngle,
    Count,
    Positive,
    Section,
    Span,
    Text,
    fault,
)


class Box(Section):
    """A box along the axes of a frame."""

    x_m: Span = Field(description="from, to")
    y_m: Span = Field(description="from, to")
    z_m: Span = Field(description="from, to")


class Panel(Section):
    """Box of a panel about the middle between the panels."""

    across_m: Span = Field(description="from, to; to the right of the middle between the panels")
    up_m: Span = Field(description="from, to; above the scanner's origin")


class PanelFit(Section):
    """Which returns a plane is fitted to."""

    depth_m: Positive = Field(
        description="largest distance of a point before or behind the distance that the sample "
        "table states"
    )
    min_points: int = Field(ge=10, description="returns that a panel needs; fewer are an error")
    min_lasers: int = Field(ge=3, description="lasers that must see a panel; fewer are an error")
    incidence_deg: AcuteAngle = Field(description="largest angle between beam and normal")


class PlaneSearch(Section):
    """Search for planes in the data."""

    planes: Count = Field(description="largest number of planes")
    distance_cm: Positive = Field(
        description="the points of a plane lie within this distance of it; about three standard "
        "deviations of the points, offsets of the lasers included"
    )
    extent_m: Positive = Field(description="largest diameter of a plane")
    min_points: int = Field(ge=10, description="medians that a plane needs; holds for patches too")
    incidence_deg: AcuteAngle = Field(
        description="largest angle between beam and normal; holds for patches too"
    )
    seed: int = Field(ge=0, description="seed of the random search")

    @classmethod
    def recommended(cls) -> PlaneSearch:
        """What a study of `velocal init` begins with."""
        return cls(
            planes=8, distance_cm=6.0, extent_m=4.0, min_points=300, incidence_deg=70.0, seed=1
        )


class Judged(Section):
    """Planes that calibrations without a survey are only judged on."""

    names: Annotated[tuple[Text, ...], Field(strict=False)] = Field(
        default=(),
        description="samples, or planes as `sample/plane`, that nothing is adjusted on",
    )
    share: Annotated[float, Field(gt=0.0, lt=1.0)] | None = Field(
        default=None,
        description="share of the planes, drawn at random, that nothing is adjusted on; given "
        "instead of `names`",
    )
    seed: int = Field(default=1, ge=0, description="seed of that draw")

    @model_validator(mode="after")
    def _one_of_both(self) -> Judged:
        if self.names and self.share is not None:
            raise fault("both `names` and `share` are given", hint="Leave out one of them.")
        return self
