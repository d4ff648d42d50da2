"""Points of firings, computed in single precision from four constants of each laser.

Equations (1) to (3) are linear in the raw distance. With the horizontal coordinates as one complex
number X + i Y, the head turns a point by a factor:

    X + i Y = i exp(-i phi) (W1 tick + W0)     Z = R1 tick + R0

    W1 = tick_m cos(v) exp(i alpha)            W0 = (dl cos(v) + i hoff) exp(i alpha)
    R1 = tick_m sin(v)                         R0 = dl sin(v) + voff

so that the factor is looked up once for each firing, and the distance between the points of two
calibrations does not depend on phi. In the frame of ROS, X is forward and Y left: the factor is
exp(-i phi). Single precision: within a few hundredths of a millimetre at 100 m.

Near-point corrections (`velocal.calibration.dialects.TwoPoint`) move a point along its beam, X and
Y by lengths of their own, which are linear in X and Y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from velocal.arrays import Array, rows_of
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

#: Y forward and X right, as everywhere here; X forward and Y left, as in ROS.
FRAMES = ("velocal", "ros")
_TURN = np.exp(-1j * np.deg2rad(np.arange(AZIMUTH_TICKS) * AZIMUTH_TICK_DEG))
#: Factor of an azimuth by frame.
_TURNS = {
    frame: (factor * _TURN).astype(np.complex64)
    for frame, factor in zip(FRAMES, (1j, 1.0), strict=True)
}


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
    """Points as lines along the beams; its arrays have a row for each bank of lasers, or firing.

    Attributes
    ----------
    slope, start : ndarray of complex64, shape (n, width)
        W1 and W0.
    slope_z, start_z : ndarray of float32, shape (n, width)
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

    def points(self, ticks: _Floats) -> tuple[_Complex, _Floats]:
        """W1 tick + W0 and Z of raw distances of the firings, same shape."""
        # In place and without broadcasting: these cost more than the arithmetic.
        horizontal = ticks.astype(np.complex64)
        np.multiply(self.slope, horizontal, out=horizontal)
        horizontal += self.start
        z = self.slope_z * ticks
        z += self.start_z
        return horizontal, z


def _constants(parameters: LaserParameters, rotated: Array, tick_m: float) -> list[NDArray[Any]]:
    """W1, W0, R1 and R0 of every laser, which fires after the head has `rotated`."""
    v, beam = parameters.v, np.exp(-1j * (rotated - parameters.alpha))
    return [
        tick_m * np.cos(v) * beam,
        (parameters.dl * np.cos(v) + 1j * parameters.hoff) * beam,
        tick_m * np.sin(v),
        parameters.dl * np.sin(v) + parameters.voff,
    ]


@dataclass(frozen=True)
class _NearPoints:
    """Near-point corrections of a calibration; lengths along beams are in ticks, as distances.

    Attributes
    ----------
    dl, by_x, by_y : ndarray of float32, shape (n, width)
        Correction of far points, and by what a point moves along its beam for each metre that it is
        nearer than the far point; a row for each bank of lasers, or firing.
    limit : float32
        Nearer points are corrected.
    with_offsets, z_is_mean : bool
        See `TwoPoint`.
    frame : {"velocal", "ros"}
    """

    dl: _Floats
    by_x: _Floats
    by_y: _Floats
    limit: np.float32
    with_offsets: bool
    z_is_mean: bool
    frame: str

    @classmethod
    def of(
        cls, use: AppliedCalibration, two_point: TwoPoint, width: int, frame: str
    ) -> _NearPoints:
        """Corrections of a calibration, by bank."""
        tick_m = use.scanner.distance_tick_m
        effective = use.dialect.effective(use.parameters, use.scanner)
        dl: NDArray[Any] = effective.dl
        near_x, near_y = use.dialect.near(effective)
        per_metre = (
            (near_x - dl) / (FAR_POINT_M - NEAR_X_M),
            (near_y - dl) / (FAR_POINT_M - NEAR_Y_M),
        )
        dl, by_x, by_y = (
            (each / tick_m).astype(np.float32).reshape(-1, width) for each in (dl, *per_metre)
        )
        limit, mean = np.float32(two_point.limit_m / tick_m), two_point.z == "mean"
        return cls(dl, by_x, by_y, limit, two_point.with_offsets, mean, frame)

    def move(
        self, points: tuple[_Complex, _Floats], lines: _Lines, ticks: _Floats, turn: _Complex
    ) -> None:
        """Add the corrections to points, shape (n, width), that the head has turned by `turn`."""
        near = ticks <= self.limit
        if not near.any():
            return
        within = None if near.all() else near.astype(np.float32)
        horizontal, z = points
        beam = lines.slope * turn
        corrected = ticks + self.dl
        along = []
        for part, of_beam, per_metre in zip(
            _right_and_forward(horizontal, self.frame),
            _right_and_forward(beam, self.frame),
            (self.by_x, self.by_y),
            strict=True,
        ):
            of_beam = of_beam.copy()  # a view of every other number is slower each time
            at = np.abs(part if self.with_offsets else of_beam * corrected)
            further = np.subtract(np.float32(FAR_POINT_M), at, out=at)
            further *= per_metre
            if within is not None:
                further *= within
            of_beam *= further
            part += of_beam
            along.append(further)
        further_z = (along[0] + along[1]) / 2 if self.z_is_mean else along[1]
        further_z *= lines.slope_z
        z += further_z


