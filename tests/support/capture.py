"""Small recordings built byte by byte, by other code than the library's."""

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from velocal.capture.ledger import Ledger
from velocal.capture.reading import open_capture
from velocal.capture.source import ANY_SOURCE, SourceFilter
from velocal.packets import data as packets

PAYLOAD = 1206
UPPER, LOWER = 0xEEFF, 0xDDFF
FIRST_SECOND = 1_400_000_000


def spin(
    n: int,
    *,
    start: int = 17_000,
    step: int = 150,
    stamp_us: int = 5_000_000,
    interval_us: int = 553,
    paired: bool = False,
    banks: int = 1,
    status: tuple[int, int] = (0x37, 0x21),
    seed: int = 0,
) -> np.ndarray:
    """Payloads of a head that turns evenly; `step` ticks from firing to firing."""
    rng = np.random.default_rng(seed)
    firing = np.arange(12 * n).reshape(n, 12)
    flag = np.full((n, 12), UPPER)
    banks = 2 if paired else banks
    flag += np.array([0, LOWER - UPPER, 0xCCFF - UPPER, 0xBBFF - UPPER])[np.arange(12) % banks]
    firing = firing // banks
    return packets.encode(
        flag.astype(np.uint16),
        ((start + step * firing) % 36_000).astype(np.uint16),
        rng.integers(0, 60_000, (n, 12, 32)).astype(np.uint16),
        rng.integers(0, 256, (n, 12, 32)).astype(np.uint8),
        ((stamp_us + interval_us * np.arange(n)) % 3_600_000_000).astype(np.uint32),
        np.tile(np.array(status, dtype=np.uint8), (n, 1)),
    )


def two_returns(payloads: np.ndarray, start: int = 17_000, step: int = 150) -> np.ndarray:
    """Packets that hold half as many shots, each twice; a quarter of the returns differ."""
    changed = payloads.copy()
    blocks = packets.view(changed)["blocks"]
    banks = len(set(blocks["flag"][0]))
    # Which of the former blocks each block now is.
    order = {
        1: [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5],
        2: [0, 1, 0, 1, 2, 3, 2, 3, 4, 5, 4, 5],
        4: [0, 0, 1, 1, 2, 2, 3, 3],  # and four blocks of nothing
    }[banks]
    used = len(order)
    blocks[:, :used] = blocks[:, order]
    blocks[:, used:] = 0
    firings = len(set(order)) // banks
    number = firings * np.arange(len(changed))[:, None] + np.array(order) // banks
    blocks["azimuth"][:, :used] = (start + step * number) % 36_000
    rng = np.random.default_rng(1)
    second = [k for k in range(used) if order.index(order[k]) != k]
    channels = blocks["channels"][:, second]
    apart = rng.random(channels.shape) < 0.25
    channels["distance"][apart] = rng.integers(0, 60_000, int(apart.sum()))
    channels["intensity"][apart] = rng.integers(0, 256, int(apart.sum()))
    blocks["channels"][:, second] = channels
    return changed


def as_bytes(payloads: np.ndarray) -> list[bytes]:
    return [bytes(payload) for payload in payloads]


def udp_frame(payload: bytes, *, ethertype: int = 0x0800, protocol: int = 17) -> bytes:
    """An Ethernet frame as a scanner broadcasts it."""
    ethernet = b"\xff" * 6 + b"\x60\x76\x88\x00\x00\x00" + struct.pack(">H", ethertype)
    ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 28 + len(payload), 1, 0, 128, protocol, 0,
                     bytes([192, 168, 1, 201]), b"\xff" * 4)  # fmt: skip
    udp = struct.pack(">HHHH", 2368, 2368, 8 + len(payload), 0)
    return ethernet + ip + udp + payload


def vlan_frame(payload: bytes) -> bytes:
    plain = udp_frame(payload)
    return plain[:12] + struct.pack(">HH", 0x8100, 5) + plain[12:]


def pcap_head(order: str = "<", ticks: int = 1_000_000, link: int = 1) -> bytes:
    magic = 0xA1B2C3D4 if ticks == 1_000_000 else 0xA1B23C4D
    return struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, 65_535, link)


def pcap_packet(
    frame: bytes,
    number: int = 0,
    *,
    order: str = "<",
    ticks: int = 1_000_000,
    captured: int | None = None,
) -> bytes:
    """A packet caught `number` times 553 us after the first."""
    microseconds = 40_000 + 553 * number
    kept = frame if captured is None else frame[:captured]
    return (
        struct.pack(
            order + "IIII",
            FIRST_SECOND + microseconds // 1_000_000,
            microseconds % 1_000_000 * (ticks // 1_000_000),
            len(kept),
            len(frame),
        )
        + kept
    )


def pcap(payloads: np.ndarray, order: str = "<", ticks: int = 1_000_000) -> bytes:
    return pcap_head(order, ticks) + b"".join(
        pcap_packet(udp_frame(payload), number, order=order, ticks=ticks)
        for number, payload in enumerate(as_bytes(payloads))
    )


def record_list(payloads: np.ndarray, header: int) -> list[bytes]:
    """Records of 1206 (header 0) or 1248 bytes (header 42)."""
    return [udp_frame(payload)[42 - header :] for payload in as_bytes(payloads)]


def write(folder: Path, content: bytes | Iterable[bytes], name: str = "recording") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else b"".join(content))
    return path


def scan(
    path: Path, source: SourceFilter = ANY_SOURCE
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, Ledger]:
    """Every valid payload of a file, where it begins, when it was caught, and the ledger."""
    reading = open_capture(path, source).read()
    chunks = list(reading)
    payloads = np.concatenate([np.empty((0, PAYLOAD), np.uint8)] + [c.payloads for c in chunks])
    offsets = np.concatenate([np.empty(0, np.int64)] + [c.offsets for c in chunks])
    times = [c.capture_time_s for c in chunks if c.capture_time_s is not None]
    return payloads, offsets, np.concatenate(times) if times else None, reading.ledger
