"""Methods of adjustment side by side: those of the literature, the paper's, and ours.

Every method gets the same medians, the same survey and the same factory parameters; its
result is judged on the data that it was adjusted on, on another position, and against the truth
where there is one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.average import Member, average
from velocal.adjustment.joint import adjust_joint
from velocal.adjustment.lasers import find_corrections
from velocal.adjustment.observations import Observations, joined
from velocal.adjustment.result import CalibrationSet
from velocal.adjustment.robust import Robust
from velocal.adjustment.solvers import (
    GaussHelmert,
    OrdinaryLeastSquares,
    PaperModel,
    Solver,
    WithPrior,
)
from velocal.adjustment.stochastic import Stochastic
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import UnitStation
from velocal.arrays import Array, joined_rows
from velocal.errors import VelocalError
from velocal.evaluation import linear_parameters
from velocal.evaluation.statistics import laser_rms
from velocal.scanner.parameters import LaserParameters

#: A plane whose normal is nearer to the horizon than this (its sine) is a wall.
WALL = 0.5
#: Standard deviation of a range scale where none is configured. It only decides on the rank.
SCALE_STD = 1e-3
#: Linearisations after which an adjustment has not converged.
MAX_ITERATIONS = 30
#: Errors of v beyond this are counted.
FAR_OFF_RAD = np.deg2rad(1.0)
#: Truth is compared in these units.
_ERRORS = {"dl": ("dl_error_cm", 1e2), "alpha": ("alpha_error_deg", 180 / np.pi)} | {
    "v": ("v_error_deg", 180 / np.pi)
}


@dataclass(frozen=True)
class Method:
    """One method.

    Attributes
    ----------
    key, name : str
        For files and for people.
    reference : str
        Where it comes from.
    description : str
    parameters : tuple of str
        What it adjusts.
    solver : Solver or None
        How; None for the factory's values as they are, or where planes are unknown.
    planes : {"one wall", "walls", "all"}
        What it sees of the data.
    joint : bool
        Whether all positions are adjusted together.
    planes_unknown : bool
        Whether planes are adjusted together with the lasers.
    linear : bool
        Whether the linear parameters of `linear_parameters` are adjusted, in one step.
    start : {"factory", "nominal"}
        Where it starts: at the values of the unit's own file, or at those of the design.
    unit : bool
        Whether it is the adjustment of the unit: all lasers, poses and planes together.
    """

    key: str
    name: str
    reference: str
    description: str
    parameters: tuple[str, ...] = ("dl", "alpha", "v")
    solver: Solver | None = None
    planes: Literal["one wall", "walls", "all"] = "all"
    joint: bool = False
    planes_unknown: bool = False
    linear: bool = False
    start: Literal["factory", "nominal"] = "factory"
    unit: bool = False


_PAPER, _OURS = "Zalud et al. 2015", "velocal"
#: Keys of the method that is the default, and of the paper's as it is printed.
DEFAULT, PRINTED = "unit", "paper"
METHODS = (
    Method("factory", "factory values", "manufacturer", "nothing is adjusted", ()),
    Method(
        "dl", "dl only", "common practice",
        "one distance correction per laser, weighted", ("dl",), GaussHelmert(),
    ),
    Method(
        "dl_alpha", "dl + alpha", "common practice",
        "what vertical walls determine well, weighted", ("dl", "alpha"), GaussHelmert(),
    ),
    Method(
        "one_wall", "one wall, several distances", "Muhammad and Lacroix 2010",
        "least squares on the long wall alone, all positions of the study jointly",
        solver=OrdinaryLeastSquares(), planes="one wall", joint=True,
    ),
    Method(
        "planes_unknown", "planes unknown, range scale", "Glennie and Lichti 2010",
        "lasers and planes together, no survey; means of alpha and scale as datum",
        ("dl", "alpha", "v", "scale"), joint=True, planes_unknown=True,
    ),
    Method(
        "stations", "planes unknown, several stations", "[14] of the paper",
        "lasers and planes together without a range scale: static stations without targets",
        joint=True, planes_unknown=True,
    ),
    Method(
        "linear", "linear parameters", "[12] of the paper; Chen and Chien 2012",
        "six parameters in which a point is linear, one step, distances at right angles to the "
        "plane; weak directions keep the factory's value",
        linear_parameters.NAMES, linear=True,
    ),
    Method(
        "nominal", "with prior, from nominal values", "[7] of the paper",
        "with prior, but the values of the design stand for those of the unit's own file",
        solver=WithPrior(), start="nominal",
    ),
    Method(
        "gauss_helmert", "Gauss-Helmert", "textbook",
        "weighted, no prior, truncated at machine precision", solver=GaussHelmert(),
    ),
    Method(
        PRINTED, "the paper as printed", _PAPER,
        "pseudo-inverse at machine precision, walls only",
        solver=PaperModel(truncate_at=None), planes="walls",
    ),
    Method(
        "paper_truncated", "the paper, truncated", _PAPER + ", velocal",
        "directions that the prior knows better keep the factory's value, walls only",
        solver=PaperModel(truncate_at=1.0), planes="walls",
    ),
    Method(
        "prior_walls", "with prior, walls only", _OURS,
        "weighted, the factory's values as observations", solver=WithPrior(), planes="walls",
    ),
    Method(
        "prior", "with prior", _OURS,
        "weighted, the factory's values as observations", solver=WithPrior(),
    ),
    Method(
        "huber", "with prior, robust", _OURS,
        "the same with Huber's weights", solver=Robust(base=WithPrior(), kind="huber"),
    ),
    Method(
        "prior_joint", "with prior, positions jointly", _OURS,
        "the same on all positions of the study together", solver=WithPrior(), joint=True,
    ),
    Method(
        DEFAULT, "unit as a whole (default)", _OURS,
        "all lasers, poses and planes together, spreads of the unit and noise estimated",
        unit=True,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class SampleData:
    """Medians of one sample.

    Attributes
    ----------
    position : str
        Set-up of the scanner, of which all samples share pose and planes.
    windows : sequence of Observations
    station : UnitStation or None
        Survey of the position for the adjustment of the unit; its observations are not used.
        Without it this method is left out.
    """

    position: str
    windows: Sequence[Observations]
    station: UnitStation | None = None


@dataclass(frozen=True)
class Estimate:
    """What a method has found.

    Attributes
    ----------
    parameters : LaserParameters
    scale : ndarray, shape (lasers,), or None
        Range scale per laser.
    unconverged : int
        Lasers whose adjustment did not converge in some window.
    """

    parameters: LaserParameters
    scale: Array | None = None
    unconverged: int = 0


def run_method(
    method: Method,
    calibration: Sequence[SampleData],
    other: Sequence[SampleData],
    factory: LaserParameters,
    stochastic: Stochastic,
    nominal: LaserParameters | None = None,
    settings: UnitSettings | None = None,
) -> Estimate:
    """Adjust with one method: mean over the windows, then over the samples.

    Parameters
    ----------
    method : Method
    calibration, other : sequence of SampleData
        Samples to calibrate on, and of another position. Methods that adjust positions jointly
        take the same window of all of them together, and of n samples every n-th median of a
        laser, so that they have about as many medians as the others.
    factory : LaserParameters
    stochastic : Stochastic
        With a prior for dl, alpha and v.
    nominal : LaserParameters, optional
        Values of the design; those of the factory where a unit has no file of its own.
    settings : UnitSettings, optional
        Of the adjustment of the unit.

    Returns
    -------
    Estimate

    Raises
    ------
    VelocalError
        If a method adjusts samples jointly that do not have as many windows each.
    """
    if not method.parameters:
        return Estimate(factory)
    if method.unit:
        # Here: it needs scipy.linalg, and many jobs import this module.
        from velocal.adjustment.unit.adjust import adjust_unit

        return Estimate(adjust_unit(_stations(calibration), factory, settings).calibration.adjusted)
    initial = nominal if nominal is not None and method.start == "nominal" else factory
    # Neither the survey's uncertainty nor correlation enters any estimate.
    stochastic = replace(
        stochastic,
        block_rad=None,
        survey=(),
        prior_std={"scale": SCALE_STD, **stochastic.prior_std},
    )
    if not method.joint:
        samples = [
            [
                _adjusted(method, _seen(method, window, 0), initial, stochastic)
                for window in each.windows
            ]
            for each in calibration
        ]
    else:
        everything = [*calibration, *other]
        if len({len(each.windows) for each in everything}) > 1:
            raise VelocalError(
                f"windows per sample are {[len(each.windows) for each in everything]}",
                where="methods",
                allowed="samples of as many windows each",
            )
        positions = list(dict.fromkeys(each.position for each in everything))
        wall = _largest_wall(everything)
        windows = []
        for parts in zip(*(each.windows for each in everything), strict=True):
            data = joined([_thinned(_seen(method, part, wall), len(parts)) for part in parts])
            of_part = np.array([positions.index(each.position) for each in everything])
            data = replace(data, station=of_part[data.station_number])
            windows.append(_adjusted(method, data, initial, stochastic))
        samples = [windows]
    mean = average(
        [
            # Only positions of noise would matter, and there are no covariances here.
            Member(str(number), "", CalibrationSet(method.parameters, initial, x, seen))
            for number, windows in enumerate(samples)
            for x, seen, _ in windows
        ]
    )
    failed = [~converged & seen for windows in samples for _, seen, converged in windows]
    return Estimate(mean.adjusted, mean.range_scale, int(np.any(failed, axis=0).sum()))


def _stations(samples: Sequence[SampleData]) -> list[UnitStation]:
    """Put all windows at every position together."""
    found = []
    for position in dict.fromkeys(each.position for each in samples):
        own = [each for each in samples if each.position == position]
        windows = [window for each in own for window in each.windows]
        if own[0].station is None:
            raise VelocalError(f"no survey of position {position!r}", where="methods")
        found.append(replace(own[0].station, observations=joined_rows(windows)))
    return found


def _adjusted(
    method: Method, data: Observations, initial: LaserParameters, stochastic: Stochastic
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Corrections (lasers, u), which lasers have observations, which have converged."""
    seen = np.bincount(data.laser_id, minlength=len(initial)) > 0
    if method.planes_unknown:
        number = data.station_number * (int(data.plane_number.max()) + 1) + data.plane_number
        group = np.unique(number, return_inverse=True)[1]
        joint = adjust_joint(data, group, initial, method.parameters, stochastic)
        return joint.corrections, seen, np.full(len(initial), joint.converged)
    if method.linear:
        found = linear_parameters.adjust(data, initial, stochastic)
        return found, seen, np.ones(len(initial), dtype=bool)
    assert method.solver is not None
    corrections, converged = find_corrections(
        data,
        initial,
        method.parameters,
        method.solver,
        stochastic,
        max_iterations=MAX_ITERATIONS,
    )
    return corrections, seen, converged