@dataclass(frozen=True)
class _Constants:
    """Constants of lasers; all arrays have a row for each bank of lasers, or firing.

    Attributes
    ----------
    laser_id : ndarray of uint8, shape (n, width)
    delay_s : ndarray, shape (n, width)
        Time from the start of a firing until each laser fires.
    lowest, highest : ndarray of float32, shape (n, width)
        Limits of raw distances.
    lines : tuple of _Lines
        Of one or two calibrations.
    near : tuple of (_NearPoints or None)
        Likewise.
    between : _Lines or None
        Lines from the points of one calibration to those of the other, where these are lines.
    frame : {"velocal", "ros"}
    """

    laser_id: NDArray[np.uint8]
    delay_s: Array
    lowest: _Floats
    highest: _Floats
    lines: tuple[_Lines, ...]
    near: tuple[_NearPoints | None, ...]
    between: _Lines | None
    frame: str

    def rows(self, rows: NDArray[np.intp] | slice) -> _Constants:
        """Take some rows of every array."""
        return replace(
            rows_of(self, rows),
            lines=tuple(rows_of(each, rows) for each in self.lines),
            near=tuple(each and rows_of(each, rows) for each in self.near),
            between=self.between and rows_of(self.between, rows),
        )

    def points(self, ticks: _Floats, turn: _Complex) -> tuple[_Complex, _Floats, _Floats | None]:
        """X + i Y, Z and shift of raw distances, shape (n, width), at rotations of the head."""
        horizontal, z = self._turned(0, ticks, turn)
        if len(self.lines) == 1:
            return horizontal, z, None
        if self.between is not None:
            across, up = self.between.points(ticks)
            forward, right = across.real, across.imag
        else:
            across, up = self._turned(1, ticks, turn)
            across -= horizontal
            up -= z
            right, forward = _right_and_forward(across, self.frame)
        up *= up
        up += forward**2
        up += right**2
        return horizontal, z, np.sqrt(up, out=up)

    def _turned(self, number: int, ticks: _Floats, turn: _Complex) -> tuple[_Complex, _Floats]:
        """Points with one of the two calibrations."""
        lines, near = self.lines[number], self.near[number]
        horizontal, z = lines.points(ticks)
        horizontal *= turn
        if near is not None:
            near.move((horizontal, z), lines, ticks, turn)
        return horizontal, z


def _right_and_forward(points: _Complex, frame: str) -> tuple[_Floats, _Floats]:
    """Coordinates to the right (or left) and forward of points in a frame, as views."""
    return (points.real, points.imag) if frame == "velocal" else (points.imag, points.real)


