"""Points of a recording with one calibration, and how far another one would shift each point.

Equations (1) to (3) at rotational angle 0 are linear in the raw distance,

    p = tick P1 + P0      q = tick Q1 + Q0      Z = tick R1 + R0

with constants of the laser, and the head turns (p, q) as a whole:

    X = sin(phi) p - cos(phi) q      Y = cos(phi) p + sin(phi) q

so that sines are looked up once for each firing, and the distance between the points of two
calibrations does not depend on phi. Single precision: within a few hundredths of a millimetre at
100 m.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array, joined_rows
from velocal.calibration.applied import applied
from velocal.calibration.files.document import CalibrationFile
from velocal.capture.source import ANY_SOURCE, SourceFilter
from velocal.errors import ConfigError
from velocal.packets.data import BLOCKS, flags_and_azimuths, view
from velocal.packets.dual import ONLY, check_choice, dual_packets
from velocal.packets.firings import Firings, decode
from velocal.recording import timing
from velocal.recording.inspection import Inspection
from velocal.recording.recording import Recording
from velocal.recording.returns import returns_of
from velocal.recording.windows import read_rotations
from velocal.scanner.beam import Beams, angle_from_ticks, distance_from_ticks
from velocal.scanner.models import AZIMUTH_TICK_DEG, AZIMUTH_TICKS, Scanner
from velocal.scanner.parameters import LaserParameters

Columns = dict[str, NDArray[Any]]

#: Packets that are placed together: their arrays stay in the processor's cache.
PACKETS = 256
#: The device clock counts the seconds of an hour.
HOUR_S = 3600.0
#: Y forward and X right, as everywhere here; X forward and Y left, as in ROS.
FRAMES = ("velocal", "ros")

_TURN = np.deg2rad(np.arange(AZIMUTH_TICKS) * AZIMUTH_TICK_DEG)
_SINE, _COSINE = np.sin(_TURN).astype(np.float32), np.cos(_TURN).astype(np.float32)


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


class _Lasers:
    """Constants of the lasers, one row per firing of `lasers_per_firing` of them."""

    def __init__(self, settings: Settings, rate_hz: float) -> None:
        scanner = settings.scanner
        self.width = scanner.lasers_per_firing
        delay_s = scanner.azimuth_delay_s
        tick_m, rotated = scanner.distance_tick_m, 2.0 * np.pi * rate_hz * delay_s
        self.scanner = scanner
        self.applied = applied(settings.parameters, scanner, rate_hz)
        self.before = (
            None if settings.before is None else applied(settings.before, scanner, rate_hz)
        )
        self.rate_rad_s = 2.0 * np.pi * rate_hz
        slope, start = self._lines(self.applied.model, rotated, tick_m)
        self.slope, self.start = self._rows(slope), self._rows(start)
        self.delay_s = delay_s.reshape(-1, self.width)
        self.differences: list[tuple[NDArray[np.float32], NDArray[np.float32]]] = []
        if self.before is not None:
            slope_0, start_0 = self._lines(self.before.model, rotated, tick_m)
            ways = zip(self._rows(slope - slope_0), self._rows(start - start_0), strict=True)
            self.differences = list(ways)
        dl = self.applied.model.dl
        lowest = np.ceil((settings.min_range_m - dl) / scanner.distance_tick_m)
        highest = np.floor((settings.max_range_m - dl) / scanner.distance_tick_m)
        # 0 is no return.
        self.lowest = np.maximum(lowest, 1.0).astype(np.float32).reshape(-1, self.width)
        self.highest = highest.astype(np.float32).reshape(-1, self.width)

    def _rows(self, constants: Array) -> NDArray[np.float32]:
        return constants.astype(np.float32).reshape(3, -1, self.width)

    @property
    def has_near_points(self) -> bool:
        """Whether a calibration has near-point corrections: points are not on lines then."""
        calibrations = (self.applied, self.before)
        return any(each is not None and each.has_near_points for each in calibrations)

    def near_points(self, firings: Firings, used: NDArray[np.bool_]) -> tuple[Array, Array | None]:
        """Points (n, 3) of the returns that are used, and their shifts (n,), by the formulas."""
        laser = firings.laser_id()[used]
        count = np.count_nonzero(used, axis=1)
        start = np.repeat(firings.azimuth, count)
        phi = angle_from_ticks(start, laser, self.scanner, self.rate_rad_s)
        distance_m = distance_from_ticks(firings.distance[used], self.scanner.distance_tick_m)
        xyz = self.applied.points(distance_m, phi, laser)
        if self.before is None:
            return xyz, None
        moved = xyz - self.before.points(distance_m, phi, laser)
        return xyz, np.asarray(np.sqrt((moved**2).sum(axis=1)))

    @staticmethod
    def _lines(parameters: LaserParameters, rotated: Array, tick_m: float) -> tuple[Array, Array]:
        """P1, Q1, R1 and P0, Q0, R0 of every laser, each of shape (3, n)."""
        alpha, v = parameters.alpha - rotated, parameters.v
        sine, cosine = np.sin(alpha), np.cos(alpha)
        along = np.stack([np.cos(v) * cosine, np.cos(v) * sine, np.sin(v)])
        offset = np.stack([-parameters.hoff * sine, parameters.hoff * cosine, parameters.voff])
        return tick_m * along, parameters.dl * along + offset

    def coordinates(
        self, ticks: NDArray[np.float32], bank: NDArray[np.intp]
    ) -> list[NDArray[np.float32]]:
        """p, q and Z of raw distances, shape (n, width)."""
        return self._along(ticks, bank, zip(self.slope, self.start, strict=True))

    def shift(self, ticks: NDArray[np.float32], bank: NDArray[np.intp]) -> NDArray[np.float32]:
        """Distance from the point with the calibration before, metres, shape (n, width)."""
        x, y, z = self._along(ticks, bank, self.differences)
        x *= x
        y *= y
        z *= z
        x += y
        x += z
        return np.asarray(np.sqrt(x, out=x))

    @staticmethod
    def _along(
        ticks: NDArray[np.float32],
        bank: NDArray[np.intp],
        lines: Iterable[tuple[NDArray[np.float32], NDArray[np.float32]]],
    ) -> list[NDArray[np.float32]]:
        along = []
        for slope, start in lines:
            # In place: fresh memory costs more than arithmetic.
            values = slope.take(bank, axis=0)
            values *= ticks
            values += start.take(bank, axis=0)
            along.append(values)
        return along


def place(
    firings: Firings,
    rotation: NDArray[np.int64],
    time_s: Array,
    lasers: _Lasers,
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
    lasers : _Lasers
        Constants of the lasers.
    frame : {"velocal", "ros"}
        Frame of the coordinates.

    Returns
    -------
    dict of str to ndarray, shape (m,)
        Columns as `stream` gives them.
    """
    bank = (firings.first_laser // 32).astype(np.intp)
    ticks = firings.distance.astype(np.float32)
    used = (ticks >= lasers.lowest.take(bank, axis=0)) & (
        ticks <= lasers.highest.take(bank, axis=0)
    )
    used &= (rotation >= 0)[:, None]
    # A firing's values are repeated as often as it has points: half the time of any index.
    count = np.count_nonzero(used, axis=1)
    shift: NDArray[Any] | None = None
    if lasers.has_near_points:
        xyz, shift = lasers.near_points(firings, used)
        right, forward, up = xyz.astype(np.float32).T
    else:
        p, q, z = lasers.coordinates(ticks, bank)
        sine, cosine = _SINE[firings.azimuth][:, None], _COSINE[firings.azimuth][:, None]
        across = sine * p
        across -= cosine * q
        p *= cosine
        q *= sine
        p += q
        right, forward, up = across[used], p[used], z[used]
        if lasers.differences:
            shift = lasers.shift(ticks, bank)[used]
    x, y = (right, forward) if frame == "velocal" else (forward, np.negative(right))
    columns: Columns = {
        "x": x,
        "y": y,
        "z": up,
        "intensity": firings.intensity[used],
        "laser_id": firings.laser_id()[used],
        "rotation": np.repeat(rotation.astype(np.uint32), count),
        "time": np.repeat(time_s, count),
    }
    if lasers.delay_s.any():
        columns["time"] += lasers.delay_s.take(bank, axis=0)[used]
    if shift is not None:
        columns["shift"] = shift.astype(np.float32)
    return columns


class _Clock:
    """Seconds since the first packet, on the clock that the index of rotations goes by."""

    def __init__(self, inspection: Inspection, scanner: Scanner) -> None:
        self.kind, self.times = inspection.clock, inspection.index.time_s
        #: Blocks of a shot of all lasers, and time between packets, with one and with two returns.
        self.together = len(scanner.flags) * np.array([1, 2])
        self.interval_s = np.array([inspection.interval_for(scanner, two) for two in (False, True)])
        self.per_block = scanner.firings_per_block
        self.epoch: float | None = None
        jumps = inspection.clock_jumps or inspection.damaged_stamps
        self.steady = timing.Clock(inspection.clock) if jumps else None
        self.last, self.offset_s = -1, 0.0

    def packets(
        self,
        captured: Array | None,
        payloads: NDArray[np.uint8],
        rotation: NDArray[np.int64],
    ) -> Array:
        """Time of packets, shape (n,), of the given rotations; NaN without a clock."""
        stamps = view(payloads)["timestamp"]
        if self.steady is not None:
            return self._without_jumps(self.steady, captured, payloads, rotation)
        about = self.times[rotation]
        if self.kind == "device":
            clock = stamps * 1e-6
        elif self.kind == "capture" and captured is not None:
            clock = captured
        else:
            return np.full(len(stamps), np.nan)
        if self.epoch is None:
            # Reading begins with the packet in which a rotation does, whose time is known.
            self.epoch = float(clock[0] - about[0])
        since = clock - self.epoch
        if self.kind == "device":
            since += HOUR_S * np.rint((about - since) / HOUR_S)
        return np.asarray(since)

    def _without_jumps(
        self,
        clock: timing.Clock,
        captured: Array | None,
        payloads: NDArray[np.uint8],
        rotation: NDArray[np.int64],
    ) -> Array:
        """Time of packets of a recording whose clock jumps, counted from where rotations begin."""
        wire = view(payloads)
        flag, azimuth = flags_and_azimuths(wire)
        stamps, dual = np.ascontiguousarray(wire["timestamp"]), dual_packets(flag, azimuth)
        since, _ = clock.times(stamps, captured, azimuth, dual)
        begins = np.flatnonzero(np.diff(rotation, prepend=self.last))
        offsets = np.concatenate([[self.offset_s], self.times[rotation[begins]] - since[begins]])
        at = np.searchsorted(begins, np.arange(len(rotation)), side="right")
        self.last, self.offset_s = int(rotation[-1]), float(offsets[-1])
        return np.asarray(since + offsets[at])

    def firings(self, block: NDArray[np.int64], dual: NDArray[np.bool_]) -> Array:
        """Time from the stamp of its packet to every firing, shape (n,).

        By its block, and by whether the packet holds two returns of a shot.
        """
        together = self.together[dual.astype(np.intp)]
        shot = together * self.interval_s[dual.astype(np.intp)] / BLOCKS
        time_s = block % BLOCKS // together * shot
        if self.per_block > 1:  # the later firings of a block follow the first
            later = np.flatnonzero(block[1:] == block[:-1]) + 1
            time_s[later] += shot[later] / self.per_block
        return np.asarray(time_s, dtype=np.float64)


def stream(
    recording: Path, inspection: Inspection, rotations: NDArray[np.int64], settings: Settings
) -> Iterator[tuple[Columns, int]]:
    """Points of some rotations of a recording, in the order of the wire.

    Memory does not depend on the length of the recording.

    Parameters
    ----------
    recording : Path
        Capture file.
    inspection : Inspection
        Of that file.
    rotations : ndarray of int64
        Rotations to use, ascending.
    settings : Settings

    Yields
    ------
    columns : dict of str to ndarray, shape (n,)
        ``x``, ``y``, ``z`` and ``shift`` in metres (float32), ``intensity``, ``laser_id``,
        ``rotation``; ``time`` in seconds since the first packet of the recording, of the shot.
    packets : int
        Packets that they come from.
    """
    scanner = settings.scanner
    lasers = _Lasers(settings, inspection.index.rate_for(scanner, rotations))
    clock = _Clock(inspection, scanner)
    index, source = inspection.index, settings.source
    for chunk, rotation_of_block in read_rotations(recording, index, rotations, source):
        for begin in range(0, len(chunk.payloads), PACKETS):
            part = slice(begin, begin + PACKETS)
            payloads, of_block = chunk.payloads[part], rotation_of_block[part]
            firings = decode(payloads, scanner, settings.returns)
            rotation = of_block.reshape(-1)[firings.block]
            captured = None if chunk.capture_time_s is None else chunk.capture_time_s[part]
            sent = clock.packets(captured, payloads, of_block.max(axis=1))
            time_s = sent[firings.block // BLOCKS] + clock.firings(
                firings.block, firings.which != ONLY
            )
            yield place(firings, rotation, time_s, lasers, settings.frame), len(payloads)


def stream_points(
    recording: Recording,
    calibration: CalibrationFile | LaserParameters,
    rotations: str | int | slice | Sequence[int] | NDArray[np.integer] = "all",
    *,
    before: CalibrationFile | LaserParameters | None = None,
    min_range_m: float = -np.inf,
    max_range_m: float = np.inf,
    frame: str = "velocal",
    returns: str = "strongest",
) -> Iterator[Columns]:
    """Apply a calibration to a recording, some thousand packets at a time.

    Parameters
    ----------
    recording : Recording
        See `open_recording`.
    calibration : CalibrationFile or LaserParameters
        Calibration that gives the points. That of `read_calibration` is applied as the program
        does for which the file is written, with its near-point corrections; parameters give the
        points of equations (1) to (3).
    rotations : str, int, slice or sequence of int
        See `Recording.select`.
    before : CalibrationFile or LaserParameters, optional
        Another calibration; with it, the column ``shift`` tells how far every point has moved.
    min_range_m, max_range_m : float
        Points whose calibrated distance lies outside are left out, metres.
    frame : {"velocal", "ros"}
        Y forward and X right, as everywhere here, or X forward and Y left.
    returns : {"strongest", "last", "both"}
        Which return, where a shot has two.

    Yields
    ------
    dict of str to ndarray, shape (n,)
        See `stream`.

    Raises
    ------
    RecordingError
        If the recording cannot be read.
    ConfigError
        If `rotations`, `frame` or `returns` are unknown.

    Examples
    --------
    >>> recording = velocal.open_recording("capture.bin", scanner="HDL-32E")
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> points = next(velocal.stream_points(recording, factory, slice(1, 3)))
    >>> points["x"].dtype, bool(points["rotation"].max() == 2)
    (dtype('float32'), True)
    """
    if frame not in FRAMES:
        raise ConfigError(f"unknown frame {frame!r}", where="frame", allowed=", ".join(FRAMES))
    check_choice(returns, "returns")
    chosen = recording.select(rotations, None)
    settings = Settings(
        recording.scanner,
        calibration,
        before,
        min_range_m,
        max_range_m,
        frame,
        returns,
        recording.source,
    )
    for columns, _ in stream(recording.path, recording.scan(), chosen, settings):
        yield columns


def raw_returns(
    recording: Path, inspection: Inspection, rotations: NDArray[np.int64], settings: Settings
) -> Beams:
    """Returns of a few rotations that are within the limits of range, all in memory.

    Parameters
    ----------
    recording : Path
        Capture file.
    inspection : Inspection
        Of that file.
    rotations : ndarray of int64
        Rotations to use, ascending.
    settings : Settings

    Returns
    -------
    Beams
        In the order of the wire.
    """
    parts = returns_of(
        recording, inspection.index, rotations, settings.scanner,
        returns=settings.returns, source=settings.source,
    )  # fmt: skip
    found = joined_rows(list(parts))
    beams = found.beams()
    dl = applied(settings.parameters, settings.scanner, found.rotation_rate_hz).model.dl
    range_m = beams.distance_m + dl[beams.laser_id]
    return beams[(range_m >= settings.min_range_m) & (range_m <= settings.max_range_m)]
