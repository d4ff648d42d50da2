"""Time and memory to read damaged recordings, against the same recordings without damage.

Usage: python benchmarks/damage.py [--write]

--write puts the tables into docs/file-formats.md.

Every recording is scanned and decoded in a process of its own. Time is that of the processor, so
that other work on the machine does not change it much; memory is the largest of the process.
"""

import bz2
import os
import resource
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from velocal.io.markup import inserted, markdown_table
from velocal.packets import data as packets

ROOT = Path(__file__).parents[1]
DOC = ROOT / "docs/file-formats.md"
#: A recording of 25 MB.
N = 20_000
#: Number of times that each file is read; the quickest counts.
ROUNDS = 2
HEADERS = bytes(range(12)) + b"\x08\x00" + struct.pack(
    ">BBHHHBBH4s4sHHHH", 0x45, 0, 1234, 1, 0, 64, 17, 0, b"\xc0\xa8\1\xc9", b"\xff" * 4,
    2368, 2368, 1214, 0,
)  # fmt: skip

Frames = list[bytes]


def payloads() -> Frames:
    """Packets of an HDL-32E that turns ten times a second."""
    rng = np.random.default_rng(0)
    shape = (N, packets.BLOCKS, packets.CHANNELS)
    found = packets.encode(
        np.full(shape[:2], 0xEEFF, dtype=np.uint16),
        (np.arange(N * packets.BLOCKS).reshape(shape[:2]) * 17 % 36_000).astype(np.uint16),
        rng.integers(500, 60_000, shape).astype(np.uint16),
        rng.integers(0, 256, shape).astype(np.uint8),
        (553 * np.arange(N)).astype(np.uint32),
        np.tile(np.array([0x37, 0x21], dtype=np.uint8), (N, 1)),
    )
    return [row.tobytes() for row in found]


def pcap_record(frame: bytes, number: int) -> bytes:
    """Frame with its header in a pcap."""
    micro = 553 * number
    return struct.pack("<IIII", micro // 10**6, micro % 10**6, len(frame), len(frame)) + frame


def pcapng_block(kind: int, body: bytes) -> bytes:
    """Block of a pcapng."""
    body += bytes(-len(body) % 4)
    length = struct.pack("<I", 12 + len(body))
    return struct.pack("<I", kind) + length + body + length


def pcapng_record(frame: bytes, number: int) -> bytes:
    """Frame as an enhanced packet block."""
    time = 553 * number
    head = struct.pack("<IIIII", 0, time >> 32, time & 0xFFFFFFFF, len(frame), len(frame))
    return pcapng_block(6, head + frame)


PCAP_HEAD = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65_535, 1)
PCAPNG_HEAD = pcapng_block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1)) + pcapng_block(
    1, struct.pack("<HHI", 1, 0, 0)
)

#: Bytes at the beginning of a file, and what is made of a payload and its number.
CONTAINERS: dict[str, tuple[bytes, Callable[[bytes, int], bytes]]] = {
    "records of 1206 bytes": (b"", lambda payload, number: payload),
    "records of 1248 bytes": (b"", lambda payload, number: HEADERS + payload),
    "pcap": (PCAP_HEAD, lambda payload, number: pcap_record(HEADERS + payload, number)),
    "pcapng": (PCAPNG_HEAD, lambda payload, number: pcapng_record(HEADERS + payload, number)),
}


def cut(one_in: int) -> Callable[[Frames], Iterator[bytes]]:
    """Lose the middle 100 bytes of one packet in so many."""

    def damaged(records: Frames) -> Iterator[bytes]:
        for number, record in enumerate(records):
            yield record[:600] + record[700:] if number % one_in == one_in // 2 else record

    return damaged


def with_tail(tail: Callable[[int], bytes]) -> Callable[[Frames], Iterator[bytes]]:
    """Put as many other bytes behind the recording as it has."""

    def damaged(records: Frames) -> Iterator[bytes]:
        yield from records
        yield tail(sum(map(len, records)))

    return damaged


DAMAGE: dict[str, Callable[[Frames], Iterator[bytes]]] = {
    "none": lambda records: iter(records),
    "1 in 25 packets cut": cut(25),
    "1 in 20 packets cut": cut(20),
    "1 in 3 packets cut": cut(3),
    "as many zeros behind": with_tail(bytes),
    "as many bytes FF behind": with_tail(lambda n: b"\xff" * n),
    "as many random bytes behind": with_tail(lambda n: np.random.default_rng(1).bytes(n)),
}


def fragments() -> bytes:
    """One datagram in 8,192 fragments of 8 bytes, the last one missing."""
    found = [PCAP_HEAD]
    for number in range(8192):
        head = struct.pack(
            ">BBHHHBBH4s4s", 0x45, 0, 28, 1, 0x2000 | number % 8191, 64, 17, 0,
            b"\xc0\xa8\1\xc9", b"\xff" * 4,
        )  # fmt: skip
        found.append(pcap_record(bytes(12) + b"\x08\x00" + head + bytes(8), number))
    return b"".join(found)


