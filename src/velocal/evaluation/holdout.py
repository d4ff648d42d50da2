"""Hold-out: a calibration is judged on a part of the data that it was not adjusted on.

The parts are the stations of a unit. Where there is one station only, they are its planes; these
share the pose of the scanner, so that they are a weaker check.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from statistics import NormalDist
from typing import Any

import numpy as np

from velocal.adjustment.observations import Observations
from velocal.adjustment.unit.result import UnitCalibration
from velocal.adjustment.unit.station import UnitStation
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.evaluation.statistics import laser_rms
from velocal.scanner.parameters import LaserParameters

#: Confidence of the interval that decides.
LEVEL = 0.95
#: Half the width of such an interval of a normal distribution, in standard deviations.
QUANTILE = NormalDist().inv_cdf(0.5 + LEVEL / 2.0)
#: Calibrates a unit on some stations.
Calibrate = Callable[[Sequence[UnitStation]], LaserParameters]


class Verdict(StrEnum):
    """What a hold-out says of a calibration."""

    BETTER = "better"  #: residuals of what was held out are smaller than with the factory's values
    NO_DIFFERENCE = "no difference shown"
    WORSE = "worse"  #: they are larger
    NOT_JUDGED = "not judged"  #: nothing could be held out


#: Why a calibration is not recommended.
_WHY = {
    Verdict.NO_DIFFERENCE: "it is not shown to be better than the factory's on what was held out",
    Verdict.WORSE: "it is worse than the factory's on what was held out",
    Verdict.NOT_JUDGED: "nothing could be held out to judge it: there is one plane only",
}


@dataclass(frozen=True)
class Gain:
    """By how much residuals have become smaller, as a mean over the lasers.

    Attributes
    ----------
    before_m, after_m : float
        Root mean square of s, mean over the lasers.
    gain_m : float
        Their difference; positive where the calibration is better.
    low_m, high_m : float
        Confidence interval of the difference (`LEVEL`), from its scatter between the lasers.
    lasers : int
        Number of lasers that the part has residuals of.
    """

    before_m: float
    after_m: float
    gain_m: float
    low_m: float
    high_m: float
    lasers: int


@dataclass(frozen=True)
class HeldOut:
    """One part that was held out.

    Attributes
    ----------
    station, plane : str
        Its name; `plane` is empty where a whole station was held out.
    total : Gain
        Of the residuals s as they are. They contain the errors of the survey of this part.
    centred : Gain
        Of the residuals without what all lasers have in common on a plane: the error of its
        survey, and of the pose.
    """

    station: str
    plane: str
    total: Gain
    centred: Gain


@dataclass(frozen=True)
class HoldOut:
    """Result of all parts.

    Attributes
    ----------
    parts : tuple of HeldOut
        Each was left out once; empty where nothing could be held out.
    total, centred : Gain or None
        Over all parts together; None without parts.
    """

    parts: tuple[HeldOut, ...]
    total: Gain | None
    centred: Gain | None

    @property
    def by(self) -> str:
        """Kind of the parts: station or plane."""
        return "plane" if any(part.plane for part in self.parts) else "station"

    @property
    def verdict(self) -> Verdict:
        """What the parts say together.

        The centred residuals decide whether a calibration is better, because the errors of the
        survey of a part are not errors of the lasers. It is worse if the residuals as they are
        have become larger.
        """
        if self.centred is None or self.total is None:
            return Verdict.NOT_JUDGED
        if self.centred.high_m < 0.0 or self.total.high_m < 0.0:
            return Verdict.WORSE
        return Verdict.BETTER if self.centred.low_m > 0.0 else Verdict.NO_DIFFERENCE


@dataclass(frozen=True)
class JudgedCalibration:
    """Calibration of a unit, and what the hold-out says of it.

    Attributes
    ----------
    unit : UnitCalibration
        Adjusted on all data.
    hold_out : HoldOut
    near_m : ndarray, shape (lasers,)
        What the near-point corrections of the factory's file add to the distances of a laser, mean
        over its observations. The corrections of `unit` come on top of them. Zeros where the file
        has none, or where they are left out as in the paper.
    """

    unit: UnitCalibration
    hold_out: HoldOut
    near_m: Array

    @property
    def single(self) -> LaserParameters:
        """Parameters with one distance correction, which holds at the ranges of the calibration."""
        return self.unit.calibration.adjusted.corrected({"dl": self.near_m})

    @property
    def recommended(self) -> bool:
        """Whether files for programs contain the adjusted values, not those of the factory."""
        return self.hold_out.verdict is Verdict.BETTER

    @property
    def headline(self) -> str:
        """Verdict in a few words: what the end of a run says."""
        total = self.hold_out.total
        numbers = (
            f" (root mean square {total.before_m * 100:.2f} -> {total.after_m * 100:.2f} cm)"
            if total
            else ""
        )
        return f"{self.hold_out.verdict.value} on what was held out{numbers}"

    def summary(self) -> str:
        """Describe the calibration and its hold-out in a few lines for people."""
        lines = [self.unit.calibration.summary()]
        total, centred = self.hold_out.total, self.hold_out.centred
        if total and centred:
            lines.append(
                f"held out ({len(self.hold_out.parts)} x one {self.hold_out.by}): root mean square "
                f"of s {total.before_m * 100:.2f} -> {total.after_m * 100:.2f} cm; without what "
                f"all lasers share {centred.before_m * 100:.2f} -> {centred.after_m * 100:.2f} cm, "
                f"gain {centred.gain_m * 100:.2f} ({centred.low_m * 100:.2f} to "
                f"{centred.high_m * 100:.2f}) cm"
            )
        lines.append(f"on what was held out: {self.hold_out.verdict.value}")
        return "\n".join([*lines, *self.unit.warnings])


def hold_out(
    stations: Sequence[UnitStation], factory: LaserParameters, calibrate: Calibrate
) -> HoldOut:
    """Leave out every station, or every plane of the only one, and judge the rest on it.

    Parameters
    ----------
    stations : sequence of UnitStation
        All data of a unit.
    factory : LaserParameters
        Calibration that the results are compared with.
    calibrate : callable
        Calibrates a unit on some of the stations.

    Returns
    -------
    HoldOut
    """
    residuals = []
    parts = []
    for kept, station, plane, data in _splits(stations):
        found = calibrate(kept)
        s = [data.misclosure(parameters) for parameters in (factory, found)]
        shown = [laser_rms(each, data.laser_id, len(factory)) for each in s]
        centred = [laser_rms(_centred(data, each), data.laser_id, len(factory)) for each in s]
        residuals.append((shown, centred))
        parts.append(HeldOut(station, plane, _gain([shown]), _gain([centred])))
    if not parts:
        return HoldOut((), None, None)
    return HoldOut(
        tuple(parts), _gain([shown for shown, _ in residuals]), _gain([own for _, own in residuals])
    )


def judge(found: Mapping[str, JudgedCalibration]) -> str:
    """Put the verdicts on calibrations into words.

    Parameters
    ----------
    found : mapping of str to JudgedCalibration
        By the name that the text gives them.

    Returns
    -------
    str
        One paragraph per calibration.

    Raises
    ------
    VelocalError
        If a calibration is not better on what was held out.
    """
    for name, each in found.items():
        if not each.recommended:
            raise VelocalError(
                f"{_WHY[each.hold_out.verdict]}\n{each.summary()}",
                where=f"calibration {name}",
                hint="Keep the factory's file: the files for programs contain its values. The "
                "report shows what was held out; docs/how-to.md tells what a survey needs.",
            )
    return "\n".join(f"{name}: {each.summary()}\n" for name, each in found.items())


def to_columns(found: HoldOut) -> dict[str, list[Any]]:
    """Columns of a table of all parts, and of all parts together in the last row.

    Parameters
    ----------
    found : HoldOut

    Returns
    -------
    dict of str to list
        Centimetres.
    """
    rows: list[dict[str, Any]] = []
    parts = [(part.station, part.plane, part.total, part.centred) for part in found.parts]
    if found.total and found.centred:
        parts.append(("all", "", found.total, found.centred))
    for station, plane, total, centred in parts:
        row: dict[str, Any] = {"station": station, "plane": plane, "lasers": total.lasers}
        for name, gain in (("total", total), ("centred", centred)):
            row |= {
                f"{name}_before_cm": gain.before_m * 1e2,
                f"{name}_after_cm": gain.after_m * 1e2,
                f"{name}_gain_cm": gain.gain_m * 1e2,
                f"{name}_gain_low_cm": gain.low_m * 1e2,
                f"{name}_gain_high_cm": gain.high_m * 1e2,
            }
        rows.append(row | {"verdict": found.verdict.value if station == "all" else ""})
    names = list(rows[0]) if rows else ["station", "plane", "lasers", "verdict"]
    return {name: [row[name] for row in rows] for name in names}


def _splits(
    stations: Sequence[UnitStation],
) -> list[tuple[list[UnitStation], str, str, Observations]]:
    """What is kept, and the station and plane that are held out with their observations."""
    if len(stations) > 1:
        return [
            ([*stations[:i], *stations[i + 1 :]], each.name, "", each.observations)
            for i, each in enumerate(stations)
        ]
    found = []
    for only in stations:
        number = only.observations.plane_number
        for plane, name in enumerate(only.plane_names):
            own = number == plane
            if own.any() and not own.all():
                rest = replace(only, observations=only.observations.take(~own))
                found.append(([rest], only.name, name, only.observations.take(own)))
    return found


def _centred(data: Observations, s: Array) -> Array:
    """Residuals minus the mean over the lasers of the means of every laser, by plane."""
    found = s.copy()
    for plane in np.unique(data.plane_number):
        own = data.plane_number == plane
        count = np.bincount(data.laser_id[own])
        seen = count > 0
        means = np.bincount(data.laser_id[own], s[own])[seen] / count[seen]
        found[own] -= means.mean()
    return found


def _gain(pairs: Sequence[Sequence[Array]]) -> Gain:
    """Mean over the lasers of the mean over the parts, with its interval."""
    before, after = (
        np.array([[pair[i][laser] for pair in pairs] for laser in range(len(pairs[0][0]))])
        for i in (0, 1)
    )
    seen = np.isfinite(before).any(axis=1)
    before, after = (np.nanmean(each[seen], axis=1) for each in (before, after))
    gain, n = before - after, int(seen.sum())
    half = np.inf
    if n > 1:
        from scipy.special import stdtrit  # here: many jobs import this module, few need it

        half = float(stdtrit(n - 1, 0.5 + LEVEL / 2.0) * gain.std(ddof=1) / np.sqrt(n))
    mean = float(gain.mean())
    return Gain(float(before.mean()), float(after.mean()), mean, mean - half, mean + half, n)
