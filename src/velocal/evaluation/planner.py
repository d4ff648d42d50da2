"""What a calibration will state, from where the scanner stands, before anybody measures.

The beams of the scanner are followed to the first surveyed plane that they meet. The medians there
are the observations of the adjustment of the unit, whose equations then state the covariance
(`velocal.adjustment.unit.predict`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.unit.predict import UnitSizes, predict_unit
from velocal.adjustment.unit.result import NAMES, UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import UnitStation
from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.evaluation.point_uncertainty import Use, point_std
from velocal.geometry.planes import Patch
from velocal.reduction.assignment import Limits, assigned_rows
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.models import AZIMUTH_TICK_DEG, AZIMUTH_TICKS, Scanner
from velocal.scanner.parameters import LaserParameters
from velocal.survey.station import Station

#: Share that the data decide below which a parameter is weakly determined.
WEAK = 0.5
#: Spreads that units typically have: standard deviations of true minus factory values.
_SPREAD = {
    "dl": 0.015,
    "alpha": float(np.deg2rad(0.07)),
    "v": float(np.deg2rad(0.07)),
    "hoff": 0.0005,
    "plane": 0.0002,
    "common": 0.002,
}
#: The same of the range scale, and of the error at the far point where there is one, metres.
_SCALE, _FAR_M = 3e-4, 0.01
#: Standard deviations of the pattern along azimuth and of a median, metres: of scanners that the
#: factory measures one by one, and of the others.
_PATTERN_M, _MEDIAN_M = (0.005, 0.003), (0.007, 0.005)
_LENGTH_RAD = float(np.deg2rad(0.9))


def typical_sizes(
    scanner: Scanner,
    settings: UnitSettings,
    *,
    spread: Mapping[str, float] | None = None,
    pattern_m: float | None = None,
    median_m: float | None = None,
    length_rad: float | None = None,
) -> UnitSizes:
    """Sizes that an adjustment typically finds, where nothing better is known.

    Parameters
    ----------
    scanner : Scanner
    settings : UnitSettings
    spread : mapping of str to float, optional
        What is known of the spreads; see `UnitSizes`.
    pattern_m, median_m, length_rad : float, optional
        What is known of the noise.

    Returns
    -------
    UnitSizes
        The adjustment will have to learn them.
    """
    kind = 0 if scanner.has_factory_file else 1
    scale = _SCALE if settings.far_point_m is None else _FAR_M
    return UnitSizes(
        spread={**_SPREAD, "scale": scale, "shift": settings.shift_m, **(spread or {})},
        tau_m=np.array(pattern_m or _PATTERN_M[kind]),
        omega_m=np.array(median_m or _MEDIAN_M[kind]),
        length_rad=length_rad or _LENGTH_RAD,
    )


@dataclass(frozen=True)
class Setup:
    """A station of a plan.

    Attributes
    ----------
    station : Station
    windows : int
        Windows that will be recorded there; each gives one median per laser and azimuth bin.
    flatness_m : float or None
        Of its planes; as the targets show it if None.
    """

    station: Station
    windows: int = 3
    flatness_m: float | None = None


@dataclass(frozen=True)
class Instrument:
    """The scanner of a plan, and how its recordings will be used.

    Attributes
    ----------
    scanner : Scanner
    factory : LaserParameters
        The factory's file, or the design.
    settings : UnitSettings
    sizes : UnitSizes
        Sizes that the adjustment will find.
    limits : Limits
        Of the assignment of medians to planes.
    bin_ticks : int
        Width of an azimuth bin, 0.01 degree.
    range_m : float
        Range at which the standard deviation of a point is judged.
    """

    scanner: Scanner
    factory: LaserParameters
    settings: UnitSettings
    sizes: UnitSizes
    limits: Limits
    bin_ticks: int
    range_m: float = 10.0


@dataclass(frozen=True)
class Plan:
    """What the calibration of a unit on some stations will state.

    Attributes
    ----------
    unit : UnitCalibration
    planes : tuple of str
    medians : ndarray of int, shape (stations, lasers, planes)
        Medians of all windows; stations in the order of `unit.stations`.
    point_std_m : float
        Standard deviation of a point at the range of the `Instrument`, root mean square over all
        lasers: along the beam, across and up together.
    """

    unit: UnitCalibration
    planes: tuple[str, ...]
    medians: NDArray[np.int64]
    point_std_m: float

    @property
    def std(self) -> Array:
        """Standard deviations of dl, alpha and v, metres and radians, shape (lasers, 3)."""
        covariance = self.unit.calibration.covariance
        return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))

    @property
    def unobserved(self) -> NDArray[np.int64]:
        """Lasers that meet no plane."""
        return np.flatnonzero(~self.unit.calibration.observed)

    def weakly_determined(self, name: str) -> NDArray[np.int64]:
        """Observed lasers of which the data decide less than a half of a parameter."""
        share = self.unit.determined[:, NAMES.index(name)]
        return np.flatnonzero(self.unit.calibration.observed & (share < WEAK))

    def held(self, name: str) -> NDArray[np.int64]:
        """Observed lasers whose parameter will stay at the value of the factory."""
        lasers = [one.laser_id for one in self.unit.held if one.name == name]
        return np.array([k for k in lasers if self.unit.calibration.observed[k]], dtype=np.int64)

    def to_columns(self) -> dict[str, list[float] | list[int] | list[str]]:
        """Columns of a table with one row per laser: medians, standard deviations, shares."""
        unit, std = self.unit, self.std
        lasers = len(std)
        found: dict[str, list[float] | list[int] | list[str]] = {"laser_id": list(range(lasers))}
        for station, medians in zip(unit.stations, self.medians, strict=True):
            for plane, count in zip(self.planes, medians.T, strict=True):
                found[f"medians_{station.name}_{plane}"] = count.tolist()
        found["mean_range_m"] = unit.mean_range_m.tolist()
        for number, (name, factor, suffix) in enumerate(
            (("dl", 1e3, "mm"), ("alpha", _PER_RAD, "deg"), ("v", _PER_RAD, "deg"))
        ):
            found[f"{name}_std_{suffix}"] = (factor * std[:, number]).tolist()
            found[f"{name}_from_data"] = unit.determined[:, number].tolist()
        weak = {name: set(self.weakly_determined(name).tolist()) for name in NAMES}
        held = {name: set(self.held(name).tolist()) for name in NAMES}
        for key, names in (("weakly_determined", weak), ("stays_with_factory", held)):
            found[key] = [" ".join(n for n in NAMES if k in names[n]) for k in range(lasers)]
        return found


_PER_RAD = 180.0 / np.pi


@dataclass(frozen=True)
class Judged:
    """A candidate.

    Attributes
    ----------
    name : str
    alone : Plan or None
        With this station only; None if its lasers meet no plane.
    beside : Plan or None
        With this station beside the given ones; None without given ones.
    """

    name: str
    alone: Plan | None
    beside: Plan | None

    @property
    def plan(self) -> Plan | None:
        """What the candidate is judged by."""
        return self.beside or self.alone

    @property
    def score_m(self) -> float:
        """Standard deviation of a point; infinite where nothing is met."""
        return self.plan.point_std_m if self.plan else float("inf")


def expected_medians(
    parameters: LaserParameters, patches: Sequence[Patch], scanner: Scanner, bin_ticks: int
) -> Beams:
    """Medians of one window, with the distance to the first plane that each beam meets.

    Parameters
    ----------
    parameters : LaserParameters
    patches : sequence of Patch
        Scanner frame. What stands before them is not known.
    scanner : Scanner
    bin_ticks : int
        Width of an azimuth bin, 0.01 degree.

    Returns
    -------
    Beams
        Raw distances; beams that meet no plane within the range of the scanner are left out.
    """
    steps = AZIMUTH_TICKS // bin_ticks
    phi = np.deg2rad((np.arange(steps) + 0.5) * bin_ticks * AZIMUTH_TICK_DEG)
    laser = np.repeat(np.arange(len(parameters)), steps)
    angle = np.tile(phi, len(parameters))
    direction, origin = laser_beams(angle, laser, parameters)
    nearest = np.full(len(angle), np.inf)
    for patch in patches:
        towards = direction @ patch.plane.normal
        with np.errstate(divide="ignore", invalid="ignore"):
            length = -(origin @ patch.plane.normal + patch.plane.offset) / towards
        ahead = np.flatnonzero((length > 0.0) & (length < np.minimum(nearest, scanner.max_range_m)))
        hit = origin[ahead] + length[ahead, None] * direction[ahead]
        met = ahead[patch.contains(hit)]
        nearest[met] = length[met]
    met = np.flatnonzero(np.isfinite(nearest))
    return Beams(
        nearest[met] - parameters.dl[laser[met]], angle[met], laser[met], scanner.distance_tick_m
    )


def expected_station(setup: Setup, instrument: Instrument) -> UnitStation:
    """Station of the adjustment with the observations that are expected.

    Parameters
    ----------
    setup : Setup
    instrument : Instrument

    Returns
    -------
    UnitStation
    """
    station, factory = setup.station, instrument.factory
    beams = expected_medians(factory, station.patches, instrument.scanner, instrument.bin_ticks)
    rows = assigned_rows(beams, factory, station.patches, instrument.limits)
    rows = {name: np.tile(column, setup.windows) for name, column in rows.items()}
    found = station.of_unit(station.observations(rows))
    if setup.flatness_m is None:
        return found
    flatness = np.full(len(station.patches), setup.flatness_m)
    return replace(found, survey=replace(found.survey, flatness_m=flatness))


def plan_unit(setups: Sequence[Setup], instrument: Instrument) -> Plan:
    """State what the calibration of a unit on some stations will state.

    Parameters
    ----------
    setups : sequence of Setup
    instrument : Instrument

    Returns
    -------
    Plan

    Raises
    ------
    SurveyError
        If no beam meets a plane.
    """
    stations = [expected_station(setup, instrument) for setup in setups]
    if not any(len(station.observations.phi) for station in stations):
        raise SurveyError(
            "no laser meets a plane",
            where=", ".join(station.name for station in stations),
            hint="Look whether the heights, headings and tilts of the stations are right.",
        )
    stations.sort(key=lambda station: station.name)
    unit = predict_unit(stations, instrument.factory, instrument.settings, instrument.sizes)
    planes = tuple(dict.fromkeys(name for each in stations for name in each.plane_names))
    lasers = len(instrument.factory)
    medians = np.zeros((len(stations), lasers, len(planes)), dtype=np.int64)
    for number, each in enumerate(stations):
        place = np.array([planes.index(name) for name in each.plane_names])
        data = each.observations
        np.add.at(medians[number], (data.laser_id, place[data.plane_number]), 1)
    std = point_std(unit, np.arange(lasers), np.full(lasers, instrument.range_m), Use.PARAMETERS)
    square = np.mean(std.along**2 + std.across**2 + std.up**2)
    return Plan(unit, planes, medians, float(np.sqrt(square)))


def judge(
    given: Sequence[Setup],
    candidates: Sequence[Setup],
    instrument: Instrument,
    done: Callable[[], None] = lambda: None,
) -> tuple[Judged, ...]:
    """Compare candidates for a station, each alone and beside the given stations.

    Parameters
    ----------
    given : sequence of Setup
        Stations that will be used anyway; may be empty.
    candidates : sequence of Setup
    instrument : Instrument
    done : callable
        Is called after every candidate.

    Returns
    -------
    tuple of Judged
        The best first: that with the smallest standard deviation of a point.
    """
    found = []
    for candidate in candidates:
        alone = beside = None
        if len(expected_station(candidate, instrument).observations.phi):
            alone = plan_unit([candidate], instrument)
            beside = plan_unit([*given, candidate], instrument) if given else None
        found.append(Judged(candidate.station.position, alone, beside))
        done()
    return tuple(sorted(found, key=lambda each: each.score_m))
