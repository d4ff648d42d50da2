"""Frozen descriptions of the scanners: layout on the wire, timing, nominal geometry.

Sources: HDL-64E S2 user's manual (Velodyne 63-HDL64ES2), HDL-32E user's manual (63-9113),
VLP-16 user's manual (63-9243). Angles are in radians, times in seconds, distances in metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from velocal.errors import ConfigError

#: One tick of the raw distance, metres (all scanners described here).
DISTANCE_TICK_M = 0.002
#: One tick of the raw azimuth, degrees.
AZIMUTH_TICK_DEG = 0.01
#: Raw azimuths in one turn.
AZIMUTH_TICKS = 36000

#: Block flags as little-endian 16-bit numbers: bytes FF EE and FF DD.
FLAG_UPPER = 0xEEFF
FLAG_LOWER = 0xDDFF


@dataclass(frozen=True)
class Scanner:
    """What must be known of a scanner to decode its packets and to place its lasers.

    Attributes
    ----------
    name : str
        Name used in sheets and results.
    n_lasers : int
        Number of lasers; `laser_id` runs from 0 in the order of the wire.
    flags : tuple of int
        Block flags that occur, in the order of the laser ids (block `i` of 32 lasers).
    firings_per_block : int
        1, or 2 where one block of 32 channels holds two firings of 16 lasers (VLP-16).
    firing_cycle_s : float
        Time between two firings of the same laser.
    packet_rate_hz : float
        Packets per second in single-return mode.
    firing_offset_s : ndarray, shape (n_lasers,)
        Time of a laser after the start of its firing, for azimuth interpolation; zero where
        the manufacturer's point formula gives all lasers of a block the same azimuth.
    vertical_rad : ndarray, shape (n_lasers,)
        Nominal vertical angles.
    rotational_rad : ndarray, shape (n_lasers,)
        Nominal rotational angle corrections.
    horizontal_offset_m, vertical_offset_m : ndarray, shape (n_lasers,)
        Nominal offsets of the lasers.
    cell_ticks : int
        Default width of an angle cell in raw azimuth ticks (0.01 deg).
    max_range_m : float
        Largest range that the manufacturer states.
    factory_byte : int or None
        Product byte at the end of the payload, where the scanner sends one.
    """

    name: str
    n_lasers: int
    flags: tuple[int, ...]
    firings_per_block: int
    firing_cycle_s: float
    packet_rate_hz: float
    cell_ticks: int
    max_range_m: float
    factory_byte: int | None
    firing_offset_s: NDArray[np.float64] = field(repr=False, compare=False)
    vertical_rad: NDArray[np.float64] = field(repr=False, compare=False)
    rotational_rad: NDArray[np.float64] = field(repr=False, compare=False)
    horizontal_offset_m: NDArray[np.float64] = field(repr=False, compare=False)
    vertical_offset_m: NDArray[np.float64] = field(repr=False, compare=False)

    @property
    def lasers_per_firing(self) -> int:
        """Lasers in one firing of one block: 32, or 16 for the VLP-16."""
        return 32 // self.firings_per_block

    @property
    def paired(self) -> bool:
        """True where the upper and lower lasers come in blocks of their own (HDL-64E)."""
        return len(self.flags) == 2


# HDL-64E: rank from the top of its block of each of the 32 lasers of a block, in the order of
# the wire; the same in both blocks.
_HDL64E_RANK = np.array(
    [27, 26, 5, 4, 25, 24, 31, 30, 23, 22, 29, 28, 15, 14, 21, 20,
     13, 12, 19, 18, 11, 10, 17, 16, 3, 2, 9, 8, 1, 0, 7, 6]
)  # fmt: skip
# Rotational angles (degrees) repeat every twelve ranks: the lasers sit in columns.
_HDL64E_UPPER_COLUMNS_DEG = np.array(
    [2.1, -0.1, -2.2, -4.4, 5.7, 3.4, 1.3, -0.9, -2.9, -5.2, 6.4, 4.2]
)
_HDL64E_LOWER_COLUMNS_DEG = np.array(
    [2.9, -0.4, -3.7, -7.0, 8.4, 5.1, 1.7, -1.7, -4.9, -8.4, 9.6, 6.3]
)


def _hdl64e(name: str, *, packet_rate_hz: float, firing_cycle_s: float) -> Scanner:
    """Nominal HDL-64E: spacing 1/3 deg in the upper block (+2 down), 1/2 deg in the lower."""
    rank = _HDL64E_RANK
    vertical = np.concatenate([2.0 - rank / 3.0, -8.83 - 0.5 * rank])
    rotational = np.concatenate(
        [_HDL64E_UPPER_COLUMNS_DEG[rank % 12], _HDL64E_LOWER_COLUMNS_DEG[rank % 12]]
    )
    side = np.where(np.arange(64) % 2 == 0, 1.0, -1.0)
    # The lasers of a block aim through one lens: their height follows their vertical angle.
    height = np.where(
        np.arange(64) < 32, 0.207 + 0.00125 * vertical, 0.115 + 0.00125 * (vertical + 17.0)
    )
    return Scanner(
        name=name,
        n_lasers=64,
        flags=(FLAG_UPPER, FLAG_LOWER),
        firings_per_block=1,
        firing_cycle_s=firing_cycle_s,
        packet_rate_hz=packet_rate_hz,
        cell_ticks=9,
        max_range_m=120.0,
        factory_byte=None,
        firing_offset_s=np.zeros(64),
        vertical_rad=np.deg2rad(vertical),
        rotational_rad=np.deg2rad(rotational),
        horizontal_offset_m=0.026 * side,
        vertical_offset_m=height,
    )


def _hdl32e() -> Scanner:
    """HDL-32E: +10.67 to -30.67 deg in steps of 4/3 deg, fired low and middle in turn."""
    pair = np.repeat(np.arange(16), 2)
    lower = np.arange(32) % 2 == 0
    vertical = np.where(lower, -92.0 / 3.0, -28.0 / 3.0) + pair * 4.0 / 3.0
    return Scanner(
        name="HDL-32E",
        n_lasers=32,
        flags=(FLAG_UPPER,),
        firings_per_block=1,
        firing_cycle_s=46.08e-6,
        packet_rate_hz=1.0 / (12 * 46.08e-6),
        cell_ticks=10,
        max_range_m=100.0,
        factory_byte=0x21,
        firing_offset_s=1.152e-6 * np.arange(32.0),
        vertical_rad=np.deg2rad(vertical),
        rotational_rad=np.zeros(32),
        horizontal_offset_m=np.zeros(32),
        vertical_offset_m=np.zeros(32),
    )


def _vlp16() -> Scanner:
    """VLP-16: -15 to +15 deg in steps of 2 deg, two firings in a block of 32 channels."""
    vertical = np.where(np.arange(16) % 2 == 0, -15.0, 0.0) + np.arange(16)
    return Scanner(
        name="VLP-16",
        n_lasers=16,
        flags=(FLAG_UPPER,),
        firings_per_block=2,
        firing_cycle_s=55.296e-6,
        packet_rate_hz=1.0 / (24 * 55.296e-6),
        cell_ticks=20,
        max_range_m=100.0,
        factory_byte=0x22,
        firing_offset_s=2.304e-6 * np.arange(16.0),
        vertical_rad=np.deg2rad(vertical),
        rotational_rad=np.zeros(16),
        horizontal_offset_m=np.zeros(16),
        vertical_offset_m=np.zeros(16),
    )


#: Every scanner that can be named in a sheet. "HDL-64E" is the S2 of the study.
SCANNERS: dict[str, Scanner] = {
    scanner.name: scanner
    for scanner in (
        _hdl64e("HDL-64E", packet_rate_hz=3472.17, firing_cycle_s=48.0e-6),
        _hdl64e("HDL-64E-S1", packet_rate_hz=2500.0, firing_cycle_s=100.0e-6),
        _hdl32e(),
        _vlp16(),
    )
}


def scanner_named(name: str, *, where: str | None = None) -> Scanner:
    """Look up a scanner.

    Raises
    ------
    ConfigError
        If no scanner of that name is known.
    """
    try:
        return SCANNERS[name]
    except KeyError:
        raise ConfigError(
            f"unknown scanner {name!r}",
            where=where,
            allowed=", ".join(SCANNERS),
            hint="An HDL-64E of the first series is HDL-64E-S1; S2 is HDL-64E.",
        ) from None
