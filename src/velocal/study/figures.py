"""What the configuration says of the paper's tables and of figures."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from velocal.scanner.models import SCANNERS
from velocal.study.model import Count, Names, Placeholder, ScannerName, Section, fault
from velocal.study.planes import Box

Word = Annotated[str, Field(pattern=r"^\w+$")]
SetName = Annotated[Word, Placeholder("{set}")]
SectionName = Annotated[Word, Placeholder("{section}")]
Data = Literal["calibration", "validation"]


class Table(Section):
    """One of the paper's tables."""

    scanner: ScannerName = Field(description="scanner of the samples")
    samples: Names = Field(description="samples that are shown")
    data: Data = Field(description="residuals of medians, or of single rotations")


class LaserFigure(Table):
    """A figure of statistics per laser."""

    kind: Literal["std", "within_1sigma", "within_3sigma", "within"] = Field(
        description="standard deviation of s per laser, or share of s within 1 sigma, 3 sigma, "
        "or both"
    )


class HistogramFigure(Section):
    """Histograms of the residuals of one laser."""

    kind: Literal["histogram"] = Field(description="histogram of the residuals of one laser")
    scanner: ScannerName = Field(description="scanner of the samples")
    samples: Names = Field(description="samples that are shown")
    data: Literal["calibration"] = Field(description="a histogram shows residuals of medians")
    laser: Count = Field(description="laser, counted from 1")

    @model_validator(mode="after")
    def _laser_exists(self) -> HistogramFigure:
        count = SCANNERS[self.scanner].n_lasers
        if self.laser > count:
            raise fault(f"{self.laser}", key="laser", allowed=[f"1 to {count}"])
        return self


class PlanFigure(Section):
    """The site in plan with the medians of the middle window, one panel per sample."""

    kind: Literal["plan"] = Field(
        description="the site in plan with the medians of the middle window, one panel per "
        "sample; at most 3000 medians of a kind are drawn and kept, every n-th, and the column "
        "`drawn_of` says of how many"
    )
    scanner: ScannerName = Field(description="scanner of the samples")
    samples: Names = Field(description="samples that are shown")


class MapFigure(Section):
    """The map of the simulated building."""

    kind: Literal["map"] = Field(description="map of the simulated building; at most one figure")
    scanner: ScannerName = Field(description="scanner of the map")
    set: SetName = Field(description="parameter set that the map is made with")
    sections: dict[SectionName, Box] = Field(
        min_length=1,
        description="stretches of walls, as boxes in the frame of the building that contain "
        "nothing but the wall, which runs along their longer horizontal side; `map/summary.csv` "
        "gives the thickness of each, and the first is drawn",
    )


class CorrectionsFigure(Section):
    """Corrections of every laser with their 95 % intervals."""

    kind: Literal["corrections"] = Field(
        description="corrections of every laser with their 95 % intervals, one panel per parameter"
    )
    scanner: ScannerName = Field(description="scanner of the parameter sets")
    sets: Annotated[tuple[SetName, ...], Field(strict=False)] = Field(
        default=(), description="parameter sets that are shown; all of the scanner if left out"
    )


class PacketFigure(Section):
    """Layout of a data packet."""

    kind: Literal["packet"] = Field(description="layout of a data packet, byte by byte")
    scanner: ScannerName = Field(description="scanner that sends the packet")


class FrameFigure(Section):
    """The scanner frame, the parameters of a laser, and the nominal directions of all lasers."""

    kind: Literal["frame"] = Field(
        description="scanner frame, parameters of a laser, and nominal directions of all lasers"
    )
    scanner: ScannerName = Field(description="scanner whose lasers are drawn")


class ResidualFigure(Section):
    """The residual s of a point about a wall, with the angles of the paper's Table I."""

    kind: Literal["residual"] = Field(
        description="residual s of a point about a wall, and the angles of the paper's Table I"
    )


class FlowFigure(Section):
    """The rules of the workflow, from a recording to the report."""

    kind: Literal["flow"] = Field(description="rules of the workflow, and what they pass on")


class ProcedureFigure(Section):
    """Which recording is calibrated on and which is validated on."""

    kind: Literal["procedure"] = Field(
        description="which sample is adjusted, averaged to a parameter set, and validated on"
    )


SampleFigure = LaserFigure | HistogramFigure | PlanFigure
SetFigure = MapFigure | CorrectionsFigure
Diagram = PacketFigure | FrameFigure | ResidualFigure | FlowFigure | ProcedureFigure
Figure = Annotated[SampleFigure | SetFigure | Diagram, Field(discriminator="kind")]
