"""Settings of the adjustment of a unit; the defaults are those that are recommended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from velocal.adjustment.unit.common_mean import GivenMean
from velocal.errors import VelocalError
from velocal.scanner.models import Scanner
from velocal.scanner.parameters import FAR_POINT_M, TWO_POINT, LaserParameters

#: Parameters whose spread over the lasers is learnt, or given as a prior.
LEARNT = ("dl", "alpha", "v", "scale", "voff", "hoff")
#: Settings that are no sizes, or may be zero.
_NOT_SIZES = (
    "prior", "hold_below", "pose_in_common", "least_std", "least_spread", "means", "learn_relief",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class UnitSettings:
    """What the adjustment of a unit assumes beside its data; nothing has to be guessed.

    Attributes
    ----------
    azimuth_bin_rad : float
        Width of the bins whose means are adjusted, radians.
    relief_length_m : float
        Length over which a surface deviates from its plane by about the same, metres.
    relief_knots_m : float
        Distance of the knots that describe this deviation, metres.
    relief_least_m : float
        Least standard deviation of a surface about its plane, metres. Few targets show no
        deviation, but no wall is flat.
    learn_relief : bool
        Whether the size of these deviations is estimated from the data, as one multiple for all
        surfaces of what the stations state. A survey states it from its targets; without a survey
        nobody knows it.
    prior : mapping of str to float, or None
        Standard deviation over the lasers of true minus factory values, out of `LEARNT`; metres,
        radians, 1. What is not given is learnt from the unit; None where all are.
    shift_m : float
        Standard deviation of the shift that the distances of one laser have at one station,
        metres. It is used where there is one station only, which cannot show it; otherwise it is
        estimated.
    common_shift_m : float
        The same of the shift that all lasers have in common at a station.
    offset_m : float
        Standard deviation of the errors of `voff` (unless `prior` gives another), and scale of
        the hyperprior of those of `hoff`, metres. They are not corrected, but their errors would
        otherwise be read as angles.
    least_std : mapping of str to float
        Standard deviations over the lasers, out of `LEARNT`, that the stated covariance contains at
        least, also where the estimate reckons with less; metres, radians, 1. That of `voff` is
        3 mm: one height of the scanner cannot tell its errors from those of v.
    least_spread : mapping of str to float
        Standard deviations over the lasers, of dl, alpha or v, by which a mean is judged at least:
        a small spread of lasers that the data hardly show is no measure of what a mean may be;
        metres, radians.
    means : mapping of str to GivenMean
        Means of dl, alpha or v over the lasers that are known already, and not decided on.
    far_point_m : float or None
        Range along the beam at which the distance correction of the factory holds, metres (25.04
        for scanners with a two-point file). The correction of the distance fades to zero there.
        None for a correction that is the same at all ranges.
    far_std_m : float
        Scale of the hyperprior of the error that the factory's correction has at the far point.
    pose_in_common : float
        Share of the variance of a pose that all stations have in common, because the base targets
        are measured only once in the scanner frame.
    hold_below : float
        A parameter of a laser of which the data decide less than this share is not changed.
    integration_points : int
        Least number of values of the standard deviations of the unit over which the result is
        averaged; 1 for the most probable values alone.
    linearisations : int
        How often the model is linearised at least; more often where a pose still turns
        by more than 0.1 deg (1 deg if it is 1).
    """

    azimuth_bin_rad: float = float(np.deg2rad(0.9))
    relief_length_m: float = 0.35
    relief_knots_m: float = 0.5
    relief_least_m: float = 0.0005
    learn_relief: bool = False
    prior: Mapping[str, float] | None = None
    shift_m: float = 0.005
    common_shift_m: float = 0.005
    offset_m: float = 0.0007
    least_std: Mapping[str, float] = field(default_factory=lambda: {"voff": 0.003})
    least_spread: Mapping[str, float] = field(default_factory=dict)
    means: Mapping[str, GivenMean] = field(default_factory=dict)
    far_point_m: float | None = None
    far_std_m: float = 0.01
    pose_in_common: float = 0.4
    hold_below: float = 0.1
    integration_points: int = 32
    linearisations: int = 2

    @classmethod
    def recommended(
        cls,
        scanner: Scanner,
        *,
        prior: Mapping[str, float] | None = None,
        factory: LaserParameters | None = None,
    ) -> UnitSettings:
        """Settings for a scanner.

        Parameters
        ----------
        scanner : Scanner
            Distances of units that the factory measures one by one (HDL-64E) shift by about 1 cm
            from recording to recording, those of the others by 1.3 mm.
        prior : mapping of str to float, optional
            See `UnitSettings`.
        factory : LaserParameters, optional
            Parameters that are corrected. If they are those of the design, or say that the
            file has no two-point correction, no distance was corrected at the far point, and
            there is none.

        Examples
        --------
        >>> UnitSettings.recommended(SCANNERS["HDL-64E"]).far_point_m
        25.04
        """
        own_file = scanner.has_factory_file
        two_point = own_file
        if factory is not None:
            told = factory.carried.get(TWO_POINT, np.ones(len(factory)))
            two_point &= bool(np.any(factory.dl != 0.0)) and bool(np.any(told > 0.0))
        return cls(
            prior=prior,
            shift_m=0.01 if own_file else 0.0013,
            far_point_m=FAR_POINT_M if two_point else None,
        )

    def __post_init__(self) -> None:
        """Check that all sizes are positive, and that the prior names what has one."""
        for name, value in vars(self).items():
            if name in _NOT_SIZES or value is None:
                continue
            if not value > 0.0:
                raise VelocalError(
                    f"{name} is {value}", where="settings of a unit", allowed="more than 0"
                )
        if not 0.0 <= self.pose_in_common < 1.0:
            raise VelocalError(
                f"pose_in_common is {self.pose_in_common}",
                where="settings of a unit",
                allowed="from 0 to less than 1",
            )
        given = [(self.prior or {}), self.least_std, self.least_spread]
        for name, value in (pair for each in given for pair in each.items()):
            if name not in LEARNT or not value > 0.0:
                raise VelocalError(
                    f"standard deviation {value} of {name!r}",
                    where="settings of a unit",
                    allowed=f"more than 0, of {', '.join(LEARNT)}",
                )
