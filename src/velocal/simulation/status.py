"""Status bytes of a simulated HDL-64E: the inverse of `velocal.packets.status`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.calibration.files import document as lasers
from velocal.errors import CalibrationFileError
from velocal.packets.status import (
    CYCLE,
    CYCLES,
    FIELDS,
    LASER,
    MARKER,
    OPENING,
    TABLE,
    TABLE_BYTES,
    TABLE_PACKETS,
    laser_crc,
)
from velocal.scanner.parameters import LaserParameters

#: Firmware of an HDL-64E S2 that sends the table: 4.07.
FIRMWARE = 0x47
#: Hour, day, month and year of the simulated recordings; no GPS receiver is connected.
_STARTED = (9, 12, 6, 14)
#: Types of an S3 for single bytes of the last three cycles (cycle, place from 1).
_S3_TYPES = {
    **{(258, place): code for place, code in enumerate((0xFE, 0xFF, 0xFC, 0xFD, 0xFA, 0xFB), 1)},
    (260, 3): 0xF9,
    (260, 5): 0xF8,
}


def encode_table(parameters: LaserParameters, *, rpm: int = 600, series: str = "S2") -> np.ndarray:
    """Encode the factory's table, 1820 bytes.

    Values that the parameters do not carry are set to those without effect (`lasers.neutral`).

    Parameters
    ----------
    parameters : LaserParameters
        Of 64 lasers; they are rounded to the units of the status bytes.
    rpm : int
        Spin rate in the table.
    series : {"S2", "S3"}
        The S2 ends with the length of the table, the S3 with a CRC.

    Raises
    ------
    CalibrationFileError
        If a value is not finite or does not fit the integers of the status bytes.
    """
    rows = [lasers.neutral(row) for row in lasers.rows(Path("status bytes"), parameters)]
    table = np.zeros(1, dtype=TABLE)
    values = np.zeros(len(rows), dtype=LASER)
    values["id"] = np.arange(len(rows))
    for name, (kind, unit) in FIELDS.items():
        wire = np.rint([row[name] / float(unit) for row in rows])
        bounds = np.iinfo(kind)
        if wire.min() < bounds.min or wire.max() > bounds.max:
            raise CalibrationFileError(
                f"{name} does not fit the status bytes",
                allowed=f"{bounds.min * float(unit):g} to {bounds.max * float(unit):g}",
            )
        values[name] = wire
    table["marker"] = np.frombuffer(MARKER, np.uint8)
    table["thresholds"] = 24
    table["lasers"]["values"] = values
    # Time of calibration, to the second; the seventh byte is reserved for humidity.
    table["lasers"]["after"][:, -1] = (11, 2, 15, 10, 30, 0, 25)
    table["rpm"], table["fov"] = rpm, (0, 36000)
    table["source"], table["destination"] = (192, 168, 1, 201), (192, 168, 1, 255)
    table["check"] = TABLE_BYTES if series == "S2" else laser_crc(values)
    return table.view(np.uint8)


def table_packets(table: np.ndarray, series: str = "S2") -> NDArray[np.uint8]:
    """Spread a table over the status bytes of 4160 packets.

    Parameters
    ----------
    table : ndarray of uint8, shape (1820,)
        From `encode_table`.
    series : {"S2", "S3"}

    Returns
    -------
    ndarray of uint8, shape (4160, 2)
        Status type and value; the values of the scanner's state (time, temperature) are zero.
    """
    packets = np.zeros((CYCLES, CYCLE, 2), dtype=np.uint8)
    opening = len(OPENING)
    packets[:, :opening, 0] = np.frombuffer(OPENING, np.uint8)
    packets[:, opening:, 0] = np.frombuffer(b"1234567", np.uint8)
    packets[:, opening:, 1] = table.reshape(CYCLES, -1)
    if series == "S3":
        # The first byte of every further laser's first cycle is the warning bits.
        packets[4:256:4, opening, 0] = ord("W")
        for (cycle, place), code in _S3_TYPES.items():
            packets[cycle - 1, opening + place - 1, 0] = code
    return packets.reshape(TABLE_PACKETS, 2)


def status_bytes(
    packets: NDArray[np.uint8],
    number: NDArray[np.int64],
    time_us: NDArray[np.int64],
    temperature_deg_c: Array,
) -> NDArray[np.uint8]:
    """Status type and value of packets, shape (n, 2).

    Parameters
    ----------
    packets : ndarray, shape (4160, 2)
        From `table_packets`.
    number : ndarray, shape (n,)
        Running number of the packets; the table begins at number 0.
    time_us : ndarray, shape (n,)
        Microseconds since the full hour before the recording.
    temperature_deg_c : ndarray, shape (n,)
        Temperature of the scanner at every packet.
    """
    status = packets[number % TABLE_PACKETS].copy()
    hour, day, month, year = _STARTED
    seconds = time_us // 1_000_000
    state = np.zeros((len(number), len(OPENING)), dtype=np.int64)
    state[:, :3] = np.stack([hour + seconds // 3600, seconds // 60 % 60, seconds % 60], axis=1)
    state[:, 0] %= 24
    state[:, 3:] = (day, month, year, 0, 0, FIRMWARE)
    state[:, 7] = np.rint(temperature_deg_c)
    place = number % CYCLE
    at = np.flatnonzero(place < len(OPENING))
    status[at, 1] = state[at, place[at]].astype(np.uint8)
    return status