def bag_of_zeros() -> bytes:
    """A ROS 1 bag whose only chunk unpacks to 2 GB."""

    def record(data: bytes, **fields: bytes) -> bytes:
        header = b"".join(
            struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v
            for k, v in fields.items()
        )
        return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data

    packer = bz2.BZ2Compressor()
    packed = b"".join(packer.compress(bytes(1 << 24)) for _ in range(128)) + packer.flush()
    size = struct.pack("<I", (128 << 24) - 1)
    chunk = record(packed, op=b"\x05", compression=b"bz2", size=size)
    name = b"/velodyne_packets"
    fields = {"topic": name, "type": b"velodyne_msgs/VelodyneScan", "md5sum": b"0" * 32}
    fields["message_definition"] = b"int8 x"
    body = b"".join(
        struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in fields.items()
    )
    connection = record(body, op=b"\x07", conn=bytes(4), topic=name)
    head_bytes = 4096
    info = record(
        struct.pack("<II", 0, 1), op=b"\x06", ver=b"\1\0\0\0",
        chunk_pos=struct.pack("<Q", 13 + head_bytes), start_time=bytes(8), end_time=bytes(8),
        count=b"\1\0\0\0",
    )  # fmt: skip
    index = record(bytes(12), op=b"\x04", ver=b"\1\0\0\0", conn=bytes(4), count=b"\1\0\0\0")
    at = struct.pack("<Q", 13 + head_bytes + len(chunk) + len(index))
    plain = record(b"", op=b"\x03", index_pos=at, conn_count=b"\1\0\0\0", chunk_count=b"\1\0\0\0")
    padding = head_bytes - len(plain)
    header = plain[:-4] + struct.pack("<I", padding) + b" " * padding
    return b"#ROSBAG V2.0\n" + header + chunk + index + connection + info


def measured(path: Path) -> tuple[float, float, str]:
    """Seconds of processor time, largest memory in MB, and what came out."""
    command = [sys.executable, __file__, "--read", str(path)]
    found = []
    for _ in range(ROUNDS):
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds, memory, what = done.stdout.strip().split(maxsplit=2)
        found.append((float(seconds), float(memory), what))
    return min(found)


def read(path: Path) -> None:
    """Scan and decode a recording, and print what it took."""
    from velocal.errors import VelocalError
    from velocal.recording.returns import returns_of
    from velocal.recording.scan import inspect
    from velocal.scanner.models import SCANNERS

    start = os.times()
    try:
        index = inspect(path).index
        rotations = np.arange(len(index))
        parts = returns_of(path, index, rotations, SCANNERS["HDL-32E"])
        what = f"{sum(len(part) for part in parts) / 1e6:.2f} million returns"
    except VelocalError as error:
        what = str(error.what)
    end = os.times()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    print(end.user + end.system - start.user - start.system, memory, what.splitlines()[0])


def damaged(folder: Path) -> list[list[str]]:
    """Rows of the first table: time and memory under damage."""
    rows = []
    bodies = payloads()
    path = folder / "recording"
    for container, (head, record) in CONTAINERS.items():
        records = [record(payload, number) for number, payload in enumerate(bodies)]
        clean = 0.0, 0.0
        for damage, change in DAMAGE.items():
            with path.open("wb") as file:
                file.writelines([head, *change(records)])
            seconds, memory, what = measured(path)
            clean = (seconds, memory) if damage == "none" else clean
            ratios = f"{seconds / clean[0]:.1f}", f"{memory / clean[1]:.2f}"
            rows.append(
                [container, damage, what.split()[0], f"{seconds:.2f}", f"{memory:.0f}", *ratios]
            )
            print(*rows[-1], sep="  ", flush=True)
    return rows


def hostile(folder: Path) -> list[list[str]]:
    """Rows of the second table: files that hold next to nothing."""
    path = folder / "recording.bag"
    rows = []
    for name, content in {
        "pcap of 8,192 fragments of one datagram": fragments(),
        "ROS 1 bag whose chunk unpacks to 2 GB": bag_of_zeros(),
        "10 GB of nothing": b"",
        "10 GB of nothing behind a pcap of one packet": PCAP_HEAD
        + pcap_record(HEADERS + payloads()[0], 0),
        "10 GB of nothing behind the header of a pcapng": PCAPNG_HEAD,
    }.items():
        with path.open("wb") as file:
            file.write(content)
            if "10 GB" in name:
                file.truncate(10 * 10**9)
        seconds, memory, what = measured(path)
        rows.append([name, f"{len(content)}", f"{seconds:.2f}", f"{memory:.0f}", what])
        print(*rows[-1], sep="  ", flush=True)
    return rows


def main() -> tuple[str, str]:
    """Measure everything; return the two tables."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first, second = damaged(folder), hostile(folder)
    headings = ["container", "damage", "million returns", "time, s", "memory, MB"]
    headings += ["time, to none", "memory, to none"]
    others = ["file", "bytes written", "time, s", "memory, MB", "what came out"]
    return (
        "\n".join(markdown_table(headings, first, [False, False, *[True] * 5])),
        "\n".join(markdown_table(others, second, [False, True, True, True, False])),
    )


if __name__ == "__main__":
    if "--read" in sys.argv:
        read(Path(sys.argv[-1]))
    else:
        tables = main()
        if "--write" in sys.argv:
            text = DOC.read_text(encoding="utf-8")
            for table, mark in zip(tables, ("damage", "nothing"), strict=True):
                text = inserted(text, mark, table)
            DOC.write_text(text, encoding="utf-8")
