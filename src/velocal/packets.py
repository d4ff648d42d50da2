"""Payload of a Velodyne data packet: 12 blocks of 100 bytes and 6 bytes at the end.

A block is a flag, an azimuth and 32 channels of distance and intensity, little-endian
(HDL-64E S2 manual, appendix E; HDL-32E and VLP-16 manuals, data packet format). Nothing here
assumes an order of blocks: which lasers a block belongs to is told by its flag.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.sensors import AZIMUTH_TICKS, FLAG_LOWER, FLAG_UPPER, Scanner

PAYLOAD_BYTES = 1206
BLOCKS = 12
CHANNELS = 32

BLOCK = np.dtype(
    [
        ("flag", "<u2"),
        ("azimuth", "<u2"),
        ("channels", [("distance", "<u2"), ("intensity", "u1")], (CHANNELS,)),
    ]
)
PACKET = np.dtype([("blocks", BLOCK, (BLOCKS,)), ("timestamp", "<u4"), ("status", "u1", (2,))])
assert PACKET.itemsize == PAYLOAD_BYTES

#: Positions of the first byte of every block flag in a payload.
FLAG_POSITIONS = np.arange(BLOCKS) * BLOCK.itemsize


@dataclass(frozen=True)
class Firings:
    """Returns of consecutive firings, one row each of `k` lasers that share an azimuth.

    Attributes
    ----------
    azimuth : ndarray of uint16, shape (n,)
        Raw azimuth of the firing, 0.01 degree.
    first_laser : ndarray of uint8, shape (n,)
        `laser_id` of the first column: 32 for a lower block of an HDL-64E, else 0.
    timestamp : ndarray of uint32, shape (n,)
        Trailing four bytes of the firing's packet; a device time in microseconds of the hour
        where the scanner sends one.
    distance : ndarray of uint16, shape (n, k)
        Raw distance, 2 mm; 0 where nothing came back.
    intensity : ndarray of uint8, shape (n, k)
        Raw intensity.
    """

    azimuth: NDArray[np.uint16]
    first_laser: NDArray[np.uint8]
    timestamp: NDArray[np.uint32]
    distance: NDArray[np.uint16]
    intensity: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.azimuth)

    def laser_id(self) -> NDArray[np.uint8]:
        """`laser_id` of every return, shape (n, k)."""
        columns = np.arange(self.distance.shape[1], dtype=np.uint8)
        return self.first_laser[:, None] + columns


def view(payloads: NDArray[np.uint8]) -> NDArray[np.void]:
    """View payload bytes, shape (n, 1206), as packets without copying."""
    return np.ascontiguousarray(payloads).view(PACKET)[:, 0]


def sound(payloads: NDArray[np.uint8]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell which payloads have only known block flags, and which only azimuths in one turn.

    Returns
    -------
    flags_known, azimuths_valid : ndarray of bool, shape (n,)
    """
    blocks = view(payloads)["blocks"]
    flags = blocks["flag"]
    known: NDArray[np.bool_] = ((flags == FLAG_UPPER) | (flags == FLAG_LOWER)).all(axis=1)
    # A VLP-16 was seen to send 36000 for a full turn.
    return known, np.asarray((blocks["azimuth"] <= AZIMUTH_TICKS).all(axis=1))


def median_azimuth_step(azimuth: NDArray[np.uint16]) -> NDArray[np.int64]:
    """Median of the differences of the azimuths in every packet, shape (n, 12) to (n,).

    Blocks that share an azimuth (pairs of an HDL-64E) count once: steps of zero are left out.
    """
    steps = np.mod(np.diff(azimuth.astype(np.int64), axis=1), AZIMUTH_TICKS)
    steps.sort(axis=1)
    zeros = (steps == 0).sum(axis=1)
    middle = zeros + (steps.shape[1] - zeros) // 2
    return np.take_along_axis(steps, np.minimum(middle, steps.shape[1] - 1)[:, None], 1)[:, 0]


def decode(payloads: NDArray[np.uint8], scanner: Scanner) -> Firings:
    """Decode payloads, shape (n, 1206), to firings in the order of the wire.

    The second firing of a VLP-16 block has no azimuth on the wire: it gets that of its block
    plus half the median step between the blocks of its packet, rounded to 0.01 degree.
    """
    packets = view(payloads)
    blocks = packets["blocks"]
    flag = blocks["flag"].reshape(-1)
    azimuth = blocks["azimuth"] % np.uint16(AZIMUTH_TICKS)
    channels = blocks["channels"]
    distance = np.ascontiguousarray(channels["distance"]).reshape(-1, scanner.lasers_per_firing)
    intensity = np.ascontiguousarray(channels["intensity"]).reshape(-1, scanner.lasers_per_firing)
    first_laser = np.where(flag == FLAG_LOWER, 32, 0).astype(np.uint8)
    timestamp = np.repeat(packets["timestamp"], BLOCKS)
    per_block = scanner.firings_per_block
    if per_block == 1:
        firing_azimuth = azimuth.reshape(-1).astype(np.int64)
    else:
        step = median_azimuth_step(azimuth)[:, None, None]
        late = np.rint(step * np.arange(per_block) / per_block).astype(np.int64)
        firing_azimuth = np.mod(azimuth[:, :, None] + late, AZIMUTH_TICKS).reshape(-1)
        first_laser, timestamp = (np.repeat(a, per_block) for a in (first_laser, timestamp))
    return Firings(firing_azimuth.astype(np.uint16), first_laser, timestamp, distance, intensity)


def encode(
    flag: NDArray[np.uint16],
    azimuth: NDArray[np.uint16],
    distance: NDArray[np.uint16],
    intensity: NDArray[np.uint8],
    timestamp: NDArray[np.uint32],
    status: NDArray[np.uint8],
) -> NDArray[np.uint8]:
    """Encode payloads, the inverse of `view`.

    Parameters
    ----------
    flag, azimuth : ndarray, shape (n, 12)
        Of every block.
    distance, intensity : ndarray, shape (n, 12, 32)
        Of every channel.
    timestamp : ndarray, shape (n,)
        Trailing four bytes.
    status : ndarray, shape (n, 2)
        Last two bytes: status type and value, or return mode and product.

    Returns
    -------
    ndarray of uint8, shape (n, 1206)
    """
    packets = np.zeros(len(timestamp), dtype=PACKET)
    packets["blocks"]["flag"] = flag
    packets["blocks"]["azimuth"] = azimuth
    packets["blocks"]["channels"]["distance"] = distance
    packets["blocks"]["channels"]["intensity"] = intensity
    packets["timestamp"] = timestamp
    packets["status"] = status
    return packets.view(np.uint8).reshape(-1, PAYLOAD_BYTES)
