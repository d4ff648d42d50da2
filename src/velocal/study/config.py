"""The configuration of a study, typed: what every key means, its default, and what it builds.

The models are the only place of defaults and descriptions; the JSON schema and the table of keys in
``config/README.md`` are made from them (`velocal.study.schema`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from velocal.adjustment.robust import Robust
from velocal.adjustment.solvers import (
    GaussHelmert,
    OrdinaryLeastSquares,
    PaperModel,
    Solver,
    WithPrior,
)
from velocal.adjustment.stochastic import Stochastic, SurveyUncertainty
from velocal.calibration.dialects import DIALECTS
from velocal.reduction.assignment import Limits
from velocal.scanner.models import AZIMUTH_TICKS, SCANNERS, Scanner
from velocal.study.model import (
    AcuteAngle,
    Count,
    Name,
    Names,
    NotNegative,
    Placeholder,
    Positive,
    ScannerName,
    Section,
    Span,
    Text,
    Texts,
    enum,
    fault,
    known_as,
)

SampleName = Annotated[Name, Placeholder("{sample}")]
PlaneName = Annotated[Text, Placeholder("{plane}")]
PanelName = Annotated[Text, Placeholder("{panel}")]
Word = Annotated[str, Field(pattern=r"^\w+$")]
SetName = Annotated[Word, Placeholder("{set}")]
SectionName = Annotated[Word, Placeholder("{section}")]
TableNumber = Annotated[Literal["2", "3", "4", "5"], Placeholder('"2" ... "5"')]
FigureNumber = Annotated[str, Field(pattern=r"^[0-9][0-9]$"), Placeholder('"NN"')]
Parameter = Literal["dl", "alpha", "v", "voff", "hoff"]
Data = Literal["calibration", "validation"]
Kind = Literal["ideal", "real"]
_PROGRAMS = [name for name in DIALECTS if name != "paper"]
Program = Annotated[str, known_as("program", _PROGRAMS), enum(_PROGRAMS)]

#: Solvers by name; each is made with the key `truncate_at`, which only some of them use.
SOLVERS: dict[str, Callable[[float | None], Solver]] = {
    "prior": lambda _: WithPrior(),
    "paper": lambda truncate_at: PaperModel(truncate_at=truncate_at),
    "gauss_helmert": lambda truncate_at: GaussHelmert(truncate_at=truncate_at),
    "least_squares": lambda _: OrdinaryLeastSquares(),
}
_DEG = np.pi / 180.0


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
    given = content if isinstance(content, dict) else vars(content)
    return "observations" if "observations" in given else "coordinates"


Survey = Annotated[
    Annotated[Coordinates, Tag("coordinates")] | Annotated[Observations, Tag("observations")],
    Discriminator(_survey_tag),
]


class Seeds(Section):
    """Replicas of the study with other seeds of the simulated world."""

    count: int = Field(ge=2, description="`make seeds` uses the seeds 1, 2, ... up to this number")
    rotations: Count = Field(description="complete rotations of a window in these replicas")


class Simulation(Section):
    """A simulated world stands in for recordings and survey."""

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


class Prior(Section):
    """How far the values of the factory may be off: standard deviations."""

    dl_cm: Positive | None = Field(default=None, description="of a distance correction")
    alpha_deg: Positive | None = Field(default=None, description="of a rotational angle")
    v_deg: Positive | None = Field(default=None, description="of a vertical angle")
    voff_cm: Positive | None = Field(default=None, description="of a vertical offset")
    hoff_cm: Positive | None = Field(default=None, description="of a horizontal offset")
    scale_cm_per_m: Positive | None = Field(default=None, description="of a range scale")

    def std(self) -> dict[str, float]:
        """Standard deviations that are given, by parameter; metres, radians, 1."""
        all_of_them = {
            "dl": (self.dl_cm, 1e-2),
            "alpha": (self.alpha_deg, _DEG),
            "v": (self.v_deg, _DEG),
            "voff": (self.voff_cm, 1e-2),
            "hoff": (self.hoff_cm, 1e-2),
            "scale": (self.scale_cm_per_m, 1e-2),
        }
        return {name: std * unit for name, (std, unit) in all_of_them.items() if std is not None}


class ScannerAdjustment(Section):
    """What differs for one scanner."""

    noise_cm: Positive | None = Field(default=None, description="`noise_cm` of this scanner")
    angle_deg: NotNegative | None = Field(default=None, description="`angle_deg` of this scanner")
    range_scale_cm_per_m: NotNegative | None = Field(
        default=None, description="`range_scale_cm_per_m` of this scanner"
    )
    repeatability_cm: NotNegative | None = Field(
        default=None, description="`repeatability_cm` of this scanner"
    )


class Adjustment(Section):
    """Functional model, stochastic model and solver of the adjustment of one scanner."""

    method: Literal["prior", "paper", "gauss_helmert", "least_squares"] = Field(
        description="`prior` is for work: weighted, with the prior as observations; `paper` is the "
        "new model of the paper in its fast form"
    )
    robust: Literal["huber", "igg", "snooping"] | None = Field(
        default=None,
        description="way to reduce the weight of outliers: `huber`, `igg` or `snooping`",
    )
    parameters: Annotated[tuple[Parameter, ...], Field(strict=False, min_length=1)] = Field(
        description="parameters that are adjusted, out of `dl`, `alpha`, `v`, `voff`, `hoff` (the "
        "library can adjust a range scale too, but no file of a driver can hold it)"
    )
    noise_cm: Positive = Field(description="standard deviation of a distance")
    angle_deg: NotNegative = Field(
        default=0.0, description="standard deviation of a rotational angle"
    )
    block_deg: Positive | None = Field(
        default=None,
        description="residuals on one plane that are nearer to each other than this are taken as "
        "correlated; `null` takes all residuals as independent",
    )
    range_scale_cm_per_m: NotNegative = Field(
        default=0.0,
        description="standard deviation of a range scale per laser that is not adjusted",
    )
    repeatability_cm: NotNegative = Field(
        default=0.0,
        description="standard deviation of a laser's distances from recording to recording",
    )
    prior: Prior = Field(
        description="standard deviations of the factory's values; every adjusted parameter needs "
        "one, since they scale the parameters to each other"
    )
    truncate_at: Positive | None = Field(
        default=None,
        description="a direction in the space of the parameters is weakly determined, and left at "
        "the factory's value, if its standard deviation after the adjustment exceeds this many "
        "prior ones; `null` truncates at machine precision, as a pseudo-inverse does",
    )

    @model_validator(mode="after")
    def _parameters_have_priors(self) -> Adjustment:
        if len(set(self.parameters)) < len(self.parameters):
            raise fault(f"a parameter occurs twice: {list(self.parameters)}", key="parameters")
        given = self.prior.std()
        for name in self.parameters:
            if name not in given:
                key = f"{name}_{'deg' if name in ('alpha', 'v') else 'cm'}"
                raise fault(
                    f"{name!r} is adjusted, but there is no {key!r}",
                    key="prior",
                    hint=f"Say how far the factory's value may be off: prior: {{{key}: ...}}.",
                )
        return self

    @classmethod
    def recommended(cls, scanner: Scanner) -> Adjustment:
        """What `velocal init` recommends.

        Parameters
        ----------
        scanner : Scanner
            Units that come with a file of their own have larger errors than those that are made
            to nominal values.

        Returns
        -------
        Adjustment
        """
        return cls(
            method="prior",
            parameters=("dl", "alpha", "v"),
            noise_cm=2.0,
            angle_deg=0.026,
            block_deg=5.0,
            range_scale_cm_per_m=0.1 if scanner.has_factory_file else 0.02,
            repeatability_cm=1.2 if scanner.has_factory_file else 0.13,
            prior=Prior(dl_cm=2.0, alpha_deg=0.2, v_deg=0.2),
            truncate_at=1.0,
        )

    def solver(self) -> Solver:
        """Solver that `method` and `robust` name."""
        base = SOLVERS[self.method](self.truncate_at)
        return Robust(base=base, kind=self.robust) if self.robust else base

    def stochastic(self, survey: Sequence[SurveyUncertainty] = ()) -> Stochastic:
        """Stochastic model in metres and radians.

        Parameters
        ----------
        survey : sequence of SurveyUncertainty
            Of every station that is adjusted.
        """
        return Stochastic(
            noise_std_m=self.noise_cm * 1e-2,
            prior_std=self.prior.std(),
            angle_std_rad=float(np.deg2rad(self.angle_deg)),
            block_rad=None if self.block_deg is None else float(np.deg2rad(self.block_deg)),
            range_scale=self.range_scale_cm_per_m * 1e-2,
            repeatability_m=self.repeatability_cm * 1e-2,
            survey=tuple(survey),
        )


class Adjustments(Adjustment):
    """Adjustment of all scanners: what holds for all, and what differs for one."""

    average: Literal["equal", "covariance"] = Field(
        default="equal",
        description="weights of the samples in a parameter set; those of the paper are equal",
    )
    by_scanner: dict[ScannerName, ScannerAdjustment] = Field(
        default={}, description="what differs for one scanner"
    )

    def of(self, scanner: str) -> Adjustment:
        """Adjustment of one scanner, which knows nothing of the others."""
        values = {name: getattr(self, name) for name in Adjustment.model_fields}
        own = self.by_scanner.get(scanner)
        differing = own.model_dump(exclude_none=True) if own else {}
        return Adjustment(**values | differing)


class Export(Section):
    """Programs that the files of the parameter sets are written for."""

    yaml: Program = Field(
        default="ros",
        description="program that reads the `.yaml` files; `docs/dialects.md` lists them",
    )
    xml: Program = Field(default="veloview", description="program that reads the `.xml` files")


class Validation(Section):
    """Residuals of single scans."""

    sigma_cm: Positive = Field(description="standard deviation of a distance in the datasheet")
    rotations: Count = Field(description="single rotations of each window that are used")


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


class Table(Section):
    """One of the paper's tables."""

    scanner: ScannerName = Field(description="scanner of the samples")
    samples: Names = Field(description="samples that are shown")
    data: Data = Field(description="residuals of medians, or of single scans")


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
    data: Literal["calibration"] = Field(description="residuals of medians, or of single scans")
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


