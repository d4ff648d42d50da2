"""Points of firings, computed in single precision from four constants of each laser.

Equations (1) to (3) are linear in the raw distance. With the horizontal coordinates as one complex
number Y + i X, the head turns a point by a factor:

    Y + i X = exp(i phi) (W1 tick + W0)        Z = R1 tick + R0

    W1 = tick_m cos(v) exp(-i alpha)           W0 = (dl cos(v) - i hoff) exp(-i alpha)
    R1 = tick_m sin(v)                         R0 = dl sin(v) + voff

so that the factor is looked up once for each firing, and the distance between the points of two
calibrations does not depend on phi. Single precision: within a few hundredths of a millimetre at
100 m.

Near-point corrections (`velocal.calibration.dialects.TwoPoint`) move a point along its beam, X and
Y by lengths of their own, which are linear in X and Y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.calibration.applied import AppliedCalibration, applied
from velocal.calibration.dialects import NEAR_X_M, NEAR_Y_M, TwoPoint
from velocal.calibration.files.document import CalibrationFile
from velocal.capture.source import ANY_SOURCE, SourceFilter
from velocal.packets.firings import Firings
from velocal.scanner.models import AZIMUTH_TICK_DEG, AZIMUTH_TICKS, Scanner
from velocal.scanner.parameters import FAR_POINT_M, LaserParameters

Columns = dict[str, NDArray[Any]]
_Floats = NDArray[np.float32]
_Complex = NDArray[np.complex64]

_TURN = np.exp(1j * np.deg2rad(np.arange(AZIMUTH_TICKS) * AZIMUTH_TICK_DEG)).astype(np.complex64)


@dataclass(frozen=True)
class Settings:
    """What is made of a recording.

    Attributes
    ----------
    scanner : Scanner
    parameters : CalibrationFile or LaserParameters
        Calibration; a file is applied by its own dialect.
    before : CalibrationFile, LaserParameters or None
        Another calibration; gives the column ``shift``.
    min_range_m, max_range_m : float
        Limits of the calibrated distance.
    frame : {"velocal", "ros"}
        Y forward and X right, as everywhere here, or X forward and Y left.
    returns : {"strongest", "last", "both"}
        Which return, where a shot has two.
    source : SourceFilter
        Which of several scanners of the recording, as when it was inspected.
    """

    scanner: Scanner
    parameters: CalibrationFile | LaserParameters
    before: CalibrationFile | LaserParameters | None = None
    min_range_m: float = -np.inf
    max_range_m: float = np.inf
    frame: str = "velocal"
    returns: str = "strongest"
    source: SourceFilter = ANY_SOURCE


@dataclass(frozen=True)
class _Lines:
    """Points as lines along the beams; its arrays have one row per bank of lasers.

    Attributes
    ----------
    slope, start : ndarray of complex64, shape (banks, width)
        W1 and W0.
    slope_z, start_z : ndarray of float32, shape (banks, width)
        R1 and R0.
    """

    slope: _Complex
    start: _Complex
    slope_z: _Floats
    start_z: _Floats

    @classmethod
    def rounded(cls, constants: Sequence[NDArray[Any]], width: int) -> _Lines:
        """W1, W0, R1 and R0 by laser, in single precision."""
        kinds = (np.complex64, np.complex64, np.float32, np.float32)
        pairs = zip(constants, kinds, strict=True)
        return cls(*(each.astype(kind).reshape(-1, width) for each, kind in pairs))

    def points(self, ticks: _Floats, bank: NDArray[np.intp]) -> tuple[_Complex, _Floats]:
        """Y + i X at rotational angle 0, and Z, of raw distances, shape (n, width)."""
        # In place and without broadcasting: these cost more than the arithmetic.
        horizontal = self.slope.take(bank, axis=0)
        horizontal *= ticks.astype(np.complex64)
        horizontal += self.start.take(bank, axis=0)
        z = self.slope_z.take(bank, axis=0)
        z *= ticks
        z += self.start_z.take(bank, axis=0)
        return horizontal, z


def _constants(parameters: LaserParameters, rotated: Array, tick_m: float) -> list[NDArray[Any]]:
    """W1, W0, R1 and R0 of every laser, which fires after the head has `rotated`."""
    v, beam = parameters.v, np.exp(1j * (rotated - parameters.alpha))
    return [
        tick_m * np.cos(v) * beam,
        (parameters.dl * np.cos(v) - 1j * parameters.hoff) * beam,
        tick_m * np.sin(v),
        parameters.dl * np.sin(v) + parameters.voff,
    ]


class _NearPoints:
    """Near-point corrections of a calibration; lengths along beams are in ticks, as distances."""

    def __init__(self, use: AppliedCalibration, two_point: TwoPoint, width: int) -> None:
        tick_m = use.scanner.distance_tick_m
        effective = use.dialect.effective(use.parameters, use.scanner)
        dl = effective.dl
        near_x, near_y = use.dialect.near(effective)
        # By what a point moves along its beam for each metre that it is nearer than the far point.
        per_metre = (
            (near_x - dl) / (FAR_POINT_M - NEAR_X_M),
            (near_y - dl) / (FAR_POINT_M - NEAR_Y_M),
        )
        self.dl, self.by_x, self.by_y = (
            (each / tick_m).astype(np.float32).reshape(-1, width) for each in (dl, *per_metre)
        )
        self.with_offsets, self.z_is_mean = two_point.with_offsets, two_point.z == "mean"
        self.limit = np.float32(two_point.limit_m / tick_m)

    def move(
        self,
        points: tuple[_Complex, _Floats],
        lines: _Lines,
        ticks: _Floats,
        bank: NDArray[np.intp],
        turn: _Complex,
    ) -> None:
        """Add the corrections to points, shape (n, width), that the head has turned by `turn`."""
        within = ticks <= self.limit
        if not within.any():
            return
        horizontal, z = points
        beam = lines.slope.take(bank, axis=0)
        beam *= turn
        corrected = ticks + self.dl.take(bank, axis=0)
        along = []
        for part, of_beam, per_metre in (
            (horizontal.imag, beam.imag, self.by_x),
            (horizontal.real, beam.real, self.by_y),
        ):
            at = np.abs(part if self.with_offsets else of_beam * corrected)
            further = np.subtract(np.float32(FAR_POINT_M), at, out=at)
            further *= per_metre.take(bank, axis=0)
            if not within.all():
                further *= within
            part += further * of_beam
            along.append(further)
        further_z = (along[0] + along[1]) / 2 if self.z_is_mean else along[1]
        further_z *= lines.slope_z.take(bank, axis=0)
        z += further_z


class Lasers:
    """Constants of all lasers, by bank.

    Parameters
    ----------
    settings : Settings
    rate_hz : float
        Rotation rate.
    """

    def __init__(self, settings: Settings, rate_hz: float) -> None:
        scanner = settings.scanner
        width, tick_m = scanner.lasers_per_firing, scanner.distance_tick_m
        delay_s = scanner.azimuth_delay_s
        calibrations = [settings.parameters, settings.before]
        uses = [applied(each, scanner, rate_hz) for each in calibrations if each is not None]
        rotated = 2.0 * np.pi * rate_hz * delay_s
        constants = [_constants(use.model, rotated, tick_m) for use in uses]
        self._lines = [_Lines.rounded(each, width) for each in constants]
        self._near = [
            _NearPoints(use, use.dialect.two_point, width)
            if use.has_near_points and use.dialect.two_point is not None
            else None
            for use in uses
        ]
        #: Lines from the points of one calibration to those of the other, where these are lines.
        self._between: _Lines | None = None
        if len(uses) == 2 and self._near == [None, None]:
            apart = [one - other for one, other in zip(*constants, strict=True)]
            self._between = _Lines.rounded(apart, width)
        self.delay_s = delay_s.reshape(-1, width)
        self.laser_id = np.arange(scanner.n_lasers, dtype=np.uint8).reshape(-1, width)
        dl = uses[0].model.dl
        lowest = np.ceil((settings.min_range_m - dl) / tick_m)
        highest = np.floor((settings.max_range_m - dl) / tick_m)
        # 0 is no return.
        self._lowest = np.maximum(lowest, 1.0).astype(np.float32).reshape(-1, width)
        self._highest = highest.astype(np.float32).reshape(-1, width)
        self._unlimited = bool((self._lowest == 1.0).all() and np.isinf(self._highest).all())

    def used(self, distance: NDArray[np.uint16], bank: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether raw distances, shape (n, width), are returns within the limits of range."""
        if self._unlimited:
            return distance > 0
        within = distance >= self._lowest.take(bank, axis=0)
        return within & (distance <= self._highest.take(bank, axis=0))

    def points(
        self, ticks: _Floats, bank: NDArray[np.intp], turn: _Complex
    ) -> tuple[_Complex, _Floats, _Floats | None]:
        """Y + i X, Z and shift of raw distances, shape (n, width), at rotations of the head."""
        horizontal, z = self._turned(0, ticks, bank, turn)
        if len(self._lines) == 1:
            return horizontal, z, None
        if self._between is not None:
            across, up = self._between.points(ticks, bank)
        else:
            across, up = self._turned(1, ticks, bank, turn)
            across -= horizontal
            up -= z
        up *= up
        up += across.real**2
        up += across.imag**2
        return horizontal, z, np.sqrt(up, out=up)

    def _turned(
        self, number: int, ticks: _Floats, bank: NDArray[np.intp], turn: _Complex
    ) -> tuple[_Complex, _Floats]:
        """Points with one of the two calibrations."""
        lines, near = self._lines[number], self._near[number]
        horizontal, z = lines.points(ticks, bank)
        horizontal *= turn
        if near is not None:
            near.move((horizontal, z), lines, ticks, bank, turn)
        return horizontal, z


