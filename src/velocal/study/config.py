"""The configuration of a study, typed: what every key means, its default, and what it builds.

The models are the only place of defaults and descriptions; the JSON schema and the table of keys in
``config/README.md`` are made from them (`velocal.study.schema`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from velocal.study.adjustment import Adjustments, Joint
from velocal.study.figures import Figure, MapFigure, SetName, Table
from velocal.study.model import (
    RESULTS_FOLDER,
    Count,
    Name,
    Names,
    Placeholder,
    Positive,
    ScannerName,
    Section,
    Text,
    fault,
)
from velocal.study.outputs import Export, Validation
from velocal.study.planes import Box, Judged, Panel, PanelFit, PlaneSearch
from velocal.study.reduction import Assignment, Reduction
from velocal.study.windows import MAX_MISSING

SampleName = Annotated[Name, Placeholder("{sample}")]
PlaneName = Annotated[Text, Placeholder("{plane}")]
PanelName = Annotated[Text, Placeholder("{panel}")]
TableNumber = Annotated[Literal["2", "3", "4", "5"], Placeholder('"2" ... "5"')]
FigureNumber = Annotated[str, Field(pattern=r"^[0-9][0-9]$"), Placeholder('"NN"')]
Kind = Literal["ideal", "real"]
#: Scanner of a sample, which a file may describe; the samples tell which names there are.
AnyScanner = Annotated[Name, Placeholder("{scanner}")]


#: No part begins with a point: neither `..` nor a hidden folder.
_FOLDER = r"^[A-Za-z0-9_][A-Za-z0-9_.-]*(/[A-Za-z0-9_][A-Za-z0-9_.-]*)*/?$"


def _below(folder: str) -> str:
    """Refuse a folder that lies elsewhere, is hidden, or has a name that programs may split."""
    if not re.match(_FOLDER, folder):
        raise fault(
            f"{folder!r} is no folder for results",
            allowed=["a folder below this one, of letters, digits, _, - and points"],
            hint="As results, or results/monday; no part of it begins with a point.",
        )
    return folder


Folder = Annotated[str, AfterValidator(_below), Field(json_schema_extra={"pattern": _FOLDER})]


class Coordinates(Section):
    """Survey files that hold coordinates."""

    planes: Text = Field(description="CSV of the targets on walls and floor, in the site frame")
    base_scanner: Text = Field(
        description="CSV of the targets on the scanners' bases, each in its scanner's frame"
    )
    base_site: Text = Field(
        description="CSV of the same targets in the site frame, at every position"
    )


class ObservationFiles(Section):
    """Files of observations from which coordinates are adjusted."""

    points: Text = Field(description="control points, and the targets of the planes")
    polar: Text = Field(description="polar observations of total stations to control points")
    images: Text | None = Field(
        default=None,
        description="image observations of targets and control points; without this file the "
        "targets of the planes are observed in `polar`",
    )
    base_polar: Text = Field(description="polar observations to the targets of the bases")
    base_coordinates: Text = Field(
        description="repeated coordinates of these targets in the scanners' frames"
    )


class Observations(Section):
    """A survey whose coordinates are adjusted by the workflow."""

    observations: ObservationFiles = Field(
        description="files from which the coordinates are adjusted, given instead of the "
        "three files of coordinates"
    )


def _survey_tag(content: Any) -> str:
    if isinstance(content, dict):
        return "observations" if "observations" in content else "coordinates"
    return "observations" if isinstance(content, Observations) else "coordinates"


Survey = Annotated[
    Annotated[Coordinates, Tag("coordinates")] | Annotated[Observations, Tag("observations")],
    Discriminator(_survey_tag),
]


class Seeds(Section):
    """Replicas of the study with other seeds of the simulated world."""

    count: int = Field(ge=2, description="`make seeds` uses the seeds 1, 2, ... up to this number")
    rotations: Count = Field(description="complete rotations of a window in these replicas")


class Simulation(Section):
    """A simulated world that replaces recordings and survey."""

    world: Text = Field(description="file with the constants of the simulated world")
    rotations: int = Field(
        ge=3,
        description="complete rotations of every simulated recording; 3000 are five minutes",
    )
    seeds: Seeds | None = Field(default=None, description="replicas that `make seeds` makes")


class Windows(Section):
    """Windows at the beginning, in the middle and at the end of a recording."""

    rotations: Count = Field(
        description="complete rotations of each of the windows beginning, middle and end"
    )
    max_missing: float = Field(
        default=MAX_MISSING,
        ge=0,
        lt=1,
        description="largest share of its azimuth that a complete rotation may miss where packets "
        "are lost; three lost packets are allowed as well, unless this is 0",
    )


class Methods(Section):
    """Comparison of the methods of adjustment."""

    scanner: ScannerName = Field(
        description="scanner of the samples; `methods/comparison.*` shows the result"
    )
    runs: int = Field(
        default=500,
        ge=2,
        description="runs of the Monte Carlo check of the stated uncertainty by `make coverage`, "
        "`methods/coverage.csv`",
    )
    calibration: Names = Field(description="samples that every method is adjusted on")
    other: Names = Field(
        description="samples of another position, on which the methods are judged; only methods "
        "that adjust positions jointly are adjusted on them too"
    )


class Outdoor(Section):
    """Panels outdoors, to which planes are fitted before and after the calibration."""

    samples: Text = Field(description="sample table of the outdoor samples")
    rotations: Annotated[int, Field(ge=3)] | None = Field(
        default=None,
        description="complete rotations of a simulated recording; needed where there is one",
    )
    panels: dict[PanelName, Panel] = Field(min_length=1, description="boxes of the panels")
    fit: PanelFit = Field(description="which returns a plane is fitted to, and how many it takes")
    figures: dict[FigureNumber, Annotated[tuple[Kind, ScannerName], Field(strict=False)]] = Field(
        default={},
        description="figures of the standard deviation against distance: kind and scanner of the "
        "samples",
    )


class Unsurveyed(Section):
    """Recordings without a survey."""

    samples: Text = Field(description="sample table of the recordings without a survey")
    recordings: Text = Field(description="folder of their captures")
    sigma_cm: Positive | None = Field(
        default=None,
        description="standard deviation of a distance in the datasheet; that of each scanner if "
        "left out",
    )
    patches: dict[SampleName, dict[PlaneName, Box]] = Field(
        default={},
        description="boxes in the scanner frame in which a plane is fitted; in the data of a "
        "sample without any, planes are searched for",
    )
    search: PlaneSearch = Field(description="search for planes where no patch is given")
    calibrations: dict[AnyScanner, Annotated[dict[SetName, Names], Field(min_length=1)]] = Field(
        default={},
        description="samples of one unit on whose planes lasers and planes are adjusted together; "
        "the files lie where those of the other `calibrations` lie",
    )
    judged: Judged = Field(
        default=Judged(),
        description="planes that these calibrations are only judged on; if it is left out, all "
        "are adjusted on, and every sample (every plane where there is one sample) is left out "
        "once to judge the result",
    )


def _placed(content: Any, folder: str) -> Any:
    """Put the folder of the results into texts, however deep they are."""
    if isinstance(content, Mapping):
        return {key: _placed(value, folder) for key, value in content.items()}
    return content.replace(RESULTS_FOLDER, folder) if isinstance(content, str) else content


class StudyConfig(Section):
    """A study. Parts that a study without a survey does not need are optional."""

    study: Text = Field(description="title, shown in the report; every configuration has one")
    results: Folder = Field(
        description="folder for everything that is made, below the folder in which snakemake runs",
    )
    samples: Text | None = Field(default=None, description="sample table of the surveyed samples")
    survey: Survey | None = Field(
        default=None,
        description="survey files: coordinates or observations; in their paths, as in those of "
        "sample tables, `{results}` stands for the folder `results`",
    )
    simulation: Simulation | None = Field(
        default=None, description="the simulated world; leave it out for real recordings"
    )
    windows: Windows | None = Field(default=None, description="windows of a recording")
    reduction: Reduction = Field(description="reduction of returns to medians")
    assignment: Assignment | None = Field(
        default=None, description="which return belongs to which surveyed plane"
    )
    adjustment: Adjustments | None = Field(default=None, description="adjustment of the lasers")
    parameter_sets: dict[ScannerName, Annotated[dict[SetName, Names], Field(min_length=1)]] = Field(
        default={},
        description="samples whose adjustments are averaged (mean of the windows, then of the "
        "samples)",
    )
    calibrations: dict[ScannerName, Annotated[dict[SetName, Names], Field(min_length=1)]] = Field(
        default={},
        description="samples on which all lasers, stations and planes of a unit are adjusted "
        "together to one calibration; its files lie beside those of the parameter sets",
    )
    serials: dict[AnyScanner, Text] = Field(
        default={}, description="serial number of a scanner, for its certificate"
    )
    joint: Joint = Field(
        default=Joint(), description="settings of `calibrations`; none of them is necessary"
    )
    export: Export = Field(
        default=Export(),
        description="programs that the files of parameter sets and calibrations are for",
    )
    validation: Validation | None = Field(default=None, description="residuals of single rotations")
    compare_with_paper: bool = Field(
        default=False,
        description="write `published/agreement.csv`, the judged claims and `drift/`; needs the "
        "paper's samples, all four tables, a map and outdoor samples",
    )
    methods: Methods | None = Field(
        default=None,
        description="comparison of the methods of adjustment; it needs priors for `dl`, `alpha` "
        "and `v`, and gives errors against the truth where the study is simulated",
    )
    outdoor: Outdoor | None = Field(default=None, description="panels outdoors")
    unsurveyed: Unsurveyed | None = Field(default=None, description="recordings without a survey")
    tables: dict[TableNumber, Table] = Field(default={}, description="tables of the paper")
    figures: dict[FigureNumber, Figure] = Field(
        default={}, description='figures by number, as `"01"`; every kind has its own keys'
    )

    @model_validator(mode="before")
    @classmethod
    def _survey_below_results(cls, content: Any) -> Any:
        """Put the folder of the results into the paths of survey files."""
        if isinstance(content, Mapping) and isinstance(folder := content.get("results"), str):
            return {**content, "survey": _placed(content.get("survey"), folder.rstrip("/"))}
        return content

    @property
    def folder(self) -> str:
        """Folder of the results without a slash at its end."""
        return self.results.rstrip("/")

    @property
    def maps(self) -> dict[str, MapFigure]:
        """Figures of the kind `map` by number."""
        return {n: each for n, each in self.figures.items() if isinstance(each, MapFigure)}

    @model_validator(mode="after")
    def _parts_belong_together(self) -> StudyConfig:
        if self.samples is None and self.unsurveyed is None:
            raise fault("names no sample", hint="Give `samples` or `unsurveyed`.")
        needed = ["survey", "windows", "assignment", "validation"]
        if self.parameter_sets:
            needed.append("adjustment")
        elif not self.calibrations:
            needed.append("calibrations")
        for key in needed if self.samples else ():
            if not getattr(self, key):
                raise fault(
                    f"key {key!r} is missing",
                    hint="A study with `samples` needs it; config/README.md describes it.",
                )
        for key in ("methods", "outdoor", "tables", "figures", "compare_with_paper"):
            if getattr(self, key) and not self.samples:
                raise fault("needs surveyed samples", key=key, hint="Give `samples`.")
        for number in self.outdoor.figures if self.outdoor else ():
            if number in self.figures:
                raise fault(f"figure {number} is in both figures and outdoor.figures")
        for number in self.maps:
            if len(self.maps) > 1 or self.simulation is None:
                raise fault(
                    "one map of the simulated world's building is drawn, no other",
                    key=f"figures.{number}",
                )
        return self

    @model_validator(mode="after")
    def _paper_is_complete(self) -> StudyConfig:
        if not self.compare_with_paper:
            return self
        missing = [f"tables.{n}" for n in ("2", "3", "4", "5") if n not in self.tables]
        missing += [] if self.maps else ["a figure of the kind map"]
        missing += [] if self.outdoor else ["outdoor"]
        missing += [] if isinstance(self.survey, Observations) else ["survey.observations"]
        if missing:
            raise fault(
                f"there is no {' and no '.join(missing)}",
                key="compare_with_paper",
                hint="The paper's statements are compared with these; "
                "leave out `compare_with_paper` for a study of your own.",
            )
        return self

    @model_validator(mode="after")
    def _methods_have_priors(self) -> StudyConfig:
        if self.methods and self.adjustment:
            given = self.adjustment.prior.std()
            for name, key in (("dl", "dl_cm"), ("alpha", "alpha_deg"), ("v", "v_deg")):
                if name not in given:
                    raise fault(f"adjustment.prior has no {key!r}", key="methods")
        return self
