"""Recordings of a simulated scanner: records of 1248 bytes, Ethernet, IP and UDP headers valid."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.packets.data import BLOCKS, CHANNELS, PAYLOAD_BYTES, encode
from velocal.packets.status import TABLE_PACKETS
from velocal.scanner.beam import laser_beams
from velocal.scanner.models import (
    AZIMUTH_TICK_DEG,
    AZIMUTH_TICKS,
    SCANNERS,
    Scanner,
)
from velocal.simulation.scene import Scene, cast, site_scene
from velocal.simulation.status import encode_table, status_bytes, table_packets
from velocal.simulation.truth import drift, factory_parameters, unit_truth
from velocal.simulation.world import World
from velocal.study.world import ScannerUnit

CHUNK_PACKETS = 2048
_HOUR_US = 3_600_000_000
#: Temperature of a scanner that has run for long without the halogen light.
STEADY_DEG_C = 46.0


def _network_header() -> bytes:
    """Ethernet, IPv4 and UDP header of a data packet broadcast by a scanner."""
    udp = struct.pack(">HHHH", 2368, 2368, 8 + PAYLOAD_BYTES, 0)
    fields = (0x45, 0, 28 + PAYLOAD_BYTES, 0, 0x4000, 64, 17)
    addresses = bytes((192, 168, 1, 201)) + bytes((255, 255, 255, 255))
    ip = struct.pack(">BBHHHBBH", *fields, 0) + addresses
    total = sum(struct.unpack(">10H", ip))
    checksum = ~(total % 0xFFFF) & 0xFFFF
    ip = struct.pack(">BBHHHBBH", *fields, checksum) + addresses
    ethernet = b"\xff" * 6 + bytes((0x60, 0x76, 0x88, 0, 0, 0)) + b"\x08\x00"
    return ethernet + ip + udp


@dataclass(frozen=True)
class Shots:
    """Shots at every raw azimuth: raw distances without noise, and the noise.

    Attributes
    ----------
    ticks, noise : ndarray of float32, shape (36000, n)
        Raw distance in fractional ticks, NaN if there is no return, and the standard deviation of
        a shot in ticks.
    intensity : ndarray of uint8, shape (36000, n)
    """

    ticks: NDArray[np.float32]
    noise: NDArray[np.float32]
    intensity: NDArray[np.uint8]


def shots_at(
    world: World,
    scanner_name: str,
    place: str | Scene,
    azimuths: NDArray[np.integer] | None = None,
) -> Shots:
    """Cast the beams of all lasers; all samples of a position share these shots.

    Parameters
    ----------
    world : World
    scanner_name : str
    place : str or Scene
        Position at the surveyed site, or another scene.
    azimuths : ndarray of int, optional
        Raw azimuths to cast at; the others have no return. All azimuths if omitted.
    """
    scanner = SCANNERS[scanner_name]
    unit, truth = world.scanner(scanner.name), unit_truth(world, scanner.name)
    scene = place if isinstance(place, Scene) else site_scene(world, scanner_name, place)
    rows = np.arange(AZIMUTH_TICKS) if azimuths is None else np.unique(azimuths)
    # A row for each laser: a column of the result lies in places of memory far from each other.
    ticks = np.full((scanner.n_lasers, len(rows)), np.nan, dtype=np.float32)
    noise = np.zeros_like(ticks)
    intensity = np.zeros(ticks.shape, dtype=np.uint8)
    errors = np.ascontiguousarray(scene.errors[rows].T)
    start = np.deg2rad(rows * AZIMUTH_TICK_DEG)
    rate = 2.0 * np.pi * unit.rotation_rate_hz
    for laser in range(scanner.n_lasers):
        # The head rotates further until a laser fires that is late in its firing.
        phi = start + rate * scanner.azimuth_delay_s[laser]
        direction, origin = laser_beams(phi, laser, truth.parameters)
        length, surface = cast(
            scene.surfaces, scene.pose.apply(origin), direction @ scene.pose.rotation.T
        )
        measured = truth.raw(length, laser) + errors[laser]
        seen = np.isfinite(length) & (length >= unit.min_range_m) & (measured > 0)
        ticks[laser, seen] = measured[seen] / scanner.distance_tick_m
        noise[laser, seen] = truth.noise(length[seen], laser) / scanner.distance_tick_m
        intensity[laser, seen] = scene.reflectance[surface[seen]]
    every = np.full((AZIMUTH_TICKS, scanner.n_lasers), np.nan, dtype=np.float32)
    found = Shots(every, np.zeros_like(every), np.zeros(every.shape, dtype=np.uint8))
    found.ticks[rows], found.noise[rows], found.intensity[rows] = ticks.T, noise.T, intensity.T
    return found


def records(
    world: World,
    scanner_name: str,
    position: str | Scene,
    sample: str,
    rotations: int,
    shots: Shots | None = None,
) -> Iterator[bytes]:
    """Simulate the recording of a sample.

    Parameters
    ----------
    world : World
    scanner_name, sample : str
        Scanner and name of the sample; the name selects its random numbers.
    position : str or Scene
        Position at the surveyed site, or another scene.
    rotations : int
        Least number of complete rotations in the recording.
    shots : Shots, optional
        Of the position; they are cast if omitted.

    Yields
    ------
    bytes
        Records of 1248 bytes, some thousands at a time.
    """
    scanner, unit = SCANNERS[scanner_name], world.scanner(scanner_name)
    rng = world.rng("shots", scanner_name, sample)
    drifts = drift(world, scanner_name, sample)
    packet_interval = 1.0 / scanner.packet_rate_hz
    firings_per_packet = BLOCKS * scanner.firings_per_block // len(scanner.flags)
    # More than one rotation is added: the recording begins and ends in the middle of a rotation.
    packets = int(np.ceil((rotations + 1.3) / unit.rotation_rate_hz / packet_interval))
    length_s = packets * packet_interval
    first_angle = rng.uniform(0.0, 360.0)
    first_stamp = int(rng.integers(0, _HOUR_US))
    header = np.frombuffer(_network_header(), dtype=np.uint8)
    trailing = _trailing(world, scanner, sample)
    within_packet = np.arange(firings_per_packet) * (packet_interval / firings_per_packet)

    def fired(number: NDArray[np.int64]) -> Array:
        return np.asarray((number[:, None] * packet_interval + within_packet).ravel())

    if shots is None:
        azimuths = None
        if packets * firings_per_packet < AZIMUTH_TICKS:  # it has few azimuths only
            azimuths = _ticks(first_angle + _turned(fired(np.arange(packets)), unit))
        shots = shots_at(world, scanner_name, position, azimuths)
    for begin in range(0, packets, CHUNK_PACKETS):
        number = np.arange(begin, min(begin + CHUNK_PACKETS, packets))
        time = number.astype(np.float64) * packet_interval
        firing_time = fired(number)
        angle = first_angle + _turned(firing_time, unit)
        ticks = _ticks(angle)
        azimuth = _ticks(angle, unit.encoder_step_ticks)
        shift = drifts.at(world.represented_s(firing_time, length_s)) / scanner.distance_tick_m
        ideal = shots.ticks[ticks]
        if isinstance(position, Scene) and position.between is not None:
            ideal = position.between(rng, firing_time, np.deg2rad(angle), ideal)
        noise = shots.noise[ticks]
        distance = _measure(
            rng, ideal, shift.astype(np.float32), noise, unit, scanner.distance_tick_m
        )
        intensity = shots.intensity[ticks] + rng.integers(
            0, 12, size=distance.shape, dtype=np.uint8
        )
        intensity[distance == 0] = 0
        stamp = first_stamp + np.rint(time * 1e6).astype(np.int64)
        status = trailing(number, world.represented_s(time, length_s), stamp)
        stamp %= _HOUR_US
        yield _packed(scanner, azimuth, distance, intensity, stamp, status, header)


def _trailing(
    world: World, scanner: Scanner, sample: str
) -> Callable[[NDArray[np.int64], Array, NDArray[np.int64]], NDArray[np.uint8]]:
    """Function that gives the last two bytes of packets, shape (n, 2).

    Its arguments are the numbers of the packets, the times of the experiment that they represent in
    seconds, and their time stamps in microseconds since the full hour.
    """
    if not scanner.embeds_calibration:
        mode = np.array([0x37, scanner.factory_byte or 0], dtype=np.uint8)
        return lambda number, represented_s, time_us: np.tile(mode, (len(number), 1))
    rpm = round(60.0 * world.scanner(scanner.name).rotation_rate_hz)
    packets = table_packets(encode_table(factory_parameters(world, scanner.name), rpm=rpm))
    # The recording begins anywhere in the table.
    first = int(world.rng("status", scanner.name, sample).integers(TABLE_PACKETS))
    return lambda number, represented_s, time_us: status_bytes(
        packets, first + number, time_us, STEADY_DEG_C + world.temperature_k(sample, represented_s)
    )


def _ticks(angle_deg: Array, step: int = 1) -> NDArray[np.int64]:
    """Raw azimuth of angles, a multiple of `step`."""
    turns = np.rint(angle_deg / (AZIMUTH_TICK_DEG * step)).astype(np.int64) * step
    return np.asarray(turns % AZIMUTH_TICKS)


def _turned(time: Array, unit: ScannerUnit) -> Array:
    """Degrees turned since the start; the rate swings slowly, period 7 s."""
    swing = 2.0 * np.pi / 7.0
    wobble = unit.rotation_rate_variation * (1.0 - np.cos(swing * time)) / swing
    return 360.0 * unit.rotation_rate_hz * (time + wobble)


def _measure(
    rng: np.random.Generator,
    ideal: NDArray[np.float32],
    shift: NDArray[np.float32],
    noise_ticks: NDArray[np.float32],
    unit: ScannerUnit,
    tick_m: float,
) -> NDArray[np.uint16]:
    """Add drift, noise, outliers and lost shots, and round to ticks."""
    shots = ideal + shift
    shots += rng.standard_normal(shots.shape, dtype=np.float32) * noise_ticks
    outliers = int(rng.binomial(shots.size, unit.errors.outlier_share))
    where = rng.integers(0, shots.size, outliers)
    size = unit.errors.outlier_cm * 1e-2 / tick_m
    shots.reshape(-1)[where] += (size * rng.standard_normal(outliers)).astype(np.float32)
    lost = int(rng.binomial(shots.size, unit.dropout))
    shots.reshape(-1)[rng.integers(0, shots.size, lost)] = np.nan
    np.nan_to_num(shots, copy=False)
    return np.asarray(np.clip(np.rint(shots, out=shots), 0, 65535, out=shots), dtype=np.uint16)


def _packed(
    scanner: Scanner,
    azimuth: NDArray[np.int64],
    distance: NDArray[np.uint16],
    intensity: NDArray[np.uint8],
    stamp: NDArray[np.int64],
    status: NDArray[np.uint8],
    header: NDArray[np.uint8],
) -> bytes:
    """Arrange firings in blocks and packets; upper and lower blocks of a firing alternate."""
    n = len(stamp)
    per_block = len(scanner.flags)
    block_azimuth = np.repeat(azimuth, per_block).reshape(n, BLOCKS)
    flag = np.tile(np.array(scanner.flags, dtype=np.uint16), BLOCKS // per_block)
    payload = encode(
        np.tile(flag, (n, 1)),
        block_azimuth.astype(np.uint16),
        distance.reshape(n, BLOCKS, CHANNELS),
        intensity.reshape(n, BLOCKS, CHANNELS),
        stamp.astype(np.uint32),
        status,
    )
    return np.concatenate([np.tile(header, (n, 1)), payload], axis=1).tobytes()