def _of_walls(data: Observations) -> NDArray[np.bool_]:
    """Which observations hit vertical planes."""
    return np.abs(data.normal[:, 2]) < WALL


def _seen(method: Method, data: Observations, wall: int) -> Observations:
    if method.planes == "all":
        return data
    walls = _of_walls(data)
    return data.take(walls & (data.plane_number == wall) if method.planes == "one wall" else walls)


def _largest_wall(samples: Sequence[SampleData]) -> int:
    """The wall with the most medians."""
    windows = [window for each in samples for window in each.windows]
    numbers = [window.plane_number[_of_walls(window)] for window in windows]
    return int(np.argmax(np.bincount(np.concatenate(numbers))))


def _thinned(data: Observations, every: int) -> Observations:
    order = np.lexsort((data.phi, data.plane_number, data.laser_id))
    return data.take(order[::every])


def evaluate(
    method: Method,
    estimate: Estimate,
    calibration: Sequence[SampleData],
    other: Sequence[SampleData],
    sigma_m: float,
    truth: LaserParameters | None = None,
) -> dict[str, Any]:
    """Judge what a method has found.

    Parameters
    ----------
    method : Method
    estimate : Estimate
    calibration, other : sequence of SampleData
        All methods are judged on all planes of them, whatever they were adjusted on.
    sigma_m : float
        Standard deviation of the datasheet, metres.
    truth : LaserParameters or None
        Against which errors are taken, if it is known.

    Returns
    -------
    dict
        ``{data}_rms_cm``: mean over the lasers of the root mean square of s, mean of the
        windows; ``{data}_walls_rms_cm``: the same on walls only, which is what the paper looks
        at; ``{data}_within_1sigma_pct``: share of |s| below the datasheet's sigma;
        ``other_seen``: whether the method was adjusted on the other position too; errors: root mean
        square over the lasers; ``v_far_off``: lasers with an error of v above 1 deg.
    """
    row: dict[str, Any] = {
        "method": method.key,
        "name": method.name,
        "reference": method.reference,
        "description": method.description,
        "planes": method.planes,
        "parameters": " ".join(method.parameters),
        "other_seen": int(method.joint),
        "unconverged": estimate.unconverged,
    }
    for label, samples in (("calibration", calibration), ("other", other)):
        windows = [window for each in samples for window in each.windows]
        rms, walls_rms, share = np.mean(
            [_statistics(w, estimate, sigma_m) for w in windows], axis=0
        )
        row[f"{label}_rms_cm"] = float(rms) * 1e2
        row[f"{label}_walls_rms_cm"] = float(walls_rms) * 1e2
        row[f"{label}_within_1sigma_pct"] = float(share) * 1e2
    if truth is not None:
        row |= errors(estimate.parameters, truth)
    return row


