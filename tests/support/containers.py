"""One capture in every container: bytes put together by other code than the library's."""

import bz2
import gzip
import lzma
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from support.capture import FIRST_SECOND, as_bytes, pcap_head, pcap_packet, udp_frame

ADDRESS = bytes([192, 168, 1, 201])


def ip_packet(payload: bytes, *, port: int = 2368, address: bytes = ADDRESS) -> bytes:
    """IPv4 and UDP headers, and the payload."""
    packet = udp_frame(payload)[14:]
    return packet[:12] + address + packet[16:22] + struct.pack(">H", port) + packet[24:]


def ethernet(packet: bytes) -> bytes:
    return b"\xff" * 6 + b"\x60\x76\x88\0\0\0" + b"\x08\x00" + packet


def tagged(packet: bytes, *tags: int) -> bytes:
    frame = ethernet(packet)
    inserted = b"".join(struct.pack(">HH", tag, 100 + k) for k, tag in enumerate(tags))
    return frame[:12] + inserted + frame[12:]


def ip6_packet(payload: bytes, *, extension: bytes = b"") -> bytes:
    """IPv6 and UDP headers, and the payload; the extension is a header of eight bytes."""
    body = extension + udp_frame(payload)[34:]
    kind = 0 if extension else 17
    address = bytes.fromhex("fe80000000000000627688fffe000001")
    return struct.pack(">IHBB", 0x60000000, len(body), kind, 64) + address + b"\xff" * 16 + body


def ethernet6(packet: bytes) -> bytes:
    return b"\xff" * 6 + b"\x60\x76\x88\0\0\0" + b"\x86\xdd" + packet


def labelled(packet: bytes) -> bytes:
    """An Ethernet frame with two labels of MPLS."""
    labels = struct.pack(">II", 100 << 12 | 64, 200 << 12 | 0x100 | 64)
    return ethernet(packet)[:12] + b"\x88\x47" + labels + packet


def mirrored(packet: bytes) -> bytes:
    """A frame of mirrored traffic: IP, GRE and ERSPAN of type II around it."""
    inner = struct.pack(">HHI", 0x1000, 0x88BE, 1) + bytes(8) + ethernet(packet)
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(inner), 1, 0, 64, 47, 0)
    return ethernet(head + bytes([10, 0, 0, 1, 10, 0, 0, 2]) + inner)


def cooked(packet: bytes) -> bytes:
    return struct.pack(">HHH8sH", 0, 1, 6, b"\x60\x76\x88\0\0\0\0\0", 0x0800) + packet


def cooked2(packet: bytes) -> bytes:
    return struct.pack(">HHIHBB8s", 0x0800, 0, 3, 1, 0, 6, bytes(8)) + packet


def fragments(packet: bytes, number: int, size: int = 480) -> list[bytes]:
    """IP fragments, the last first; every second packet in one piece more."""
    header, body = packet[:20], packet[20:]
    size = size if number % 2 else size - 80
    pieces = []
    for at in range(0, len(body), size):
        piece = body[at : at + size]
        more = 0x2000 if at + size < len(body) else 0
        head = header[:2] + struct.pack(">HHH", 20 + len(piece), number, more | at // 8)
        pieces.append(head + header[8:] + piece)
    return pieces[::-1]


def pcap_of(
    frames: Sequence[bytes], *, link: int = 1, order: str = "<", ticks: int = 1_000_000
) -> bytes:
    return pcap_head(order, ticks, link) + b"".join(
        pcap_packet(frame, number, order=order, ticks=ticks) for number, frame in enumerate(frames)
    )


def block(kind: int, body: bytes, order: str = "<") -> bytes:
    body += bytes(-len(body) % 4)
    length = struct.pack(order + "I", 12 + len(body))
    return struct.pack(order + "I", kind) + length + body + length


def section(order: str = "<") -> bytes:
    return block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1), order)


def interface(order: str = "<", link: int = 1, resolution: int | None = None) -> bytes:
    options = b""
    if resolution is not None:
        options = struct.pack(order + "HHB3xHH", 9, 1, resolution, 0, 0)
    return block(1, struct.pack(order + "HHI", link, 0, 0) + options, order)


