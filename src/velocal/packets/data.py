"""Payload of a Velodyne data packet: 12 blocks of 100 bytes and 6 bytes at the end.

A block is a flag, an azimuth and 32 channels of distance and intensity, little-endian
(HDL-64E S2 manual, appendix E; HDL-32E and VLP-16 manuals, data packet format). Nothing here
assumes an order of blocks: which lasers a block belongs to is told by its flag.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from velocal.scanner.models import AZIMUTH_TICKS, BANK_FLAGS, FLAG_LOWER, FLAG_UPPER, Scanner

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

#: Return modes in the last but one byte of every scanner but the HDL-64E (VLP-16 manual).
MODES = {0x37: "strongest", 0x38: "last", 0x39: "dual"}
#: Which return a row of a table is: the only one of its shot, or one of two.
ONLY, STRONGEST, LAST = 0, 1, 2
#: What can be asked for of a shot with two returns.
CHOICES = ("both", "strongest", "last")
#: A VLS-128 with two returns fills this many blocks and leaves the rest without a flag.
DUAL_BANKS_BLOCKS = 8
_NO_FLAGS = (0x0000, 0xFFFF)

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
        `laser_id` of the first column: 32 for a lower block of an HDL-64E, else 0; any bank of a
        VLS-128.
    timestamp : ndarray of uint32, shape (n,)
        Trailing four bytes of the firing's packet; a device time in microseconds of the hour
        where the scanner sends one.
    distance : ndarray of uint16, shape (n, k)
        Raw distance, `Scanner.distance_tick_m`; 0 where nothing came back.
    intensity : ndarray of uint8, shape (n, k)
        Raw intensity.
    block : ndarray of int64, shape (n,)
        Block of the firing, counted over all packets.
    which : ndarray of uint8, shape (n,)
        `ONLY`, `STRONGEST` or `LAST`.
    """

    azimuth: NDArray[np.uint16]
    first_laser: NDArray[np.uint8]
    timestamp: NDArray[np.uint32]
    distance: NDArray[np.uint16]
    intensity: NDArray[np.uint8]
    block: NDArray[np.int64]
    which: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.azimuth)

    def laser_id(self) -> NDArray[np.uint8]:
        """`laser_id` of every return, shape (n, k)."""
        columns = np.arange(self.distance.shape[1], dtype=np.uint8)
        return self.first_laser[:, None] + columns

    def __getitem__(self, rows: NDArray[np.generic]) -> Firings:
        return Firings(*(getattr(self, field.name)[rows] for field in fields(self)))


def view(payloads: NDArray[np.uint8]) -> NDArray[np.void]:
    """View payload bytes, shape (n, 1206), as packets without copying."""
    return np.ascontiguousarray(payloads).view(PACKET)[:, 0]


