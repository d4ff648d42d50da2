"""What the configuration says of the adjustment: parameters, a-priori knowledge, solver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from velocal.adjustment.robust import Robust
from velocal.adjustment.solvers import (
    GaussHelmert,
    OrdinaryLeastSquares,
    PaperModel,
    Solver,
    WithPrior,
)
from velocal.adjustment.stochastic import Stochastic, SurveyUncertainty
from velocal.adjustment.unit.settings import UnitSettings
from velocal.scanner.models import Scanner
from velocal.scanner.parameters import LaserParameters
from velocal.study.model import (
    NotNegative,
    Positive,
    ScannerName,
    Section,
    fault,
)

Parameter = Literal["dl", "alpha", "v", "voff", "hoff"]


#: Solvers by name; each is made with the key `truncate_at`, which only some of them use.
SOLVERS: dict[str, Callable[[float | None], Solver]] = {
    "prior": lambda _: WithPrior(),
    "paper": lambda truncate_at: PaperModel(truncate_at=truncate_at),
    "gauss_helmert": lambda truncate_at: GaussHelmert(truncate_at=truncate_at),
    "least_squares": lambda _: OrdinaryLeastSquares(),
}


_DEG = np.pi / 180.0


class JointPrior(Section):
    """How far the values of the factory may be off: standard deviations."""

    dl_cm: Positive | None = Field(default=None, description="of a distance correction")
    alpha_deg: Positive | None = Field(default=None, description="of a rotational angle")
    v_deg: Positive | None = Field(default=None, description="of a vertical angle")
    scale_cm_per_m: Positive | None = Field(default=None, description="of a range scale")

    def std(self) -> dict[str, float]:
        """Standard deviations that are given, by parameter; metres, radians, 1."""
        return {
            name: getattr(self, key) * unit
            for key, (name, unit) in _PRIORS.items()
            if getattr(self, key, None) is not None
        }


class Prior(JointPrior):
    """The same for the adjustment of single lasers, which can adjust offsets too."""

    voff_cm: Positive | None = Field(default=None, description="of a vertical offset")
    hoff_cm: Positive | None = Field(default=None, description="of a horizontal offset")


#: Parameter and unit of every key of `Prior`.
_PRIORS = {
    "dl_cm": ("dl", 1e-2),
    "alpha_deg": ("alpha", _DEG),
    "v_deg": ("v", _DEG),
    "voff_cm": ("voff", 1e-2),
    "hoff_cm": ("hoff", 1e-2),
    "scale_cm_per_m": ("scale", 1e-2),
}


class Joint(Section):
    """Adjustment of all lasers, stations and planes of a unit together."""

    prior: JointPrior | None = Field(
        default=None,
        description="standard deviations of the factory's values where they are known; without "
        "them they are learnt from the lasers of the unit",
    )

    near_points: bool = Field(
        default=True,
        description="whether the near-point corrections of the factory's file are part of what is "
        'corrected, and of "before" in all residuals; `false` takes one distance correction per '
        'laser as "before", as the paper',
    )

    def settings(self, scanner: Scanner, factory: LaserParameters) -> UnitSettings:
        """Settings in metres and radians.

        Parameters
        ----------
        scanner : Scanner
        factory : LaserParameters
            Parameters that are corrected.
        """
        prior = self.prior.std() if self.prior else None
        return UnitSettings.recommended(scanner, prior=prior, factory=factory)


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
        "the factory's value, if its standard deviation for independent noise (`noise_cm`, "
        "`angle_deg`) exceeds this many prior ones; `null` truncates at machine precision, as a "
        "pseudo-inverse does",
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
