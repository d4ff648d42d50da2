"""Firings: the returns in payloads, with their lasers and azimuths."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import joined_rows, rows_of
from velocal.packets.data import BLOCKS, flags_and_azimuths, median_azimuth_step, view
from velocal.packets.dual import (
    LAST,
    ONLY,
    STRONGEST,
    DualLayout,
    check_choice,
    dual_layout,
    dual_packets,
)
from velocal.scanner.models import AZIMUTH_TICKS, BANK_FLAGS, Scanner


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

    def __getitem__(self, rows: NDArray[np.generic] | slice) -> Firings:
        return rows_of(self, rows)


def decode(payloads: NDArray[np.uint8], scanner: Scanner, returns: str = "both") -> Firings:
    """Decode payloads to firings, in the order of the wire.

    Parameters
    ----------
    payloads : ndarray of uint8, shape (n, 1206)
    scanner : Scanner
    returns : {"both", "strongest", "last"}
        Which of the two returns of a shot, where packets hold two (it may change from packet to
        packet): both firings, in their order,
        or one with the return of the greater intensity or distance. The block of the strongest
        holds the second strongest where the strongest is the last (VLP-16 manual), so neither
        block is taken as it is.

    Returns
    -------
    Firings

    Raises
    ------
    ConfigError
        If `returns` is unknown.
    """
    check_choice(returns)
    packets = view(payloads)
    flag, azimuth = flags_and_azimuths(packets)
    two = dual_packets(flag, azimuth)
    edges = [0, *(np.flatnonzero(two[1:] != two[:-1]) + 1).tolist(), len(two)]
    parts = [
        _decode(packets[a:b], flag[a:b], azimuth[a:b], scanner, dual=bool(two[a]), returns=returns)
        for a, b in pairwise(edges)
        if a < b
    ]
    if len(parts) == 1:
        return parts[0]
    if not parts:
        return _decode(packets, flag, azimuth, scanner, dual=False, returns=returns)
    starts = zip(edges, parts, strict=False)
    return joined_rows([replace(part, block=part.block + BLOCKS * a) for a, part in starts])


def _decode(
    packets: NDArray[np.void],
    flag: NDArray[np.uint16],
    azimuth: NDArray[np.uint16],
    scanner: Scanner,
    *,
    dual: bool,
    returns: str,
) -> Firings:
    """Decode packets that all hold one return of a shot, or all two; see `decode`."""
    channels = packets["blocks"]["channels"]
    width, per_block = scanner.lasers_per_firing, scanner.firings_per_block
    block = np.repeat(np.arange(flag.size), per_block)
    layout = dual_layout(scanner) if dual else None
    firings = Firings(
        azimuth=_azimuths(azimuth, per_block),
        first_laser=np.repeat(_first_lasers(flag.reshape(-1), scanner), per_block),
        timestamp=np.repeat(packets["timestamp"], BLOCKS * per_block),
        distance=np.ascontiguousarray(channels["distance"]).reshape(-1, width),
        intensity=np.ascontiguousarray(channels["intensity"]).reshape(-1, width),
        block=block,
        which=np.full(len(block), ONLY, dtype=np.uint8) if layout is None else layout.which(block),
    )
    if scanner.flags == BANK_FLAGS:
        # With two returns, a scanner of four banks leaves four blocks of a packet empty.
        firings = firings[np.isin(flag.reshape(-1), BANK_FLAGS)[block]]
    if layout is None or returns == "both":
        return firings
    return _one_return(firings, layout, per_block, returns)


def _first_lasers(flag: NDArray[np.uint16], scanner: Scanner) -> NDArray[np.uint8]:
    """First `laser_id` of blocks by their flag; 0 for a flag that the scanner does not send."""
    first = np.zeros(len(flag), dtype=np.uint8)
    for bank, of_bank in enumerate(scanner.flags[1:], start=1):
        first += (flag == of_bank).view(np.uint8) * np.uint8(32 * bank)
    return first


def _azimuths(azimuth: NDArray[np.uint16], per_block: int) -> NDArray[np.uint16]:
    """Azimuth of every firing, from those of the blocks, shape (n, 12).

    The second firing of a VLP-16 block has no azimuth on the wire: it gets that of its block
    plus half the median step between the blocks of its packet, rounded to 0.01 degree.
    """
    if per_block == 1:
        return azimuth.reshape(-1)
    step = median_azimuth_step(azimuth)[:, None, None]
    late = np.rint(step * np.arange(per_block) / per_block).astype(np.int64)
    firing = np.mod(azimuth[:, :, None] + late, AZIMUTH_TICKS)
    return np.asarray(firing.reshape(-1), dtype=np.uint16)


def _one_return(firings: Firings, layout: DualLayout, per_block: int, returns: str) -> Firings:
    """Make one firing of every two that hold the returns of the same shots."""
    first = np.flatnonzero(~layout.is_second(firings.block))
    one = firings[first]
    other = firings[first + layout.blocks_apart * per_block]
    if returns == "last":
        better = other.distance > one.distance
    else:
        intensity = np.where(one.distance > 0, one.intensity.astype(np.int16), -1)
        others = np.where(other.distance > 0, other.intensity.astype(np.int16), -1)
        # Of two equal returns, the block that is meant for the strongest one decides.
        better = others > intensity if layout.first == STRONGEST else others >= intensity
    return replace(
        one,
        distance=np.where(better, other.distance, one.distance),
        intensity=np.where(better, other.intensity, one.intensity),
        which=np.full(len(one), STRONGEST if returns == "strongest" else LAST, dtype=np.uint8),
    )
