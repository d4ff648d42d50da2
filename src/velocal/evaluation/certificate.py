"""Certificate of a calibration in the sense of the GUM: results, uncertainty, traceability.

GUM: JCGM 100:2008, *Evaluation of measurement data. Guide to the expression of uncertainty in
measurement*. Expanded uncertainties have the coverage factor k = 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from velocal.adjustment.unit.result import NAMES, Component
from velocal.arrays import Array
from velocal.evaluation.holdout import Gain, JudgedCalibration
from velocal.evaluation.point_uncertainty import Use, point_std

#: Coverage factor of expanded uncertainties.
COVERAGE_FACTOR = 2.0
#: Ranges for which the uncertainty of points is stated, metres.
RANGES_M = (2.0, 5.0, 10.0, 25.0, 50.0)
#: What a source of uncertainty is, in words.
SOURCES = {
    "noise": "noise of the distances, correlated along the azimuth",
    "prior": "what the data do not determine; its size is learnt from the lasers of the unit",
    "offsets": "errors of the offsets of the beams, which are not corrected",
    "shift": "shifts of the distances of a laser from one station to another",
    "pose": "targets on the base of the scanner, through the pose of every station",
    "planes": "targets on walls and floor",
    "flatness": "deviations of walls and floor from planes",
    "population": "standard deviations of the unit, which are estimated",
}
_MM, _DEG = 1e3, 180.0 / np.pi
#: Parameters with the unit in which they are stated.
_COLUMNS = tuple(zip(NAMES, ("mm", "deg", "deg"), strict=True))


@dataclass(frozen=True)
class File:
    """A file that the calibration was made from.

    Attributes
    ----------
    role, name : str
        What it is, and its name.
    sha256 : str
        Digest of its content.
    """

    role: str
    name: str
    sha256: str


@dataclass(frozen=True)
class Budget:
    """One source of uncertainty: standard uncertainties, root mean square over the lasers.

    Attributes
    ----------
    source, description : str
    dl_mm, alpha_deg, v_deg : float
    """

    source: str
    description: str
    dl_mm: float
    alpha_deg: float
    v_deg: float


@dataclass(frozen=True)
class Laser:
    """Result of one laser.

    Attributes
    ----------
    laser : int
        Counted from 1.
    dl_mm, alpha_deg, v_deg : float
        Corrections to the values of the factory.
    dl_expanded_mm, alpha_expanded_deg, v_expanded_deg : float
        Expanded uncertainties.
    dl_from_data, alpha_from_data, v_from_data : float
        Share that the data decided; the rest comes from what is known of the unit.
    range_m : float
        Range at which the correction of the distance holds.
    """

    laser: int
    dl_mm: float
    alpha_deg: float
    v_deg: float
    dl_expanded_mm: float
    alpha_expanded_deg: float
    v_expanded_deg: float
    dl_from_data: float
    alpha_from_data: float
    v_from_data: float
    range_m: float


@dataclass(frozen=True)
class Points:
    """Expanded uncertainty of points, root mean square over the lasers.

    Attributes
    ----------
    range_m : float
    use : str
        What it is for; a value of `Use`.
    along_mm, across_mm, up_mm : float
        In the direction of the beam, horizontal and at right angles to it, at right angles to both.
    extrapolated : bool
        Whether the range is outside those of the calibration.
    """

    range_m: float
    use: str
    along_mm: float
    across_mm: float
    up_mm: float
    extrapolated: bool


@dataclass(frozen=True)
class Property:
    """A property of the unit, with its interval of 90 %, in the unit of its name.

    Attributes
    ----------
    name : str
    value, low, high : float
    learnt : bool
        Whether it was estimated from the data.
    """

    name: str
    value: float
    low: float
    high: float
    learnt: bool


@dataclass(frozen=True)
class Conditions:
    """What is known of a recording.

    Attributes
    ----------
    sample, position : str
    rotations : int
    rotation_rate_hz : float
    firmware, time : str
        As the packets tell them; empty if they do not.
    temperature_deg_c : tuple of float
        Lowest and highest temperature of the scanner; empty if the packets do not tell it.
    """

    sample: str
    position: str
    rotations: int
    rotation_rate_hz: float
    firmware: str
    time: str
    temperature_deg_c: tuple[float, ...]

    @classmethod
    def of(cls, sample: str, position: str, ledger: Mapping[str, Any]) -> Conditions:
        """Conditions out of the ledger of a recording.

        Parameters
        ----------
        sample, position : str
        ledger : mapping
            Content of ``recordings/{sample}/ledger.json``.
        """
        status = ledger.get("status") or {}
        return cls(
            sample,
            position,
            int(ledger["rotations_complete"]),
            float(ledger["rotation_rate_hz"]),
            str(status.get("firmware") or ""),
            str(status.get("gps_time") or ""),
            tuple(status.get("temperature_deg_c") or ()),
        )


@dataclass(frozen=True)
class StationResult:
    """What the adjustment found of a station.

    Attributes
    ----------
    name : str
    observations : int
    shift_mm, shift_expanded_mm : float
        Shift that the distances of all lasers have in common there.
    pose_in_std : float
        Length of the correction of the pose, in units of its standard deviation from the survey;
        values above 4 are suspicious.
    """

    name: str
    observations: int
    shift_mm: float
    shift_expanded_mm: float
    pose_in_std: float


@dataclass(frozen=True)
class Certificate:
    """Certificate of one calibration.

    Attributes
    ----------
    scanner, serial, name : str
        Model, serial number (empty if not given), and name of the calibration.
    simulated : bool
        Whether the recordings are simulated.
    recommended : bool
        Whether the calibration is better than the factory's on what was held out.
    verdict : str
    held_out_total, held_out_centred : Gain or None
        Residuals of what was held out; see `HoldOut`.
    coverage_factor : float
    ranges_m : tuple of float
        Shortest and longest range of the calibration.
    far_point_m : float or None
        Range from which on the distance correction is that of the factory.
    recordings : tuple of Conditions
    budget : tuple of Budget
        By source; the last row is the total.
    stations : tuple of StationResult
    lasers : tuple of Laser
    points : tuple of Points
    properties : tuple of Property
    files : tuple of File
    versions : mapping of str to str
    warnings : tuple of str
    """

    scanner: str
    serial: str
    name: str
    simulated: bool
    recommended: bool
    verdict: str
    held_out_total: Gain | None
    held_out_centred: Gain | None
    coverage_factor: float
    ranges_m: tuple[float, ...]
    far_point_m: float | None
    recordings: tuple[Conditions, ...]
    budget: tuple[Budget, ...]
    stations: tuple[StationResult, ...]
    lasers: tuple[Laser, ...]
    points: tuple[Points, ...]
    properties: tuple[Property, ...]
    files: tuple[File, ...]
    versions: Mapping[str, str]
    warnings: tuple[str, ...]

    def significant(self, name: str) -> int:
        """Lasers whose correction is larger than its expanded uncertainty.

        Parameters
        ----------
        name : str
            Parameter out of `NAMES`.
        """
        unit = dict(_COLUMNS)[name]
        return sum(
            abs(getattr(one, f"{name}_{unit}")) > getattr(one, f"{name}_expanded_{unit}")
            for one in self.lasers
        )

    def expanded(self, name: str) -> float:
        """Root mean square of the expanded uncertainties of a parameter over the lasers.

        Parameters
        ----------
        name : str
            Parameter out of `NAMES`; dl in millimetres, the others in degrees.
        """
        column = f"{name}_expanded_{dict(_COLUMNS)[name]}"
        return _root_mean_square(np.array([getattr(one, column) for one in self.lasers]))


def certificate(
    found: JudgedCalibration,
    *,
    scanner: str,
    serial: str,
    name: str,
    simulated: bool,
    recordings: Sequence[Conditions],
    files: Sequence[File],
    versions: Mapping[str, str],
) -> Certificate:
    """Put the certificate of a calibration together.

    Parameters
    ----------
    found : JudgedCalibration
    scanner, serial, name : str
        Model, serial number (empty if not known), name of the calibration.
    simulated : bool
        Whether the recordings are simulated.
    recordings : sequence of Conditions
    files : sequence of File
        Everything that the calibration was made from.
    versions : mapping of str to str
        Of the software.

    Returns
    -------
    Certificate
    """
    unit = found.unit
    return Certificate(
        scanner=scanner,
        serial=serial,
        name=name,
        simulated=simulated,
        recommended=found.recommended,
        verdict=found.hold_out.verdict.value,
        held_out_total=found.hold_out.total,
        held_out_centred=found.hold_out.centred,
        coverage_factor=COVERAGE_FACTOR,
        ranges_m=unit.range_limits_m,
        far_point_m=unit.far_point_m,
        recordings=tuple(recordings),
        budget=_budget(found),
        stations=tuple(
            StationResult(
                one.name,
                int(one.count.sum()),
                one.shift_m * _MM,
                COVERAGE_FACTOR * one.shift_std_m * _MM,
                one.pose_in_std,
            )
            for one in unit.stations
        ),
        lasers=_lasers(found),
        points=_points(found),
        properties=tuple(_property(one) for one in unit.population),
        files=tuple(files),
        versions=versions,
        warnings=unit.warnings,
    )


def _budget(found: JudgedCalibration) -> tuple[Budget, ...]:
    calibration = found.unit.calibration
    parts = {**calibration.sources, "total": calibration.covariance}
    rows = []
    for source, covariance in parts.items():
        dl, alpha, v = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0).mean(0))
        described = SOURCES.get(source, "all sources together")
        rows.append(
            Budget(source, described, float(dl) * _MM, float(alpha) * _DEG, float(v) * _DEG)
        )
    return tuple(rows)


def _lasers(found: JudgedCalibration) -> tuple[Laser, ...]:
    unit = found.unit
    size = np.array([_MM, _DEG, _DEG])
    values = unit.calibration.corrections * size
    expanded = COVERAGE_FACTOR * unit.calibration.std * size
    return tuple(
        Laser(
            laser=number + 1,
            **{
                f"{name}_{unit_of}": float(values[number, i])
                for i, (name, unit_of) in enumerate(_COLUMNS)
            },
            **{
                f"{name}_expanded_{unit_of}": float(expanded[number, i])
                for i, (name, unit_of) in enumerate(_COLUMNS)
            },
            **{
                f"{name}_from_data": float(unit.determined[number, i])
                for i, (name, _) in enumerate(_COLUMNS)
            },
            range_m=float(range_m),
        )
        for number, range_m in enumerate(unit.mean_range_m)
    )


def _points(found: JudgedCalibration) -> tuple[Points, ...]:
    lasers = np.arange(len(found.unit.calibration))
    rows = []
    for use in Use:
        for range_m in RANGES_M:
            std = point_std(found.unit, lasers, np.full(len(lasers), range_m), use)
            along, across, up = (
                COVERAGE_FACTOR * _MM * _root_mean_square(one)
                for one in (std.along, std.across, std.up)
            )
            outside = bool(std.extrapolated.any())
            rows.append(Points(range_m, use.value, along, across, up, outside))
    return tuple(rows)


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _property(one: Component) -> Property:
    ending, size = {"m": ("_mm", _MM), "rad": ("_deg", _DEG), "1": ("_mm_per_m", _MM)}[one.unit]
    return Property(
        one.name + ending, one.value * size, one.low * size, one.high * size, one.learnt
    )