def flags_and_azimuths(
    packets: NDArray[np.void],
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Flag and raw azimuth below one turn of every block, shape (n, 12).

    Empty blocks get the azimuth of the one before.
    """
    flag = np.ascontiguousarray(packets["blocks"]["flag"])
    azimuth = np.ascontiguousarray(packets["blocks"]["azimuth"])
    azimuth[azimuth == AZIMUTH_TICKS] = 0
    empty = (flag[:, -1] == _NO_FLAGS[0]) | (flag[:, -1] == _NO_FLAGS[1])
    if empty.any():
        azimuth[empty, DUAL_BANKS_BLOCKS:] = azimuth[empty, DUAL_BANKS_BLOCKS - 1, None]
    return flag, azimuth


def check_payloads(payloads: NDArray[np.uint8]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Tell which payloads have only known block flags, and which only azimuths in one turn.

    The last four blocks of a VLS-128 with two returns are empty and have no flag.

    Returns
    -------
    flags_known, azimuths_valid : ndarray of bool, shape (n,)
    """
    blocks = view(payloads)["blocks"]
    flags = np.ascontiguousarray(blocks["flag"])
    # A VLP-16 was seen to send 36000 for a full turn.
    known: NDArray[np.bool_] = ((flags == FLAG_UPPER) | (flags == FLAG_LOWER)).all(axis=1)
    azimuth = np.ascontiguousarray(blocks["azimuth"])
    turn = np.asarray((azimuth <= AZIMUTH_TICKS).all(axis=1))
    if not known.all():
        rest = np.flatnonzero(~known)
        of_bank = np.isin(flags[rest], BANK_FLAGS)
        full = of_bank[:, :DUAL_BANKS_BLOCKS].all(axis=1)
        tail = flags[rest][:, DUAL_BANKS_BLOCKS:]
        empty = full & np.isin(tail, _NO_FLAGS).all(axis=1)
        known[rest] = of_bank.all(axis=1) | empty
        used = azimuth[rest[empty], :DUAL_BANKS_BLOCKS]
        turn[rest[empty]] = (used <= AZIMUTH_TICKS).all(axis=1)
    return known, turn


def two_returns(flag: NDArray[np.uint16], azimuth: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """Tell which packets, shape (n, 12), hold every shot twice: blocks share flag and azimuth.

    The two returns of a shot lie in blocks 0 and 1, 2 and 3, ... (manuals of HDL-32E, VLP-16,
    VLP-32C and VLS-128), those of an HDL-64E in blocks 0 and 2, 1 and 3, 4 and 6, ... (S3
    manual; it does not say so in any byte).
    """
    both = flag.astype(np.uint32) << np.uint32(16) | azimuth
    # Where the head stands still, all blocks are alike and nothing can be told.
    pairs = (both[:, 0::2] == both[:, 1::2]).all(axis=1) & (both[:, 0] != both[:, 2])
    quads = both.reshape(-1, 3, 2, 2)
    paired = (quads[:, :, 0] == quads[:, :, 1]).all(axis=(1, 2))
    paired &= (flag[:, 0] != flag[:, 1]) & (azimuth[:, 0] != azimuth[:, 4])
    return np.asarray(pairs | paired)


def median_azimuth_step(azimuth: NDArray[np.uint16]) -> NDArray[np.int64]:
    """Median of the differences of the azimuths in every packet, shape (n, 12) to (n,).

    Blocks that share an azimuth (pairs of an HDL-64E) count once: steps of zero are left out.
    """
    steps = np.mod(np.diff(azimuth.astype(np.int64), axis=1), AZIMUTH_TICKS)
    steps.sort(axis=1)
    zeros = (steps == 0).sum(axis=1)
    middle = zeros + (steps.shape[1] - zeros) // 2
    return np.take_along_axis(steps, np.minimum(middle, steps.shape[1] - 1)[:, None], 1)[:, 0]


def decode(payloads: NDArray[np.uint8], scanner: Scanner, returns: str = "both") -> Firings:
    """Decode payloads, shape (n, 1206), to firings in the order of the wire.

    The second firing of a VLP-16 block has no azimuth on the wire: it gets that of its block
    plus half the median step between the blocks of its packet, rounded to 0.01 degree.

    Parameters
    ----------
    payloads : ndarray of uint8, shape (n, 1206)
    scanner : Scanner
    returns : {"both", "strongest", "last"}
        Which of the two returns of a shot, where packets hold two: both firings, in their order,
        or one with the return of the greater intensity or distance. The block of the strongest
        holds the second strongest where the strongest is the last (VLP-16 manual), so neither
        block is taken as it is.
    """
    packets = view(payloads)
    blocks = packets["blocks"]
    flags, azimuth = flags_and_azimuths(packets)
    flag = flags.reshape(-1)
    channels = blocks["channels"]
    distance = np.ascontiguousarray(channels["distance"]).reshape(-1, scanner.lasers_per_firing)
    intensity = np.ascontiguousarray(channels["intensity"]).reshape(-1, scanner.lasers_per_firing)
    first_laser = np.zeros(len(flag), dtype=np.uint8)
    for bank, of_bank in enumerate(scanner.flags[1:], start=1):
        first_laser[flag == of_bank] = 32 * bank
    timestamp = np.repeat(packets["timestamp"], BLOCKS)
    per_block = scanner.firings_per_block
    block = np.repeat(np.arange(len(flag)), per_block)
    if per_block == 1:
        firing_azimuth = azimuth.reshape(-1).astype(np.int64)
    else:
        step = median_azimuth_step(azimuth)[:, None, None]
        late = np.rint(step * np.arange(per_block) / per_block).astype(np.int64)
        firing_azimuth = np.mod(azimuth[:, :, None] + late, AZIMUTH_TICKS).reshape(-1)
        first_laser, timestamp = (np.repeat(a, per_block) for a in (first_laser, timestamp))
    # A damaged or standing packet among others does not change what a scanner is set to.
    dual = 2 * np.count_nonzero(two_returns(flags, azimuth)) > len(packets)
    which = np.full(len(block), ONLY, dtype=np.uint8)
    if dual:
        second = block % 4 >= 2 if scanner.paired else block % 2 == 1
        # HDL-64E: strongest, then last; all others: last, then strongest.
        which = np.where(second == scanner.paired, LAST, STRONGEST).astype(np.uint8)
    firings = Firings(
        firing_azimuth.astype(np.uint16),
        first_laser,
        timestamp,
        distance,
        intensity,
        block,
        which,
    )
    if scanner.flags == BANK_FLAGS:
        firings = firings[np.isin(np.repeat(flag, per_block), BANK_FLAGS)]
    return _chosen(firings, scanner, returns) if dual and returns != "both" else firings


def _chosen(firings: Firings, scanner: Scanner, returns: str) -> Firings:
    """One firing for every two that are the returns of the same shots."""
    apart = (2 if scanner.paired else 1) * scanner.firings_per_block
    second = firings.block % 4 >= 2 if scanner.paired else firings.block % 2 == 1
    mine = np.flatnonzero(~second)
    other = firings[mine + apart]
    one = firings[mine]
    if returns == "last":
        better = other.distance > one.distance
    else:
        # Of two alike the block that is said to hold the strongest.
        seen = np.where(one.distance > 0, one.intensity.astype(np.int16), -1)
        others = np.where(other.distance > 0, other.intensity.astype(np.int16), -1)
        better = others > seen if scanner.paired else others >= seen
    return replace(
        one,
        distance=np.where(better, other.distance, one.distance),
        intensity=np.where(better, other.intensity, one.intensity),
        which=np.full(len(one), STRONGEST if returns == "strongest" else LAST, dtype=np.uint8),
    )


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
