"""Payload of a Velodyne data packet: 12 blocks of 100 bytes and 6 bytes at the end.

A block is a flag, an azimuth and 32 channels of distance and intensity, little-endian
(HDL-64E S2 manual, appendix E; HDL-32E and VLP-16 manuals, data packet format). Nothing here
assumes an order of blocks: the flag of a block tells which lasers it belongs to.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from velocal.scanner.models import AZIMUTH_TICKS, BANK_FLAGS, FLAG_LOWER, FLAG_UPPER

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
#: The same; flag and azimuth of a block are one number, so that both are gathered at once.
_HEAD = np.dtype([("head", "<u4"), ("channels", "V", BLOCK.itemsize - 4)])
_HEADS = np.dtype(
    [("blocks", _HEAD, (BLOCKS,)), ("rest", "V", PAYLOAD_BYTES - 12 * _HEAD.itemsize)]
)

#: Return modes in the last but one byte of every scanner but the HDL-64E (VLP-16 manual).
MODES = {0x37: "strongest", 0x38: "last", 0x39: "dual"}
#: A VLS-128 with two returns fills this many blocks and leaves the rest without a flag.
DUAL_BANKS_BLOCKS = 8
_NO_FLAGS = (0x0000, 0xFFFF)

#: Positions of the first byte of every block flag in a payload.
FLAG_POSITIONS = np.arange(BLOCKS) * BLOCK.itemsize


def view(payloads: NDArray[np.uint8]) -> NDArray[np.void]:
    """View payload bytes, shape (n, 1206), as packets without copying."""
    return np.ascontiguousarray(payloads).view(PACKET)[:, 0]


def flags_and_azimuths(
    packets: NDArray[np.void],
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Read flag and raw azimuth of every block.

    Parameters
    ----------
    packets : ndarray of PACKET, shape (n,)

    Returns
    -------
    flag : ndarray of uint16, shape (n, 12)
    azimuth : ndarray of uint16, shape (n, 12)
        0.01 degree, below one turn. Empty blocks have the azimuth of the last block before them.
    """
    flag, azimuth = _heads(packets)
    azimuth[azimuth == AZIMUTH_TICKS] = 0
    empty = (flag[:, -1] == _NO_FLAGS[0]) | (flag[:, -1] == _NO_FLAGS[1])
    if empty.any():
        azimuth[empty, DUAL_BANKS_BLOCKS:] = azimuth[empty, DUAL_BANKS_BLOCKS - 1, None]
    return flag, azimuth


def _heads(packets: NDArray[np.void]) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Flags and azimuths as they were sent, each of shape (n, 12)."""
    heads: NDArray[np.uint32] = np.ascontiguousarray(packets.view(_HEADS)["blocks"]["head"])
    return heads.astype(np.uint16), (heads >> np.uint32(16)).astype(np.uint16)


def check_payloads(payloads: NDArray[np.uint8]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Check block flags and azimuths of payloads; a payload is valid if both are.

    The last four blocks of a VLS-128 with two returns are empty and have no flag.

    Parameters
    ----------
    payloads : ndarray of uint8, shape (n, 1206)

    Returns
    -------
    flags_known : ndarray of bool, shape (n,)
        Whether all block flags are known.
    azimuths_valid : ndarray of bool, shape (n,)
        Whether all azimuths lie within one turn.
    """
    flags, azimuth = _heads(view(payloads))
    known = _in_all_blocks((flags == FLAG_UPPER) | (flags == FLAG_LOWER))
    # A VLP-16 was seen to send 36000 for a full turn.
    turn = _in_all_blocks(azimuth <= AZIMUTH_TICKS)
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


def _in_all_blocks(right: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether all values of a row are true: at once where all are, as nearly always."""
    return np.ones(len(right), dtype=bool) if right.all() else np.asarray(right.all(axis=1))


def median_azimuth_step(azimuth: NDArray[np.uint16]) -> NDArray[np.int64]:
    """Median of the steps of the azimuth in every packet.

    Blocks that share an azimuth (pairs of an HDL-64E) count once: steps of zero are left out.

    Parameters
    ----------
    azimuth : ndarray of uint16, shape (n, 12)
        0.01 degree.

    Returns
    -------
    ndarray of int64, shape (n,)
        0.01 degree; zero if all azimuths of a packet are equal.
    """
    # 32 bits are enough, and are sorted in half the time of 64.
    steps = np.diff(azimuth.astype(np.int32), axis=1)
    np.add(steps, AZIMUTH_TICKS, out=steps, where=steps < 0)
    zeros = np.ascontiguousarray((steps == 0).T).sum(axis=0)
    steps.sort(axis=1)
    middle = zeros + (steps.shape[1] - zeros) // 2
    found = np.take_along_axis(steps, np.minimum(middle, steps.shape[1] - 1)[:, None], 1)[:, 0]
    return found.astype(np.int64)


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
