"""Trailing six bytes of HDL-64E packets: temperature, firmware, GPS time, the factory's table.

S2 units from firmware 4.07 on, and S3 units, send a time stamp (4 bytes), a status type and a
status value. Sixteen packets make a cycle: types `H M S D N Y G T V` (hour, minute, second, day,
month, year, GPS, temperature, firmware), then seven bytes of the calibration table; 260 cycles, or
4160 packets, hold the table of 1820 bytes, which begins with `UNIT#`. S1 units, and S2 units of
2008, send text instead. Nothing is assumed: what the bytes are is told by their content.

Sources: HDL-64E S3 user's manual (63-HDL64ES3 rev. G and K), appendices D and E: types, cycles,
scales, warning bits, CRC. HDL-64E S2 and S2.1 user's manual (firmware 4.07), appendix E. The
manuals leave open what the last two bytes of an S2 are, and which bytes the CRC of an S3 covers;
that follows velodyne_decoder (M. Valgur, BSD-3-Clause, `hdl64e.py`): the length of the table on an
S2, the CRC of every laser's 20 bytes after its id, in the order of the wire, on an S3, which is
told by type `W`. The layout agrees with VeloView's `HDLLaserCorrectionByte` (Apache-2.0).

What the integers of the wire round away: angles to 0.01 deg (at most 0.09 mrad), lengths to 1 mm,
the focal slope to 0.1, intensities to whole numbers.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.calibration.files.decimals import RADIANS_PER_DEGREE, UNCHANGED, number
from velocal.errors import RecordingError
from velocal.scanner.parameters import PARAMETERS, LaserParameters

Bytes = NDArray[np.uint8]

#: Status types that open every cycle, and the packets of a cycle.
OPENING = b"HMSDNYGTV"
CYCLE = 16
#: Cycles, packets and bytes of the whole table.
CYCLES = 260
TABLE_PACKETS = CYCLES * CYCLE
TABLE_BYTES = CYCLES * (CYCLE - len(OPENING))
MARKER = b"UNIT#"
TRAILING = np.dtype([("time_us", "<u4"), ("type", "u1"), ("value", "u1")])

_HOUR_US = 3_600_000_000
#: Steps of the clock longer than this many usual ones: packets are missing.
_GAP_INTERVALS = 1.5
#: Packets after the start of a cycle by which it is checked: the cycle and the opening of the next.
_LOOK_AHEAD = CYCLE + len(OPENING) - 1

_HUNDREDTH_DEG, _MM = RADIANS_PER_DEGREE.scaleb(-2), Decimal("0.001")
#: Values of a laser after its id, in the order of the wire: type there, size of one in our unit.
FIELDS: dict[str, tuple[str, Decimal]] = {
    "v": ("<i2", _HUNDREDTH_DEG),
    "alpha": ("<i2", _HUNDREDTH_DEG),
    "dl": ("<i2", _MM),
    "dist_correction_x": ("<i2", _MM),
    "dist_correction_y": ("<i2", _MM),
    "voff": ("<i2", _MM),
    "hoff": ("<i2", _MM),
    "focal_distance": ("<i2", _MM),
    "focal_slope": ("<i2", Decimal("0.1")),
    "min_intensity": ("u1", UNCHANGED),
    "max_intensity": ("u1", UNCHANGED),
}
#: A laser takes three cycles.
LASER = np.dtype([("id", "u1"), *((name, kind) for name, (kind, _) in FIELDS.items())])
#: The fourth opens the next laser (warning bits on an S3), or is the time of calibration.
TABLE = np.dtype(
    [
        ("marker", "u1", (5,)),
        ("thresholds", "u1", (2,)),
        ("lasers", [("values", LASER), ("after", "u1", (7,))], (64,)),
        ("rpm", "<i2"),
        ("fov", "<u2", (2,)),
        ("hours", "<u2"),
        ("source", "u1", (4,)),
        ("destination", "u1", (4,)),
        ("returns", "u1"),
        ("warning", "u1"),
        ("power", "u1"),
        ("check", "<u2"),
    ]
)
assert TABLE.itemsize == TABLE_BYTES

#: What the value of type G says (manual of the S3); with A and V the date is that of the receiver.
GPS = {
    ord("A"): "pulse and time received",
    ord("V"): "time received, no pulse",
    ord("P"): "pulse received, no time",
    0: "not connected",
}


def crc16(data: bytes) -> int:
    """CRC of the manual: polynomial 0x8005, most significant bit first, from zero."""
    remainder = 0
    for byte in data:
        remainder ^= byte << 8
        for _ in range(8):
            remainder = (remainder << 1) ^ (0x8005 if remainder & 0x8000 else 0)
            remainder &= 0xFFFF
    return remainder


def laser_crc(lasers: NDArray[np.void]) -> int:
    """CRC of the values of lasers (`LASER`) without their ids, as an S3 sends it."""
    return crc16(np.ascontiguousarray(lasers).view(np.uint8).reshape(64, -1)[:, 1:].tobytes())


@dataclass(frozen=True)
class UnitSettings:
    """Settings of the unit that stand in the calibration table.

    Attributes
    ----------
    calibrated : str or None
        Time of calibration (ISO 8601); None if it is not set.
    rpm : int
        Rotations per minute.
    fov_deg : (float, float)
        First and last azimuth of the field of view.
    hours : int
        Hours of operation.
    source, destination : str
        IPv4 addresses.
    """

    calibrated: str | None
    rpm: int
    fov_deg: tuple[float, float]
    hours: int
    source: str
    destination: str


@dataclass(frozen=True)
class TrailingStatus:
    """What the trailing bytes of a recording say: temperature, firmware, time, calibration.

    Attributes
    ----------
    kind : str
        "status" (later S2, S3), "text" (S1, S2 of 2008), or "none" of both.
    packets : int
        Data packets looked at.
    temperature_deg_c : (float, float) or None
        At the first and the last reading, whole degrees.
    firmware : str or None
    gps : str or None
        What the unit receives.
    gps_time : datetime or None
        Date and time (UTC) of the first reading, if they are such at all; whole seconds.
    gps_valid : bool
        Whether they come from a GPS receiver; else the clock runs free.
    tables : int
        Valid calibration tables that agree. Of a valid table, marker, laser ids, and length or
        CRC are right.
    broken, failed, deviating : int
        Tables with packets missing; with a wrong id, length or CRC; valid ones that differ from
        the others.
    series : str or None
        "S2" or "S3", by the form of the table.
    parameters : LaserParameters or None
        The factory's calibration, if most of the valid tables agree.
    unit : UnitSettings or None
        Settings in the last valid table.
    """

    kind: str = "none"
    packets: int = 0
    temperature_deg_c: tuple[float, float] | None = None
    firmware: str | None = None
    gps: str | None = None
    gps_time: datetime | None = None
    gps_valid: bool = False
    tables: int = 0
    broken: int = 0
    failed: int = 0
    deviating: int = 0
    series: str | None = None
    parameters: LaserParameters | None = None
    unit: UnitSettings | None = None

    def as_dict(self) -> dict[str, Any]:
        """Plain mapping for JSON; it says whether there are parameters, without their values."""
        known = {name: getattr(self, name) for name in self.__dataclass_fields__}
        known["parameters"] = self.parameters is not None
        known["gps_time"] = self.gps_time and self.gps_time.isoformat()
        known["unit"] = {} if self.unit is None else asdict(self.unit)
        return known

    def calibration(self, where: str) -> LaserParameters:
        """Embedded calibration of the factory.

        Parameters
        ----------
        where : str
            The recording, for errors.

        Returns
        -------
        LaserParameters

        Raises
        ------
        RecordingError
            If there is no valid table, or tables disagree; the message says why.
        """
        if self.parameters is not None:
            return self.parameters
        what, hint = self.why_not
        raise RecordingError(f"holds no usable calibration table: {what}", where=where, hint=hint)

    def lines(self) -> dict[str, str]:
        """Temperature, firmware and GPS time for people, by heading; only what is there."""
        told = {}
        if self.temperature_deg_c is not None:
            first, last = self.temperature_deg_c
            later = f", later {last:.0f}" if last != first else ""
            told["temperature"] = f"{first:.0f} deg C{later}"
        if self.firmware is not None:
            told["firmware"] = self.firmware
        if self.gps is not None:
            time = f"{self.gps_time:%Y-%m-%d %H:%M:%S}" if self.gps_time else "no date"
            free = "" if self.gps_valid else ", clock runs free"
            told["GPS time"] = f"{time} (GPS: {self.gps}{free})"
        return told

    @property
    def calibration_text(self) -> str:
        """Whether there is an embedded calibration, for people; if not, why."""
        if self.parameters is None:
            return f"no: {self.why_not[0]}"
        return f"complete, {self.tables_text}"

    @property
    def tables_text(self) -> str:
        """Form of the table, how often it was found, and what was left out, for people."""
        found = f"{self.series}, {self.tables} equal table{'s' if self.tables != 1 else ''}"
        left = {
            "with packets missing": self.broken,
            "failed their check": self.failed,
            "deviating": self.deviating,
        }
        return "; ".join([found, *(f"{count} {why}" for why, count in left.items() if count)])

    @property
    def why_not(self) -> tuple[str, str]:
        """Why there is no calibration, and what to do about it."""
        other = "Name a calibration file, or `nominal`."
        if self.kind != "status":
            sent = "are text" if self.kind == "text" else "are no status bytes"
            return f"its trailing bytes {sent}", f"HDL-64E S2 (later) and S3 send it. {other}"
        if self.deviating:
            return f"its {self.tables + self.deviating} valid tables disagree", other
        bad = f"{self.broken} of its tables lack packets, {self.failed} fail their check"
        if self.packets < TABLE_PACKETS:
            bad = f"it has {self.packets} packets, the table takes {TABLE_PACKETS}"
        elif not self.broken + self.failed:
            bad = f"no whole table in {self.packets} packets (it takes {TABLE_PACKETS})"
        longer = f"Record {2 * TABLE_PACKETS} packets (2.4 s) or more without loss."
        return bad, f"{longer} {other}"


class StatusReader:
    """Reads trailing bytes, a chunk at a time; what is kept does not grow with the recording."""

    def __init__(self) -> None:
        self._packets = 0
        self._texts: set[bytes] = set()
        self._text_degrees: list[float] = []
        #: Packets that are not checked yet, and how many came before them.
        self._held = np.empty(0, dtype=TRAILING)
        self._before = 0
        self._interval_us = float("nan")
        self._readings: list[Bytes] = []
        #: Cycles in a row, a marker first: type of their first table byte, and all seven values.
        self._chain = np.empty((0, 8), dtype=np.uint8)
        #: Packet with which the next cycle must begin to belong to them.
        self._next: int | None = None
        self._valid: Counter[tuple[bytes, str]] = Counter()
        self._unit: UnitSettings | None = None
        self._broken = self._failed = 0

    def consume(self, trailing: Bytes) -> None:
        """Read the trailing bytes of consecutive packets, shape (n, 6)."""
        self._packets += len(trailing)
        self._read_text(trailing)
        held = np.concatenate([self._held, np.ascontiguousarray(trailing).view(TRAILING)[:, 0]])
        settled = max(len(held) - _LOOK_AHEAD, 0)
        self._read_cycles(held, settled)
        self._held = held[settled:]
        self._before += settled

    def result(self) -> TrailingStatus:
        """Tell what was found; nothing can be consumed afterwards."""
        self._read_cycles(self._held, len(self._held))
        if not self._readings:
            return self._text()
        first, last = self._readings[0], self._readings[-1]
        hour, minute, second, day, month, year, gps, _, firmware = (int(v) for v in first)
        try:
            time = datetime(2000 + year, month, day, hour, minute, second, tzinfo=UTC)
        except ValueError:
            time = None
        valid = self._valid.total()
        best, count = self._valid.most_common(1)[0] if valid else ((b"", ""), 0)
        return TrailingStatus(
            kind="status",
            packets=self._packets,
            # Below zero in two's complement: the manuals do not say, but no unit is at 200 deg C.
            temperature_deg_c=(float(first[7].view(np.int8)), float(last[7].view(np.int8))),
            firmware=f"{firmware >> 4}.{firmware & 15:02d} (0x{firmware:02X})",
            gps=GPS.get(gps, f"unknown (0x{gps:02X})"),
            gps_time=time,
            gps_valid=time is not None and gps in b"AV",
            tables=count,
            broken=self._broken,
            failed=self._failed,
            deviating=valid - count,
            series=best[1] or None,
            parameters=_parameters(best[0]) if 2 * count > valid else None,
            unit=self._unit,
        )

    def _read_text(self, trailing: Bytes) -> None:
        """Read temperature and firmware of units that send text."""
        halves = np.ascontiguousarray(trailing[:, 2:]).view(np.uint16)
        text = np.frombuffer(b"DegC", np.uint16)
        degrees = (halves[:, 0] == text[0]) & (halves[:, 1] == text[1])
        if degrees.any():
            # The second byte is whole degrees; how the first divides a degree is not documented.
            values = trailing[degrees, 1]
            first = self._text_degrees[:1] or [float(values[0])]
            self._text_degrees = [*first, float(values[-1])]
            others = {bytes(text) for text in np.unique(trailing[~degrees, 2:], axis=0)}
            self._texts |= {text for text in others if re.fullmatch(rb"[vV]\d[ -~]{2}", text)}

    def _text(self) -> TrailingStatus:
        """What was found in the trailing bytes of a unit that sends no status types."""
        if not self._text_degrees:
            return TrailingStatus(packets=self._packets)
        return TrailingStatus(
            kind="text",
            packets=self._packets,
            temperature_deg_c=(self._text_degrees[0], self._text_degrees[1]),
            firmware=min(self._texts).decode("ascii") if self._texts else None,
        )

    def _read_cycles(self, held: NDArray[np.void], settled: int) -> None:
        """Read the cycles that begin among the first `settled` packets."""
        opening = np.frombuffer(OPENING, np.uint8)
        if len(held) < len(opening):
            return
        types, values = np.ascontiguousarray(held["type"]), held["value"]
        opens = np.ones(len(types) - len(opening) + 1, dtype=bool)
        for at, kind in enumerate(opening):
            opens &= types[at : at + len(opens)] == kind
        start = np.flatnonzero(opens[:settled])
        if len(start) == 0:
            return
        first, last = (values[at : at + len(opening)].copy() for at in (start[0], start[-1]))
        self._readings = [*(self._readings[:1] or [first]), last]
        steps = np.mod(np.diff(held["time_us"].astype(np.int64)), _HOUR_US)
        if np.isnan(self._interval_us):
            self._interval_us = float(np.median(steps))
        # Packets that miss by the cycle are seen in the clock only.
        gaps = np.concatenate([[0], np.cumsum(steps > _GAP_INTERVALS * self._interval_us)])
        start = start[start + CYCLE <= len(held)]
        end = start + CYCLE
        # After the last packets of a recording there is no next cycle to be seen.
        followed = np.append(opens, np.ones(len(opening), dtype=bool))[end]
        good = followed & (gaps[np.minimum(end, len(held) - 1)] == gaps[start])
        table = start[:, None] + np.arange(len(opening), CYCLE)
        rows = np.concatenate([types[table[:, :1]], values[table]], axis=1)
        joined = np.diff(start, prepend=-1) == CYCLE
        joined[1:] &= good[:-1]
        joined[:1] = self._before + start[:1] == self._next
        for part in np.split(np.arange(len(start)), np.flatnonzero(~joined)):
            if len(part) == 0:
                continue
            if not joined[part[0]]:
                self._break()
            self._chain = np.concatenate([self._chain, rows[part][good[part]]])
            self._next = int(self._before + end[part[-1]]) if good[part[-1]] else None
            self._tables()

    def _break(self) -> None:
        """Drop a table of which packets are missing."""
        self._broken += len(self._chain) > 0
        self._chain = self._chain[:0]

    def _tables(self) -> None:
        """Read the whole tables in the chain, which then begins with a marker or is empty."""
        while True:
            marked = (self._chain[:, 1:6] == np.frombuffer(MARKER, np.uint8)).all(axis=1)
            first = int(marked.argmax()) if marked.any() else len(marked)
            self._chain = self._chain[first:]
            if len(self._chain) < CYCLES:
                return
            # The first cycle of the second laser.
            series = "S3" if self._chain[4, 0] == ord("W") else "S2"
            valid = self._check(self._chain[:CYCLES, 1:], series)
            self._chain = self._chain[CYCLES if valid else 1 :]

    def _check(self, rows: Bytes, series: str) -> bool:
        """Count a table as valid or failed, and say which of the two it is."""
        table = np.ascontiguousarray(rows).reshape(-1).view(TABLE)[0]
        lasers = np.ascontiguousarray(table["lasers"]["values"])
        key = (lasers.tobytes(), series)
        check = TABLE_BYTES if series == "S2" else laser_crc(lasers)
        # An empty memory gives 64 equal angles.
        angles = lasers["v"]
        right = np.ptp(angles) > 0 and np.abs(angles.astype(int)).max() <= 9000
        if not right or (lasers["id"] != np.arange(64)).any() or table["check"] != check:
            self._failed += 1
            return False
        self._valid[key] += 1
        self._unit = _unit(table)
        return True


def _parameters(lasers: bytes) -> LaserParameters:
    """Values of lasers in metres and radians, rounded once."""
    columns = np.frombuffer(lasers, dtype=LASER)
    values = {
        name: np.array([number(int(wire), name, "status bytes", unit) for wire in columns[name]])
        for name, (_, unit) in FIELDS.items()
    }
    own = {name: values.pop(name) for name in PARAMETERS}
    return LaserParameters(**own, carried=values)


def _unit(table: np.void) -> UnitSettings:
    """Settings of the unit in a table."""
    year, month, day, hour, minute, second, _ = (int(v) for v in table["lasers"]["after"][-1])
    try:
        calibrated = datetime(2000 + year, month, day, hour, minute, second).isoformat()
    except ValueError:
        calibrated = None
    first, last = (float(angle) / 100.0 for angle in table["fov"])
    return UnitSettings(
        calibrated=calibrated,
        rpm=int(table["rpm"]),
        fov_deg=(first, last),
        hours=int(table["hours"]),
        source=".".join(str(v) for v in table["source"]),
        destination=".".join(str(v) for v in table["destination"]),
    )
