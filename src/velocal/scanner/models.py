"""Frozen descriptions of the scanners: layout on the wire, timing, nominal geometry.

Sources: HDL-64E S2 and S3 user's manuals (Velodyne 63-HDL64ES2, 63-HDL64ES3), HDL-32E user's manual
(63-9113), VLP-16 with Hi-Res (63-9243), VLP-32C (63-9325), VLS-128 (63-9483); what each number is
taken from is said where it stands. Angles are in radians, times in seconds, distances in metres.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.errors import ConfigError

#: One tick of the raw distance, metres, where a scanner does not say otherwise (VLP-32C, VLS-128).
DISTANCE_TICK_M = 0.002
#: Standard deviation of a distance, metres: "accuracy, one sigma" in the datasheets of the HDL-64E
#: and the HDL-32E.
RANGE_SIGMA_M = 0.02
#: The same of the VLP-16, its Hi-Res, the VLP-32C and the VLS-128: "typical accuracy +-3 cm".
RANGE_SIGMA_OF_PUCKS_M = 0.03
#: One tick of the raw azimuth, degrees.
AZIMUTH_TICK_DEG = 0.01
#: Raw azimuths in one turn.
AZIMUTH_TICKS = 36000

#: Block flags as little-endian 16-bit numbers: bytes FF EE and FF DD.
FLAG_UPPER = 0xEEFF
FLAG_LOWER = 0xDDFF
#: Flag of every bank of 32 lasers, FF EE to FF BB; only a VLS-128 has four.
BANK_FLAGS = (FLAG_UPPER, FLAG_LOWER, 0xCCFF, 0xBBFF)


class Family(Enum):
    """Scanners whose lasers fire in the same order: programs treat them alike."""

    HDL64 = "HDL-64E"
    HDL32 = "HDL-32E"
    VLP16 = "VLP-16"
    VLP32 = "VLP-32C"
    VLS128 = "VLS-128"
    #: Scanners that a user describes: only their clouds of points are read.
    DESCRIBED = "described"

    @property
    def interpolated(self) -> bool:
        """Whether the manufacturer's formula gives each laser the azimuth of its own firing.

        The manuals of the HDL-64E compute all lasers of a block with the azimuth of the block; the
        rotation until a laser fires is part of its rotational correction.
        """
        return self is not Family.HDL64


@dataclass(frozen=True)
class Scanner:
    """What must be known of a scanner to decode its packets and to place its lasers.

    Attributes
    ----------
    name : str
        Name used in sample tables and results.
    family : Family
        Which scanners fire as this one does.
    n_lasers : int
        Number of lasers; `laser_id` runs from 0 in the order of the wire.
    flags : tuple of int
        Block flags that occur, in the order of the laser ids (block `i` of 32 lasers).
    firings_per_block : int
        1, or 2 where one block of 32 channels holds two firings of 16 lasers (VLP-16).
    firing_cycle_s : float
        Time between two firings of the same laser.
    packet_rate_hz, dual_packet_rate_hz : float
        Packets per second with one and with two returns per shot; the second is NaN where the
        scanner has no such mode.
    firing_time_s : ndarray, shape (n_lasers,), or None
        Time from the start of a firing until each laser fires; None where it is not known.
    vertical_rad : ndarray, shape (n_lasers,)
        Nominal vertical angles.
    rotational_rad : ndarray, shape (n_lasers,)
        Nominal rotational angle corrections.
    horizontal_offset_m, vertical_offset_m : ndarray, shape (n_lasers,)
        Nominal offsets of the lasers. The beams of a scanner whose lasers stand in one column
        cross each other in front of the axis; `vertical_offset_m` is the height at which the line
        of each meets the axis.
    azimuth_bin_ticks : int
        Default width of an azimuth bin in raw azimuth ticks (0.01 deg).
    max_range_m : float
        Largest range that the manufacturer states.
    factory_byte : int or None
        Product byte at the end of the payload, where the scanner sends one.
    distance_tick_m : float
        One tick of the raw distance.
    other_factory_bytes : tuple of int
        Product bytes that were seen as well.
    borrowed_factory_bytes : tuple of int
        Product bytes of other models that early units of this model send.
    embeds_calibration : bool
        Whether the scanner sends its factory calibration in the status bytes of its packets.
    range_sigma_m : float
        Standard deviation of a distance in the datasheet.
    origin_height_m : float
        Height of the origin of the scanner frame above the bottom of the base, metres. The origin
        is the one of the maker's beam equations: the optical centre where a scanner is made to
        nominal values. That of an HDL-64E is taken at the bottom, since the file of the factory
        states the height of every laser (`voff`, 0.1 to 0.2 m).
    min_range_m : float
        Points of a cloud that are nearer are left out.
    """

    name: str
    family: Family
    n_lasers: int
    flags: tuple[int, ...]
    firings_per_block: int
    firing_cycle_s: float
    packet_rate_hz: float
    dual_packet_rate_hz: float
    azimuth_bin_ticks: int
    max_range_m: float
    factory_byte: int | None
    firing_time_s: Array | None = field(repr=False, compare=False)
    vertical_rad: Array = field(repr=False, compare=False)
    rotational_rad: Array = field(repr=False, compare=False)
    horizontal_offset_m: Array = field(repr=False, compare=False)
    vertical_offset_m: Array = field(repr=False, compare=False)
    distance_tick_m: float = DISTANCE_TICK_M
    other_factory_bytes: tuple[int, ...] = ()
    borrowed_factory_bytes: tuple[int, ...] = ()
    embeds_calibration: bool = False
    origin_height_m: float = 0.0
    range_sigma_m: float = RANGE_SIGMA_M
    min_range_m: float = 0.0

    @property
    def short_name(self) -> str:
        """Number of lasers, which ends the names of printed statements about the scanner."""
        return str(self.n_lasers)

    @property
    def lasers_per_firing(self) -> int:
        """Lasers in one firing of one block: 32, or 16 for the VLP-16; all without packets."""
        return 32 // self.firings_per_block if self.flags else self.n_lasers

    def azimuth_bin(self, width_deg: float | None) -> int:
        """Width of an azimuth bin in raw azimuth ticks.

        Parameters
        ----------
        width_deg : float or None
            Degrees; None for the default of the scanner.

        Returns
        -------
        int
            Hundredths of a degree.
        """
        return self.azimuth_bin_ticks if width_deg is None else round(width_deg / AZIMUTH_TICK_DEG)

    @property
    def paired(self) -> bool:
        """Whether the upper and lower lasers come in blocks of their own, in turn."""
        return len(self.flags) == 2

    @property
    def sends_status(self) -> bool:
        """Whether the last two bytes of a packet are a status type and its value.

        Those of all scanners but the HDL-64E are the return mode and the product byte.
        """
        return self.factory_byte is None and bool(self.flags)

    @property
    def coarse_encoder(self) -> bool:
        """Whether the encoder is too coarse to tell the firing cycle by single azimuth steps.

        That of an HDL-64E gives multiples of 0.09 degree.
        """
        return self.family is Family.HDL64

    @property
    def has_factory_file(self) -> bool:
        """Whether the factory measures each unit and delivers a calibration file with it."""
        return self.family is Family.HDL64

    @property
    def factory_bytes(self) -> tuple[int, ...]:
        """Every product byte that the scanner may send; empty if it sends no such byte."""
        return () if self.factory_byte is None else (self.factory_byte, *self.other_factory_bytes)

    @property
    def azimuth_delay_s(self) -> Array:
        """Time from the raw azimuth to the azimuth of each laser in the model, (n_lasers,).

        That is when the laser fires, or zero in families that the manufacturer does not
        interpolate.
        """
        if self.firing_time_s is None or not self.family.interpolated:
            return np.zeros(self.n_lasers)
        return self.firing_time_s


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


def _hdl64e(
    name: str, *, packet_rate_hz: float, firing_cycle_s: float, dual: bool = True
) -> Scanner:
    """Nominal HDL-64E: spacing 1/3 deg in the upper block (+2 down), 1/2 deg in the lower.

    Four lasers of a block fire at 0, 1.26, 2.46 and 3.66 us, the next four 6 us later (laser
    firing time table of the S2 manual); both blocks fire at once. With two returns a firing takes
    57.6 us and half as many fit into a packet (S3 manual). An S1 manual has no such table.
    """
    rank = _HDL64E_RANK
    vertical = np.concatenate([2.0 - rank / 3.0, -8.83 - 0.5 * rank])
    rotational = np.concatenate(
        [_HDL64E_UPPER_COLUMNS_DEG[rank % 12], _HDL64E_LOWER_COLUMNS_DEG[rank % 12]]
    )
    side = np.where(np.arange(64) % 2 == 0, 1.0, -1.0)
    lane = np.arange(64) % 32
    # The lasers of a block aim through one lens: their height follows their vertical angle.
    height = np.where(
        np.arange(64) < 32, 0.207 + 0.00125 * vertical, 0.115 + 0.00125 * (vertical + 17.0)
    )
    return Scanner(
        name=name,
        family=Family.HDL64,
        n_lasers=64,
        flags=(FLAG_UPPER, FLAG_LOWER),
        firings_per_block=1,
        firing_cycle_s=firing_cycle_s,
        packet_rate_hz=packet_rate_hz,
        dual_packet_rate_hz=1.0 / (3 * 57.6e-6) if dual else np.nan,
        azimuth_bin_ticks=9,
        max_range_m=120.0,
        factory_byte=None,
        vertical_rad=np.deg2rad(vertical),
        rotational_rad=np.deg2rad(rotational),
        horizontal_offset_m=0.026 * side,
        vertical_offset_m=height,
        firing_time_s=1e-6 * (6.0 * (lane // 4) + np.array([0.0, 1.26, 2.46, 3.66])[lane % 4])
        if dual
        else None,
        embeds_calibration=dual,
    )


def _one_column(
    name: str,
    family: Family,
    *,
    vertical_deg: NDArray[np.floating],
    firing_time_s: NDArray[np.floating],
    firing_cycle_s: float,
    firings_per_packet: int,
    azimuth_bin_ticks: int,
    max_range_m: float,
    factory_byte: int,
    origin_height_m: float,
    vertical_offset_mm: NDArray[np.floating],
    rotational_deg: NDArray[np.floating] | None = None,
    dual_packet_rate_hz: float | None = None,
    other_factory_bytes: tuple[int, ...] = (),
    borrowed_factory_bytes: tuple[int, ...] = (),
    distance_tick_m: float = DISTANCE_TICK_M,
    range_sigma_m: float = RANGE_SIGMA_OF_PUCKS_M,
) -> Scanner:
    """Describe a scanner with its lasers in one column, interpolated within a firing.

    Two returns a shot double the packets, as half as many firings fit into one.
    """
    n = len(vertical_deg)
    rate = 1.0 / (firings_per_packet * firing_cycle_s)
    return Scanner(
        name=name,
        family=family,
        n_lasers=n,
        flags=BANK_FLAGS[: -(-n // 32)],
        firings_per_block=32 // n or 1,
        dual_packet_rate_hz=dual_packet_rate_hz or 2.0 * rate,
        other_factory_bytes=other_factory_bytes,
        borrowed_factory_bytes=borrowed_factory_bytes,
        distance_tick_m=distance_tick_m,
        origin_height_m=origin_height_m,
        range_sigma_m=range_sigma_m,
        firing_cycle_s=firing_cycle_s,
        packet_rate_hz=rate,
        azimuth_bin_ticks=azimuth_bin_ticks,
        max_range_m=max_range_m,
        factory_byte=factory_byte,
        firing_time_s=np.asarray(firing_time_s, dtype=np.float64),
        vertical_rad=np.deg2rad(vertical_deg),
        rotational_rad=np.zeros(n) if rotational_deg is None else np.deg2rad(rotational_deg),
        horizontal_offset_m=np.zeros(n),
        vertical_offset_m=1e-3 * np.asarray(vertical_offset_mm, dtype=np.float64),
    )


def _crossing(vertical_deg: NDArray[np.floating], ahead_mm: float) -> Array:
    """Heights (mm) at which beams meet the axis that cross each other `ahead_mm` in front of it."""
    return np.asarray(-ahead_mm * np.tan(np.deg2rad(vertical_deg)))


# Envelope drawing 86-0106 of the HDL-32E, sheet 2: height at which each beam meets the axis, by
# laser (mm). That of 28.9 mm times the tangent of the angle, within 0.02 mm.
_HDL32E_OFFSET_MM = np.array(
    [17.17, 4.76, 16.27, 4.07, 15.40, 3.38, 14.54, 2.70, 13.71, 2.02, 12.89, 1.35, 12.09, 0.67,
     11.31, 0.00, 10.54, -0.67, 9.78, -1.35, 9.04, -2.02, 8.30, -2.70, 7.58, -3.38, 6.86, -4.07,
     6.15, -4.76, 5.45, -5.45]
)  # fmt: skip
# Envelope drawing 86-0129 of the VLP-16 Hi-Res, sheet 3: the same, by rank from the lowest.
_HI_RES_OFFSET_MM = np.array([7.4, 6.5, 5.5, 4.6, 3.7, 2.7, 1.8, 0.9])


def _hdl32e() -> Scanner:
    """HDL-32E: +10.67 to -30.67 deg in steps of 4/3 deg, fired low and middle in turn.

    The height of the optical centre is that of the drawings which ROS uses (package
    velodyne_description, HDL-32E.urdf.xacro); the vertical offsets stand in the envelope drawing
    86-0106, sheet 2.
    """
    pair = np.repeat(np.arange(16), 2)
    lower = np.arange(32) % 2 == 0
    return _one_column(
        "HDL-32E",
        Family.HDL32,
        vertical_deg=np.where(lower, -92.0 / 3.0, -28.0 / 3.0) + pair * 4.0 / 3.0,
        firing_time_s=1.152e-6 * np.arange(32.0),
        firing_cycle_s=46.08e-6,
        firings_per_packet=12,
        azimuth_bin_ticks=10,
        max_range_m=100.0,
        factory_byte=0x21,
        origin_height_m=0.09081,
        vertical_offset_mm=_HDL32E_OFFSET_MM,
        range_sigma_m=RANGE_SIGMA_M,
    )


def _vlp16(
    name: str,
    *,
    step_deg: float,
    factory_byte: int,
    offset_mm: NDArray[np.floating],
    borrowed: tuple[int, ...] = (),
) -> Scanner:
    """VLP-16: 16 lasers in even steps, two firings in a block of 32 channels.

    The steps are 2 deg (-15 to +15 deg), and 4/3 deg (-10 to +10 deg) of a Hi-Res; the timing is
    the same (VLP-16 manual, tables of vertical angles and of factory bytes). The origin is 37.7 mm
    above the base (the same, "Sensor origin and frame of reference"). `offset_mm` are the vertical
    offsets of the lower eight beams, from the lowest; those of the upper eight mirror them.
    """
    rank = np.arange(16) // 2 + np.where(np.arange(16) % 2 == 0, 0, 8)
    return _one_column(
        name,
        Family.VLP16,
        vertical_deg=step_deg * (rank - 7.5),
        firing_time_s=2.304e-6 * np.arange(16.0),
        firing_cycle_s=55.296e-6,
        firings_per_packet=24,
        azimuth_bin_ticks=20,
        max_range_m=100.0,
        factory_byte=factory_byte,
        borrowed_factory_bytes=borrowed,
        origin_height_m=0.0377,
        vertical_offset_mm=np.concatenate([offset_mm, -offset_mm[::-1]])[rank],
    )


# VLP-32C manual, table of vertical angles and azimuth offsets by laser (degrees). Its offsets add
# to the azimuth, the rotational angle corrections of this project are subtracted from it.
_VLP32C_VERTICAL_DEG = np.array(
    [-25, -1, -1.667, -15.639, -11.31, 0, -0.667, -8.843, -7.254, 0.333, -0.333, -6.148, -5.333,
     1.333, 0.667, -4, -4.667, 1.667, 1, -3.667, -3.333, 3.333, 2.333, -2.667, -3, 7, 4.667,
     -2.333, -2, 15, 10.333, -1.333]
)  # fmt: skip
_VLP32C_OFFSET_DEG = np.array(
    [1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4,
     1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, 1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4]
)  # fmt: skip


def _vlp32c() -> Scanner:
    """VLP-32C: two lasers fire at a time, every 2.304 us; ticks of 4 mm.

    The origin is 37.34 mm above the base (manual, "Sensor origin and frame of reference"). The
    beams cross 42.4 mm in front of the axis; no document lists the offsets, which follow from that
    length (it is the one that velodyne_decoder uses, src/calib_db.cpp).
    """
    return _one_column(
        "VLP-32C",
        Family.VLP32,
        vertical_deg=_VLP32C_VERTICAL_DEG,
        rotational_deg=-_VLP32C_OFFSET_DEG,
        firing_time_s=2.304e-6 * (np.arange(32) // 2),
        firing_cycle_s=55.296e-6,
        firings_per_packet=12,
        azimuth_bin_ticks=20,
        max_range_m=200.0,
        factory_byte=0x28,
        origin_height_m=0.03734,
        vertical_offset_mm=_crossing(_VLP32C_VERTICAL_DEG, 42.4),
        distance_tick_m=0.004,
    )


# VLS-128 manual, table of vertical angles by laser (degrees); its eight azimuth offsets repeat.
_VLS128_VERTICAL_DEG = np.array(
    [-11.742, -1.99, 3.4, -5.29, -0.78, 4.61, -4.08, 1.31, -6.5, -1.11, 4.28, -4.41, 0.1, 6.48,
     -3.2, 2.19, -3.86, 1.53, -9.244, -1.77, 2.74, -5.95, -0.56, 4.83, -2.98, 2.41, -6.28, -0.89,
     3.62, -5.07, 0.32, 7.58, -0.34, 5.18, -3.64, 1.75, -25, -2.43, 2.96, -5.73, 0.54, 9.7, -2.76,
     2.63, -7.65, -1.55, 3.84, -4.85, 3.18, -5.51, -0.12, 5.73, -4.3, 1.09, -16.042, -2.21, 4.06,
     -4.63, 0.76, 15, -3.42, 1.97, -6.85, -1.33, -5.62, -0.23, 5.43, -3.53, 0.98, -19.582, -2.32,
     3.07, -4.74, 0.65, 11.75, -2.65, 1.86, -7.15, -1.44, 3.95, -2.1, 3.29, -5.4, -0.01, 4.5,
     -4.19, 1.2, -13.565, -1.22, 4.17, -4.52, 0.87, 6.08, -3.31, 2.08, -6.65, 1.42, -10.346, -1.88,
     3.51, -6.06, -0.67, 4.72, -3.97, 2.3, -6.39, -1, 4.39, -5.18, 0.21, 6.98, -3.09, 4.98, -3.75,
     1.64, -8.352, -2.54, 2.85, -5.84, -0.45, 8.43, -2.87, 2.52, -6.17, -1.66, 3.73, -4.96, 0.43]
)  # fmt: skip
_VLS128_ROTATIONAL_DEG = np.array([-6.354, -4.548, -2.732, -0.911, 0.911, 2.732, 4.548, 6.354])


def _vls128() -> Scanner:
    """VLS-128 (Alpha Prime): eight lasers fire at a time, in four banks of 32.

    A group of eight takes 2.665 us, with a pause of one group after the eighth and of three after
    the last: 53.3 us (VLS-128 manual, firing sequence; later firmware is 8 % slower). The four
    blocks of a firing have the azimuth of its first group. Three firings fill a packet; with two
    returns it holds one, in eight blocks, and four blocks without a flag. 0x63 is the product byte
    of the manuals, 0xA1 that of delivered units (ROS driver). The origin is 66.11 mm above the base
    (manual, "Sensor origin and frame of reference"). The beams cross 58.63 mm in front of the axis
    (velodyne_decoder, src/calib_db.cpp), from which the vertical offsets follow.
    """
    group = np.arange(128) // 8
    return _one_column(
        "VLS-128",
        Family.VLS128,
        vertical_deg=_VLS128_VERTICAL_DEG,
        rotational_deg=np.tile(_VLS128_ROTATIONAL_DEG, 16),
        firing_time_s=2.665e-6 * (group + group // 8),
        firing_cycle_s=53.3e-6,
        firings_per_packet=3,
        azimuth_bin_ticks=20,
        max_range_m=245.0,
        factory_byte=0xA1,
        origin_height_m=0.06611,
        vertical_offset_mm=_crossing(_VLS128_VERTICAL_DEG, 58.63),
        other_factory_bytes=(0x63,),
        dual_packet_rate_hz=1.0 / 53.3e-6,
        distance_tick_m=0.004,
    )


#: Every scanner that can be named in a sample table. "HDL-64E" is an S2; an S3 has the same blocks.
SCANNERS: dict[str, Scanner] = {
    scanner.name: scanner
    for scanner in (
        _hdl64e("HDL-64E", packet_rate_hz=3472.17, firing_cycle_s=48.0e-6),
        _hdl64e("HDL-64E-S1", packet_rate_hz=2500.0, firing_cycle_s=100.0e-6, dual=False),
        _hdl64e("HDL-64E-S3", packet_rate_hz=3472.17, firing_cycle_s=48.0e-6),
        _hdl32e(),
        # Manual, table of vertical angles and vertical corrections: 11.2 to 0.7 mm, which is the
        # drawing's 41.91 mm times the tangent of the angle, rounded.
        _vlp16(
            "VLP-16",
            step_deg=2.0,
            factory_byte=0x22,
            offset_mm=_crossing(np.arange(-15.0, 0.0, 2.0), 41.91),
            borrowed=(0x21,),
        ),
        _vlp16("VLP-16-Hi-Res", step_deg=4.0 / 3.0, factory_byte=0x24, offset_mm=_HI_RES_OFFSET_MM),
        _vlp32c(),
        _vls128(),
    )
}


def scanner_named(name: str, *, where: str | None = None) -> Scanner:
    """Look up a scanner.

    Parameters
    ----------
    name : str
    where : str, optional
        Where the name stands, for the error.

    Returns
    -------
    Scanner

    Raises
    ------
    ConfigError
        If no scanner of that name is known.
    """
    try:
        return SCANNERS[name]
    except KeyError:
        like = difflib.get_close_matches(name.upper(), SCANNERS, n=1)
        series = "An HDL-64E of the first series is HDL-64E-S1; S2 is HDL-64E."
        raise ConfigError(
            f"unknown scanner {name!r}",
            where=where,
            allowed=", ".join(SCANNERS),
            hint=f"Did you mean {like[0]!r}?" if like else series,
        ) from None