class Box(Section):
    """A box along the axes of a frame."""

    x_m: Span = Field(description="from, to")
    y_m: Span = Field(description="from, to")
    z_m: Span = Field(description="from, to")


class MapFigure(Section):
    """The map of the simulated building."""

    kind: Literal["map"] = Field(description="map of the simulated building; at most one figure")
    scanner: ScannerName = Field(description="scanner of the samples, or of the map")
    set: SetName = Field(description="parameter set that the map is made with")
    sections: dict[SectionName, Box] = Field(
        min_length=1,
        description="stretches of walls, as boxes in the frame of the building that hold nothing "
        "but the wall, which runs along their longer horizontal side; `map/summary.csv` gives "
        "the thickness of each, and the first is drawn",
    )


Figure = Annotated[
    LaserFigure | HistogramFigure | PlanFigure | MapFigure, Field(discriminator="kind")
]


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


class Unsurveyed(Section):
    """Recordings without a survey."""

    samples: Text = Field(description="sample table of the recordings without a survey")
    recordings: Text = Field(description="folder of their captures")
    sigma_cm: Positive = Field(description="standard deviation of a distance in the datasheet")
    patches: dict[SampleName, dict[PlaneName, Box]] = Field(
        default={},
        description="boxes in the scanner frame in which a plane is fitted; in the data of a "
        "sample without any, planes are searched for",
    )
    search: PlaneSearch = Field(description="search for planes where no patch is given")


