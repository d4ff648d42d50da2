"""Methods that `benchmarks/calibration.py` compares: from a user's data to the values of a set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from velocal.adjustment.average import Member, Weighting, average
from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.observations import Observations, joined
from velocal.adjustment.result import CalibrationSet
from velocal.adjustment.solvers import GaussHelmert, PaperModel, Solver, WithPrior
from velocal.adjustment.unit.adjust import adjust_unit
from velocal.adjustment.unit.settings import LEARNT, UnitSettings
from velocal.adjustment.unit.station import UnitStation
from velocal.arrays import Array
from velocal.calibration.convert import for_program
from velocal.calibration.dialects import near_effect
from velocal.exports import with_near_points
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import NEAR_POINT, LaserParameters
from velocal.simulation.independent.trial import Trial
from velocal.study.adjustment import Adjustment

#: A plane whose normal is nearer to the horizon than this (its sine) is a wall.
WALL = 0.5
#: What the oracle takes for a spread of zero: metres, radians, 1.
LEAST = {"dl": 1e-4, "alpha": 1e-6, "v": 1e-6, "scale": 1e-5, "voff": 1e-4, "hoff": 1e-4}
#: Range at which the dl of a set is judged, metres.
DL_AT_M = 3.0


@dataclass(frozen=True)
class Found:
    """What a method gives.

    Attributes
    ----------
    parameters : LaserParameters
    std : dict of str to ndarray
        Stated standard deviations by parameter; empty where a method states none.
    at_factory : tuple of str
        Angles whose mean over the lasers was left at the factory's value: a matter of the frame,
        which neither their errors nor their standard deviations contain.
    """

    parameters: LaserParameters
    std: dict[str, Array]
    at_factory: tuple[str, ...] = ()


def has_near_points(parameters: LaserParameters) -> bool:
    """Whether a file has a two-point correction."""
    return NEAR_POINT[0] in parameters.carried


def factory(trial: Trial) -> Found:
    """Leave the factory's values."""
    return Found(trial.factory, {})


def truth(trial: Trial) -> Found:
    """Take the true values; of a correction that depends on the range, that at `DL_AT_M`."""
    if has_near_points(trial.true):
        return Found(trial.true, {})
    return Found(replace(trial.true, dl=trial.correction(DL_AT_M, slice(None))), {})


def _walls(data: Observations) -> Observations:
    return data.take(np.abs(data.normal[:, 2]) < WALL)


def _members(
    trial: Trial, names: Sequence[str], solver: Solver, *, walls: bool = False
) -> list[Member]:
    """Adjust every window of every station on its own, as the template of a study does."""
    settings = Adjustment.recommended(SCANNERS[trial.scanner])
    members = []
    for number, station in enumerate(trial.stations):
        stochastic = settings.stochastic([station.survey.uncertainty()])
        for window in station.windows:
            data = _walls(window) if walls else window
            found = adjust_all(data, trial.factory, names, solver, stochastic)
            made = CalibrationSet.from_adjustments(found, trial.factory)
            members.append(Member(f"sample{number}", f"P{number}", made))
    return members


def _mean(members: Sequence[Member], weighting: Weighting = "equal") -> Found:
    found = average(members, weighting)
    parameters = found.adjusted
    if has_near_points(parameters):
        # One distance correction for all ranges, as a set of these methods is written to a file.
        parameters = for_program(parameters, "manual")
    return Found(parameters, found.std_by_name())


ANGLES = ("dl", "alpha", "v")


def dl_only(trial: Trial) -> Found:
    """Adjust one distance correction per laser."""
    return _mean(_members(trial, ("dl",), GaussHelmert()))


def paper(trial: Trial) -> Found:
    """Follow the paper as printed: walls only, truncated at machine precision."""
    return _mean(_members(trial, ANGLES, PaperModel(truncate_at=None), walls=True))


def paper_truncated(trial: Trial) -> Found:
    """Follow the paper, but leave out directions that the prior knows better."""
    return _mean(_members(trial, ANGLES, PaperModel(truncate_at=1.0), walls=True))


def prior(trial: Trial) -> tuple[Found, Found]:
    """Adjust with the prior that the template gives; plain mean, and mean by covariance."""
    members = _members(trial, ANGLES, WithPrior())
    return _mean(members), _mean(members, "covariance")


def _corrected(data: Observations, factory: LaserParameters) -> Observations:
    """Correct distances by the near points of the file, as the product does."""
    effect = near_effect(data.distance_m, data.phi, data.laser_id, factory)
    return replace(data, distance_m=data.distance_m + effect)


def unit_stations(trial: Trial) -> list[UnitStation]:
    """All windows of every station together, with its survey, for the adjustment of the unit."""
    return [
        UnitStation(
            name=station.survey.position,
            observations=_corrected(replace(joined(station.windows), station=None), trial.factory),
            survey=station.survey.uncertainty(),
            plane_names=tuple(plane.patch.name for plane in station.survey.planes),
            pose=station.survey.pose,
        )
        for station in trial.stations
    ]


def unit_settings(trial: Trial) -> UnitSettings:
    """What the default adjustment assumes."""
    return UnitSettings.recommended(SCANNERS[trial.scanner], factory=trial.factory)


def _of_unit(trial: Trial, settings: UnitSettings) -> Found:
    result = adjust_unit(unit_stations(trial), trial.factory, settings)
    calibration = result.calibration
    parameters = calibration.adjusted
    if has_near_points(trial.factory):
        parameters = with_near_points(result)
    at_factory = tuple(one.name for one in result.common if one.at_factory and one.name != "dl")
    std = calibration.std_by_name() | {name: result.std_without_mean(name) for name in at_factory}
    return Found(parameters, std, at_factory)


def joint(trial: Trial) -> Found:
    """Adjust lasers, poses and planes of all stations together: the default."""
    return _of_unit(trial, unit_settings(trial))


def oracle(trial: Trial) -> Found:
    """Do the same with the true standard deviations of the parameters over the lasers."""
    # A scale of zero has no logarithm; this one is 0.1 mm at 10 m.
    prior = {name: trial.spread.get(name, 0.0) or LEAST[name] for name in LEARNT}
    return _of_unit(trial, replace(unit_settings(trial), prior=prior))


#: Names of what each function gives, in the order of the tables.
METHODS: dict[tuple[str, ...], Callable[[Trial], Found | tuple[Found, ...]]] = {
    ("factory",): factory,
    ("dl",): dl_only,
    ("paper",): paper,
    ("paper_truncated",): paper_truncated,
    ("prior", "prior_covariance"): prior,
    ("joint",): joint,
    ("oracle",): oracle,
    ("truth",): truth,
}