def enhanced(frame: bytes, number: int, order: str = "<", ticks: int = 1_000_000) -> bytes:
    time = FIRST_SECOND * ticks + (40_000 + 553 * number) * (ticks // 1_000_000)
    head = struct.pack(order + "IIIII", 0, time >> 32, time & 0xFFFFFFFF, len(frame), len(frame))
    return block(6, head + frame, order)


def pcapng(
    frames: Sequence[bytes], *, order: str = "<", link: int = 1, resolution: int | None = None
) -> bytes:
    ticks = 1_000_000 if resolution is None else 10**resolution
    packets = b"".join(enhanced(f, n, order, ticks) for n, f in enumerate(frames))
    # A name resolution block, which holds no packets, among them.
    return section(order) + interface(order, link, resolution) + block(4, bytes(8), order) + packets


def simple(frames: Sequence[bytes]) -> bytes:
    packets = b"".join(block(3, struct.pack("<I", len(f)) + f) for f in frames)
    return section() + interface() + packets


def ros1_scan(payloads: Sequence[bytes], number: int) -> bytes:
    head = (
        struct.pack("<III", number, FIRST_SECOND, 40_000_000) + struct.pack("<I", 8) + b"velodyne"
    )
    stamps = (struct.pack("<II", FIRST_SECOND, 40_000_000 + 553_000 * k) for k in range(9**9))
    parts = (stamp + payload for stamp, payload in zip(stamps, payloads, strict=False))
    return head + struct.pack("<I", len(payloads)) + b"".join(parts)


def ros2_scan(payloads: Sequence[bytes]) -> bytes:
    """CDR: numbers of four bytes lie at multiples of four."""
    message = struct.pack("<II", FIRST_SECOND, 40_000_000)
    message += struct.pack("<I", 9) + b"velodyne\0"
    message += bytes(-len(message) % 4) + struct.pack("<I", len(payloads))
    for number, payload in enumerate(payloads):
        message += bytes(-len(message) % 4)
        message += struct.pack("<II", FIRST_SECOND, 40_000_000 + 553_000 * number) + payload
    return b"\0\1\0\0" + message


_ROS = """std_msgs/Header header
velodyne_msgs/VelodynePacket[] packets
================================================================================
MSG: velodyne_msgs/VelodynePacket
time stamp
uint8[1206] data
"""


def write_ros1(
    path: Path,
    topics: dict[str, Sequence[bytes]],
    *,
    package: str = "velodyne_msgs",
    compression: str | None = None,
) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(_ROS, f"{package}/msg/VelodyneScan"))
    writer = Writer(path)
    if compression is not None:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        for topic, payloads in topics.items():
            connection = writer.add_connection(
                topic, f"{package}/msg/VelodyneScan", typestore=store
            )
            for number, at in enumerate(range(0, len(payloads), 7)):
                writer.write(
                    connection, 10**9 * (number + 1), ros1_scan(payloads[at : at + 7], number)
                )
    return path


def write_ros2(
    path: Path,
    topics: dict[str, Sequence[bytes]],
    storage: str = "SQLITE3",
    *,
    package: str = "velodyne_msgs",
    compression: str | None = None,
) -> Path:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    text = _ROS.replace("time stamp", "builtin_interfaces/Time stamp")
    store.register(get_types_from_msg(text, f"{package}/msg/VelodyneScan"))
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage])
    if compression is not None:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        for topic, payloads in topics.items():
            connection = writer.add_connection(
                topic, f"{package}/msg/VelodyneScan", typestore=store
            )
            for number, at in enumerate(range(0, len(payloads), 7)):
                message = ros2_scan(payloads[at : at + 7])
                writer.write(connection, 10**9 * (number + 1), message)
    return path


def frames_of(payloads: np.ndarray, wrap: Callable[[bytes], bytes] = ethernet) -> list[bytes]:
    return [wrap(ip_packet(payload)) for payload in as_bytes(payloads)]


def containers(payloads: np.ndarray) -> dict[str, bytes]:
    """The same capture in every file format."""
    bare = as_bytes(payloads)
    plain = frames_of(payloads)
    found = {
        "records 1206": b"".join(bare),
        "records 1248": b"".join(plain),
        "pcapng": pcapng(plain),
        "pcapng big-endian": pcapng(plain, order=">"),
        "pcapng ns": pcapng(plain, resolution=9),
        "pcapng simple": simple(plain),
        "pcapng cooked": pcapng(frames_of(payloads, cooked), link=113),
        "pcapng two sections": pcapng(plain[:9]) + pcapng(plain[9:], order=">"),
        "vlan": pcap_of(frames_of(payloads, lambda p: tagged(p, 0x8100))),
        "qinq": pcap_of(frames_of(payloads, lambda p: tagged(p, 0x88A8, 0x8100))),
        "qinq, old": pcap_of(frames_of(payloads, lambda p: tagged(p, 0x9100, 0x8100))),
        "raw": pcap_of(frames_of(payloads, bytes), link=101),
        "raw, BSD": pcap_of(frames_of(payloads, bytes), link=12),
        "raw IPv4": pcap_of(frames_of(payloads, bytes), link=228),
        "loopback": pcap_of(frames_of(payloads, lambda p: b"\2\0\0\0" + p), link=0),
        "cooked": pcap_of(frames_of(payloads, cooked), link=113),
        "cooked 2": pcap_of(frames_of(payloads, cooked2), link=276),
        "check sequence": pcap_of([frame + b"\xde\xad\xbe\xef" for frame in plain]),
        "IP options": pcap_of(frames_of(payloads, lambda p: ethernet(with_options(p)))),
        "fragments": pcap_of(
            [
                ethernet(piece)
                for number, payload in enumerate(bare)
                for piece in fragments(ip_packet(payload), number)
            ]
        ),
    }
    for order in "<>":
        for ticks in (10**6, 10**9):
            found[f"pcap {order}{ticks}"] = pcap_of(plain, order=order, ticks=ticks)
    for name in ("records 1206", "records 1248", "pcap <1000000", "pcapng", "fragments"):
        found[f"{name}, gzip"] = gzip.compress(found[name], mtime=0)
    for name in ("records 1206", "pcap <1000000"):
        found[f"{name}, bzip2"] = bz2.compress(found[name])
        found[f"{name}, xz"] = lzma.compress(found[name])
    half = len(found["pcapng"]) // 2
    members = [found["pcapng"][:half], found["pcapng"][half:]]
    found["pcapng, two members"] = b"".join(gzip.compress(part, mtime=0) for part in members)
    found["pcapng, two members of bzip2"] = b"".join(map(bz2.compress, members))
    found["pcapng, two members of xz"] = b"".join(map(lzma.compress, members))
    return found


def with_options(packet: bytes) -> bytes:
    """The packet with four bytes of IP options."""
    length = struct.pack(">H", len(packet) + 4)
    return b"\x46" + packet[1:2] + length + packet[4:20] + b"\1\1\1\0" + packet[20:]