class StudyConfig(Section):
    """A study. Parts that a study without a survey does not need are optional."""

    study: Text = Field(description="title, shown in the report; every configuration has one")
    results: str = Field(
        pattern=r"^[A-Za-z0-9_][A-Za-z0-9_./-]*$",
        description="folder for everything that is made, relative to the folder in which "
        "snakemake runs",
    )
    samples: Text | None = Field(default=None, description="sample table of the surveyed samples")
    survey: Survey | None = Field(
        default=None, description="survey files: coordinates or observations"
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
    export: Export = Field(
        default=Export(), description="programs that the files of the parameter sets are for"
    )
    validation: Validation | None = Field(default=None, description="residuals of single scans")
    compare_with_paper: bool = Field(
        default=False,
        description="write `published/agreement.csv`; needs the paper's samples, all four tables, "
        "a map and outdoor samples",
    )
    methods: Methods | None = Field(
        default=None,
        description="comparison of the methods of adjustment; it needs priors for `dl`, `alpha` "
        "and `v`, and gives errors against the truth where the study is simulated",
    )
    outdoor: Outdoor | None = Field(default=None, description="panels outdoors")
    unsurveyed: Unsurveyed | None = Field(default=None, description="recordings without a survey")
    tables: dict[TableNumber, Table] = Field(default={}, description="tables of the paper")
    figures: dict[FigureNumber, Figure] = Field(default={}, description="figures")

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
        needed = ("survey", "windows", "assignment", "adjustment", "parameter_sets", "validation")
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
                raise fault(f"figure {number} stands in figures and outdoor.figures")
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