class Lasers:
    """Constants of all lasers for the firings of a recording.

    Parameters
    ----------
    settings : Settings
    rate_hz : float
        Rotation rate.

    Attributes
    ----------
    delayed : bool
        Whether lasers of a firing fire at times of their own.
    limited : bool
        Whether there are limits of range.
    """

    def __init__(self, settings: Settings, rate_hz: float) -> None:
        scanner = settings.scanner
        width, tick_m = scanner.lasers_per_firing, scanner.distance_tick_m
        delay_s = scanner.azimuth_delay_s
        calibrations = [settings.parameters, settings.before]
        uses = [applied(each, scanner, rate_hz) for each in calibrations if each is not None]
        rotated = 2.0 * np.pi * rate_hz * delay_s
        constants = [_constants(use.model, rotated, tick_m) for use in uses]
        near = tuple(
            _NearPoints.of(use, use.dialect.two_point, width, settings.frame)
            if use.has_near_points and use.dialect.two_point is not None
            else None
            for use in uses
        )
        between: _Lines | None = None
        if near == (None, None):
            apart = [one - other for one, other in zip(*constants, strict=True)]
            between = _Lines.rounded(apart, width)
        dl = uses[0].model.dl
        # 0 is no return.
        lowest = np.maximum(np.ceil((settings.min_range_m - dl) / tick_m), 1.0)
        highest = np.floor((settings.max_range_m - dl) / tick_m)
        self.delayed = bool(delay_s.any())
        self.limited = not ((lowest == 1.0).all() and np.isposinf(highest).all())
        self._by_bank = _Constants(
            laser_id=np.arange(scanner.n_lasers, dtype=np.uint8).reshape(-1, width),
            delay_s=delay_s.reshape(-1, width),
            lowest=lowest.astype(np.float32).reshape(-1, width),
            highest=highest.astype(np.float32).reshape(-1, width),
            lines=tuple(_Lines.rounded(each, width) for each in constants),
            near=near,
            between=between,
            frame=settings.frame,
        )
        self._first_laser = b""
        self._by_firing = self._by_bank.rows(np.empty(0, dtype=np.intp))

    def of(self, first_laser: NDArray[np.uint8]) -> _Constants:
        """Constants of firings, by the first laser of each, shape (n,)."""
        # Banks nearly always follow one another in the same order, so that the constants are those
        # of the firings before.
        wanted, n = first_laser.tobytes(), len(first_laser)
        if not self._first_laser.startswith(wanted):
            self._first_laser = wanted
            self._by_firing = self._by_bank.rows((first_laser // 32).astype(np.intp))
        known = self._by_firing
        return known if n == len(self._first_laser) else known.rows(slice(n))


def place(
    firings: Firings,
    rotation: NDArray[np.int64],
    time_s: Array,
    lasers: Lasers,
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

    Returns
    -------
    dict of str to ndarray, shape (m,)
        Columns as `velocal.points.stream.stream` gives them.
    """
    constants = lasers.of(firings.first_laser)
    used = firings.distance > 0
    if lasers.limited:
        used = firings.distance >= constants.lowest
        used &= firings.distance <= constants.highest
    if rotation.min(initial=0) < 0:
        used &= (rotation >= 0)[:, None]
    horizontal, z, shift = _points(firings, constants)
    # X and Y stay one array. Arrays that are not needed any more make room in the cache for others.
    choice = _Choice(used)
    chosen = choice.of(horizontal)
    del horizontal
    # A firing's values are repeated as often as it has points: half the time of any index.
    count = _counted(used, choice.packed)
    columns: Columns = {
        "x": chosen.real,
        "y": chosen.imag,
        "z": choice.of(z),
        "intensity": choice.of(firings.intensity),
        "laser_id": choice.of(constants.laser_id),
        "rotation": np.repeat(rotation.astype(np.uint32), count),
        "time": np.repeat(time_s, count),
    }
    if lasers.delayed:
        columns["time"] += choice.of(constants.delay_s)
    if shift is not None:
        columns["shift"] = choice.of(shift)
    return columns


def _points(firings: Firings, constants: _Constants) -> tuple[_Complex, _Floats, _Floats | None]:
    """X + i Y, Z and shift of all returns, shape (n, width)."""
    shape = firings.distance.shape
    turn = np.repeat(_TURNS[constants.frame][firings.azimuth], shape[1]).reshape(shape)
    return constants.points(firings.distance.astype(np.float32), turn)


_Value = TypeVar("_Value", bound=np.generic)


class _Choice:
    """Values of an array where a mask is true, as numpy chooses them.

    Arrow copies runs of values, and looks at eight values of the mask at once: it takes a half to a
    third of the time of numpy.
    """

    def __init__(self, used: NDArray[np.bool_]) -> None:
        self.packed = np.packbits(used, bitorder="little")
        bits = pa.py_buffer(self.packed)
        self._mask = pa.Array.from_buffers(pa.bool_(), used.size, [None, bits])

    def of(self, values: NDArray[_Value]) -> NDArray[_Value]:
        """Values that are chosen, shape (m,), of an array of the shape of the mask."""
        kind = pa.from_numpy_dtype(np.dtype(f"u{values.itemsize}"))
        given = pa.Array.from_buffers(kind, values.size, [None, pa.py_buffer(values)])
        found = given.filter(self._mask)
        return np.frombuffer(found.buffers()[1], values.dtype, len(found))


def _counted(
    used: NDArray[np.bool_], packed: NDArray[np.uint8] | None = None
) -> NDArray[np.integer]:
    """Number of true values in each row, of which `packed` are the bits if they are known."""
    if used.shape[1] not in (8, 16, 32):
        return np.asarray(np.count_nonzero(used, axis=1))
    # The bits of a row as one number: a tenth of the time of `count_nonzero`.
    packed = np.packbits(used, bitorder="little") if packed is None else packed
    return np.asarray(np.bitwise_count(packed.view(f"u{used.shape[1] // 8}")))