def place(
    firings: Firings,
    rotation: NDArray[np.int64],
    time_s: Array,
    lasers: Lasers,
    frame: str,
) -> Columns:
    """Compute the points of those returns of firings that are within the limits of range.

    Parameters
    ----------
    firings : Firings
        n firings.
    rotation : ndarray of int, shape (n,)
        Rotation of every firing; -1 for one that is left out.
    time_s : ndarray, shape (n,)
        When it began.
    lasers : Lasers
        Constants of the lasers.
    frame : {"velocal", "ros"}
        Frame of the coordinates.

    Returns
    -------
    dict of str to ndarray, shape (m,)
        Columns as `velocal.points.stream.stream` gives them.
    """
    bank = (firings.first_laser // 32).astype(np.intp)
    used = lasers.used(firings.distance, bank)
    if rotation.min(initial=0) < 0:
        used &= (rotation >= 0)[:, None]
    # A firing's values are repeated as often as it has points: half the time of any index.
    count = _counted(used)
    ticks = firings.distance.astype(np.float32)
    turn = np.repeat(_TURN[firings.azimuth], used.shape[1]).reshape(used.shape)
    horizontal, z, shift = lasers.points(ticks, bank, turn)
    right, forward = horizontal.imag[used], horizontal.real[used]
    x, y = (right, forward) if frame == "velocal" else (forward, np.negative(right))
    columns: Columns = {
        "x": x,
        "y": y,
        "z": z[used],
        "intensity": firings.intensity[used],
        "laser_id": lasers.laser_id.take(bank, axis=0)[used],
        "rotation": np.repeat(rotation.astype(np.uint32), count),
        "time": np.repeat(time_s, count),
    }
    if lasers.delay_s.any():
        columns["time"] += lasers.delay_s.take(bank, axis=0)[used]
    if shift is not None:
        columns["shift"] = shift[used]
    return columns


def _counted(used: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Number of true values in each row."""
    together = 8 if used.shape[1] % 8 == 0 else 1
    # Eight of them as one number: a tenth of the time of `count_nonzero`.
    eights = used.view(np.dtype(f"u{together}"))
    return np.asarray(sum(np.bitwise_count(eights).T))
