"""Methods that `benchmarks/calibration.py` compares: from a user's data to the values of a set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from velocal.adjustment.average import Member, Weighting, average
from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.observations import Observations
from velocal.adjustment.result import CalibrationSet
from velocal.adjustment.solvers import GaussHelmert, PaperModel, Solver, WithPrior
from velocal.arrays import Array
from velocal.calibration.convert import for_program
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters
from velocal.simulation.independent import Trial
from velocal.study.adjustment import Adjustment

#: A plane whose normal is nearer to the horizon than this (its sine) is a wall.
WALL = 0.5
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
    """

    parameters: LaserParameters
    std: dict[str, Array]


def factory(trial: Trial) -> Found:
    """Leave the factory's values."""
    return Found(trial.factory, {})


def truth(trial: Trial) -> Found:
    """Take the true values; of a correction that depends on the range, that at `DL_AT_M`."""
    if trial.true.carried:
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
    if parameters.carried:
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


#: Names of what each function gives, in the order of the tables.
METHODS: dict[tuple[str, ...], Callable[[Trial], Found | tuple[Found, ...]]] = {
    ("factory",): factory,
    ("dl",): dl_only,
    ("paper",): paper,
    ("paper_truncated",): paper_truncated,
    ("prior", "prior_covariance"): prior,
    ("truth",): truth,
}