def _statistics(data: Observations, estimate: Estimate, sigma_m: float) -> list[float]:
    """Mean over the lasers of the root mean square, the same on walls, share within sigma."""
    s = data.misclosure(estimate.parameters, estimate.scale)
    n_lasers, walls = len(estimate.parameters), _of_walls(data)
    rms = [
        float(np.nanmean(laser_rms(s[rows], data.laser_id[rows], n_lasers)))
        for rows in (slice(None), walls)
    ]
    return [*rms, float(np.mean(np.abs(s) < sigma_m))]


def errors(parameters: LaserParameters, truth: LaserParameters) -> Mapping[str, float | int]:
    """Root mean square over the lasers of parameters minus truth, and lasers with a wild v."""
    difference = {name: getattr(parameters, name) - getattr(truth, name) for name in _ERRORS}
    row: dict[str, float | int] = {
        column: float(np.sqrt(np.mean(difference[name] ** 2))) * factor
        for name, (column, factor) in _ERRORS.items()
    }
    row["v_far_off"] = int(np.sum(np.abs(difference["v"]) > FAR_OFF_RAD))
    return row


def compare(
    calibration: Sequence[SampleData],
    other: Sequence[SampleData],
    factory: LaserParameters,
    stochastic: Stochastic,
    sigma_m: float,
    truth: LaserParameters | None = None,
    nominal: LaserParameters | None = None,
    settings: UnitSettings | None = None,
) -> list[dict[str, Any]]:
    """Run and judge all methods; see `run_method` and `evaluate`.

    Parameters
    ----------
    calibration, other : sequence of SampleData
        Samples to calibrate on, and of another position.
    factory : LaserParameters
    stochastic : Stochastic
        With a prior for dl, alpha and v.
    sigma_m : float
        Standard deviation of the datasheet, metres.
    truth : LaserParameters, optional
        Against which errors are taken.
    nominal : LaserParameters, optional
        As for `run_method`.
    settings : UnitSettings, optional
        As for `run_method`.

    Returns
    -------
    list of dict
        Rows of `evaluate`, in the order of `METHODS`. Without the survey of a position, the
        adjustment of the unit is left out.
    """
    surveyed = all(each.station for each in calibration)
    return [
        evaluate(
            method,
            run_method(method, calibration, other, factory, stochastic, nominal, settings),
            calibration,
            other,
            sigma_m,
            truth,
        )
        for method in METHODS
        if surveyed or not method.unit
    ]
