"""Damaged recordings: sound ones of the tests' own encoder, with one fault each."""

from __future__ import annotations

import gzip
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from support import containers
from support.capture import (
    as_bytes,
    pcap,
    pcap_head,
    pcap_packet,
    record_list,
    spin,
    two_returns,
    udp_frame,
    vlan_frame,
)

from catalogue.case import Case, Outcome

#: Packets of a sound recording: five rotations of an HDL-32E.
N = 1000
_HDL32 = {"step": 15, "interval_us": 553}


def _spin(n: int = N, **options: int) -> np.ndarray:
    return spin(n, **{**_HDL32, **options})


def _frames(payloads: np.ndarray) -> list[bytes]:
    return [udp_frame(payload) for payload in as_bytes(payloads)]


def _pcap(frames: Sequence[bytes], *, cut: Callable[[int], int | None] = lambda _: None) -> bytes:
    return pcap_head() + b"".join(
        pcap_packet(frame, number, captured=cut(number)) for number, frame in enumerate(frames)
    )


def _bytes(content: Callable[[], bytes], name: str = "a.pcap") -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes(content())


def _put(at: int, data: bytes, step: int = 0) -> Callable[[], bytes]:
    """Write bytes into payloads: into the one in the middle, or into every `step`-th."""

    def made() -> bytes:
        rows = _spin()
        chosen = range(0, N, step) if step else [N // 2]
        for row in chosen:
            rows[row, at : at + len(data)] = np.frombuffer(data, dtype=np.uint8)
        return pcap(rows)

    return made


def _records(header: int, change: Callable[[bytes], bytes]) -> Callable[[], bytes]:
    return lambda: change(b"".join(record_list(_spin(), header)))


def _stamped(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[], bytes]:
    """Change the time stamps of all packets."""

    def made() -> bytes:
        rows = _spin()
        stamps = change(5_000_000 + 553 * np.arange(N, dtype=np.int64)) % 2**32
        rows[:, 1200:1204] = stamps.astype("<u4").view(np.uint8).reshape(N, 4)
        return pcap(rows)

    return made


def _among(other: bytes) -> Callable[[], bytes]:
    """A foreign frame after every tenth packet."""
    return lambda: _pcap(
        [frame for number, one in enumerate(_frames(_spin()))
         for frame in ((one, other) if number % 10 == 0 else (one,))]
    )  # fmt: skip


def _order(chosen: Callable[[np.ndarray], np.ndarray]) -> Callable[[], bytes]:
    return lambda: _pcap(_frames(_spin()[chosen(np.arange(N))]))


def _swapped(numbers: np.ndarray) -> np.ndarray:
    numbers[[500, 501]] = numbers[[501, 500]]
    return numbers


def _header_field(at: int, data: bytes, record: int | None = N // 2) -> Callable[[], bytes]:
    """Write into the header of a record of a pcap, or into that of the file."""

    def made() -> bytes:
        content = bytearray(pcap(_spin()))
        place = at if record is None else 24 + record * (16 + 1248) + at
        content[place : place + len(data)] = data
        return bytes(content)

    return made


def _in_frames(at: int, data: bytes, step: int = 1) -> Callable[[], bytes]:
    def made() -> bytes:
        frames = _frames(_spin())
        for number in range(0, N, step):
            frame = bytearray(frames[number])
            frame[at : at + len(data)] = data
            frames[number] = bytes(frame)
        return _pcap(frames)

    return made


def _two_senders(port: int = 2368, last: int = 202) -> Callable[[], bytes]:
    def made() -> bytes:
        address = bytes([192, 168, 1, last])
        frames = []
        for one, other in zip(as_bytes(_spin()), as_bytes(_spin(seed=1)), strict=True):
            frames += [
                containers.ethernet(containers.ip_packet(one)),
                containers.ethernet(containers.ip_packet(other, port=port, address=address)),
            ]
        return _pcap(frames)  # fmt: skip

    return made


def _fragments(keep: Callable[[int, int], bool]) -> Callable[[], bytes]:
    def made() -> bytes:
        frames = [
            containers.ethernet(piece)
            for number, payload in enumerate(as_bytes(_spin()))
            for part, piece in enumerate(
                containers.fragments(containers.ip_packet(payload), number)
            )
            if keep(number, part)
        ]
        return _pcap(frames)

    return made


def _pcapng(change: Callable[[bytes], bytes] = lambda content: content) -> Callable[[], bytes]:
    return lambda: change(containers.pcapng(_frames(_spin())))


def _bag(
    suffix: str, change: Callable[[bytes], bytes] = lambda content: content, topics: int = 1
) -> Callable[[Path], object]:
    def made(folder: Path) -> object:
        scans = {f"/scanner{n}/velodyne_packets": as_bytes(_spin(seed=n)) for n in range(topics)}
        if suffix == ".bag":
            path = containers.write_ros1(folder / "whole.bag", scans)
        else:
            storage = "MCAP" if suffix == ".mcap" else "SQLITE3"
            bag = containers.write_ros2(folder / "whole", scans, storage)
            path = next(bag.glob(f"*{suffix}"))
        return (folder / f"a{suffix}").write_bytes(change(path.read_bytes()))

    return made


def _half(content: bytes) -> bytes:
    return content[: len(content) // 2]


_MIDDLE = 1206 * (N // 2)
_INSPECT = ("inspect", "a.pcap", "--json")
_ARP = b"\xff" * 6 + b"\x60\x76\x88\0\0\0" + b"\x08\x06" + bytes(28)
_IPV6 = b"\xff" * 6 + b"\x60\x76\x88\0\0\0" + b"\x86\xdd" + bytes(60)

_REFUSED: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "empty file": (_bytes(lambda: b""), _INSPECT),
    "one byte": (_bytes(lambda: b"\xd4"), _INSPECT),
    "a text": (_bytes(lambda: b"lorem ipsum " * 1000), _INSPECT),
    "a picture": (_bytes(lambda: b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 50), _INSPECT),
    "a megabyte of zeros": (_bytes(lambda: bytes(10**6)), _INSPECT),
    "a megabyte of 0xFF": (_bytes(lambda: b"\xff" * 10**6), _INSPECT),
    "random bytes": (_bytes(lambda: np.random.default_rng(0).bytes(200_000)), _INSPECT),
    "a folder": (lambda folder: (folder / "a.pcap").mkdir(), _INSPECT),
    "no such file": (lambda _: None, _INSPECT),
    "pcap: header only": (_bytes(pcap_head), _INSPECT),
    "pcap: header cut": (_bytes(lambda: pcap_head()[:10]), _INSPECT),
    "pcap: link type that carries no IP": (
        _bytes(_header_field(20, b"\x69\0\0\0", None)),
        _INSPECT,
    ),
    "pcap: no packet of a scanner": (_bytes(lambda: _pcap([_ARP] * 100)), _INSPECT),
    "pcap: every packet cut by the capture program": (
        _bytes(lambda: _pcap(_frames(_spin()), cut=lambda _: 96)),
        _INSPECT,
    ),
    "pcap: a port that no packet was sent to": (
        _bytes(lambda: pcap(_spin())),
        (*_INSPECT, "--port", "2369"),
    ),
    "pcap: an address that sent nothing": (
        _bytes(lambda: pcap(_spin())),
        (*_INSPECT, "--address", "10.0.0.1"),
    ),
    "pcap: an address that is none": (
        _bytes(lambda: pcap(_spin())),
        (*_INSPECT, "--address", "scanner.local"),
    ),
    "pcap: two scanners, none chosen": (_bytes(_two_senders()), _INSPECT),
    "pcap: two ports, none chosen": (_bytes(_two_senders(2369, 201)), _INSPECT),
    "gzip: of nothing": (_bytes(lambda: gzip.compress(b"")), _INSPECT),
    "gzip: of zeros": (_bytes(lambda: gzip.compress(bytes(10**7))), _INSPECT),
    "gzip: header only": (_bytes(lambda: gzip.compress(b"")[:5]), _INSPECT),
    "pcapng: section only": (_bytes(containers.section), _INSPECT),
    "ROS 1 bag: header only": (
        _bag(".bag", lambda content: content[:50]),
        ("inspect", "a.bag", "--json"),
    ),
    "ROS 1 bag: two topics, none chosen": (_bag(".bag", topics=2), ("inspect", "a.bag", "--json")),
    "ROS 1 bag: a topic that is not there": (
        _bag(".bag"),
        ("inspect", "a.bag", "--json", "--address", "/x"),
    ),
    "ROS 2 bag: a database of something else": (
        _bytes(lambda: b"SQLite format 3\0" + bytes(5000), "a.db3"),
        ("inspect", "a.db3", "--json"),
    ),
    "ROS 2 bag: text": (_bytes(lambda: b"text", "a.mcap"), ("inspect", "a.mcap", "--json")),
    "records: an unknown scanner named": (
        _bytes(lambda: pcap(_spin())),
        (*_INSPECT, "--scanner", "HDL-32"),
    ),
    "decode: a window longer than the recording": (
        _bytes(lambda: pcap(_spin())),
        ("decode", "a.pcap", "-o", "b.parquet", "--window", "middle", "--rotations", "100"),
    ),
    "decode: an unknown window": (
        _bytes(lambda: pcap(_spin())),
        ("decode", "a.pcap", "-o", "b.parquet", "--window", "first"),
    ),
    "decode: an unknown choice of returns": (
        _bytes(lambda: pcap(_spin())),
        ("decode", "a.pcap", "-o", "b.parquet", "--return", "first"),
    ),
    "points: rotations that are no range": (
        _bytes(lambda: pcap(_spin())),
        ("points", "a.pcap", "-o", "b.ply", "--rotations", "1-3"),
    ),
    "points: rotations that are not there": (
        _bytes(lambda: pcap(_spin())),
        ("points", "a.pcap", "-o", "b.ply", "--rotations", "90:99"),
    ),
    "points: an unknown frame": (
        _bytes(lambda: pcap(_spin())),
        ("points", "a.pcap", "-o", "b.ply", "--frame", "enu"),
    ),
    "points: an unknown format": (
        _bytes(lambda: pcap(_spin())),
        ("points", "a.pcap", "-o", "b.xyz"),
    ),
    "points: a calibration that does not exist": (
        _bytes(lambda: pcap(_spin())),
        ("points", "a.pcap", "-o", "b.ply", "-c", "gone.xml"),
    ),
    "from-recording: a scanner that sends no calibration": (
        _bytes(lambda: pcap(_spin())),
        ("calibration", "from-recording", "a.pcap", "-o", "b.xml"),
    ),
    "another scanner than the one that is named": (
        _bytes(lambda: pcap(_spin())),
        (*_INSPECT, "--scanner", "VLP-16"),
    ),
    "ROS 1 bag: cut in the middle": (_bag(".bag", _half), ("inspect", "a.bag", "--json")),
    "ROS 2 bag: MCAP cut in the middle": (_bag(".mcap", _half), ("inspect", "a.mcap", "--json")),
}

#: Used as far as it is valid; what is not is counted in the ledger, or remarked.
_TOLD: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "records of 1206 bytes: the last one cut": (_bytes(_records(0, lambda c: c[:-100])), _INSPECT),
    "records of 1206 bytes: the first 100 bytes missing": (
        _bytes(_records(0, lambda c: c[100:])),
        _INSPECT,
    ),
    "records of 1206 bytes: 10 bytes inserted": (
        _bytes(_records(0, lambda c: c[:_MIDDLE] + bytes(10) + c[_MIDDLE:])),
        _INSPECT,
    ),
    "records of 1206 bytes: a tenth cut out": (
        _bytes(_records(0, lambda c: c[:_MIDDLE] + c[_MIDDLE + 1206 * 100 + 7 :])),
        _INSPECT,
    ),
    "records of 1248 bytes: 1000 zeros inserted": (
        _bytes(_records(42, lambda c: c[: 1248 * 500] + bytes(1000) + c[1248 * 500 :])),
        _INSPECT,
    ),
    "records of 1248 bytes: zeros at the end": (
        _bytes(_records(42, lambda c: c + bytes(10_000))),
        _INSPECT,
    ),
    "a bit of the flag of a block flipped": (_bytes(_put(0, b"\xfe")), _INSPECT),
    "an azimuth of 655.35 deg": (_bytes(_put(2, b"\xff\xff")), _INSPECT),
    "unknown scanner in the last byte": (
        _bytes(lambda: pcap(_spin(status=(0x37, 0x77)))),
        _INSPECT,
    ),
    "a packet missing": (_bytes(_order(lambda n: np.delete(n, 500))), _INSPECT),
    "a tenth of the packets missing": (
        _bytes(_order(lambda n: n[np.random.default_rng(0).random(N) > 0.1])),
        _INSPECT,
    ),
    "clock jumps by 10 minutes": (
        _bytes(_stamped(lambda t: t + 600_000_000 * (np.arange(N) > 500))),
        _INSPECT,
    ),
    "clock jumps back by 10 minutes": (
        _bytes(_stamped(lambda t: 900_000_000 + t - 600_000_000 * (np.arange(N) > 500))),
        _INSPECT,
    ),
    "a bit of a time stamp flipped": (
        _bytes(_stamped(lambda t: t ^ (np.arange(N) == 500) * 2**30)),
        _INSPECT,
    ),
    "clock stands still": (_bytes(_stamped(lambda t: t * 0 + 5)), _INSPECT),
    "clock is 0": (_bytes(_stamped(lambda t: t * 0)), _INSPECT),
    "random time stamps": (
        _bytes(_stamped(lambda t: np.random.default_rng(0).integers(0, 2**32, N))),
        _INSPECT,
    ),
    "time stamps beyond an hour": (_bytes(_stamped(lambda t: t + 4_000_000_000)), _INSPECT),
    "head stands still": (_bytes(lambda: pcap(_spin(step=0))), _INSPECT),
    "head turns backwards": (_bytes(lambda: pcap(_spin(step=-15))), _INSPECT),
    "one or two returns per shot: changes in the middle": (
        _bytes(
            lambda: pcap(
                np.concatenate(
                    [
                        _spin(500),
                        two_returns(_spin(500, stamp_us=5_276_500, status=(0x39, 0x21)), step=15),
                    ]
                )
            )
        ),
        _INSPECT,
    ),
    "pcap: the last record cut": (_bytes(lambda: pcap(_spin())[:-500]), _INSPECT),
    "pcap: cut in the middle of the header of a record": (
        _bytes(lambda: pcap(_spin())[: 24 + 500 * 1264 + 7]),
        _INSPECT,
    ),
    "pcap: one packet in ten cut": (
        _bytes(lambda: _pcap(_frames(_spin()), cut=lambda n: 600 if n % 10 == 0 else None)),
        _INSPECT,
    ),
    "pcap: a record of 4 GB": (_bytes(_header_field(8, b"\xff\xff\xff\xff")), _INSPECT),
    "pcap: a record of 0 bytes": (_bytes(_header_field(8, b"\0\0\0\0")), _INSPECT),
    "pcap: 1000 random bytes between records": (
        _bytes(
            lambda: (
                pcap(_spin())[: 24 + 500 * 1264]
                + np.random.default_rng(0).bytes(1000)
                + pcap(_spin())[24 + 500 * 1264 :]
            )
        ),
        _INSPECT,
    ),
    "pcap: 10,000 zeros at the end": (_bytes(lambda: pcap(_spin()) + bytes(10_000)), _INSPECT),
    "pcap: 10,000 bytes 0xFF at the end": (
        _bytes(lambda: pcap(_spin()) + b"\xff" * 10_000),
        _INSPECT,
    ),
    "pcap: ARP among the packets": (_bytes(_among(_ARP)), _INSPECT),
    "pcap: IPv6 among the packets": (_bytes(_among(_IPV6)), _INSPECT),
    "pcap: TCP among the packets": (_bytes(_among(udp_frame(b"x" * 100, protocol=6))), _INSPECT),
    "pcap: other UDP among the packets": (_bytes(_among(udp_frame(b"x" * 100))), _INSPECT),
    "pcap: packets of 1205 bytes among them": (_bytes(_among(udp_frame(b"x" * 1205))), _INSPECT),
    "pcap: UDP length of one in ten wrong": (_bytes(_in_frames(38, b"\xff\xff", 10)), _INSPECT),
    "pcap: one IP fragment in ten missing": (
        _bytes(_fragments(lambda n, part: n % 10 != 0 or part != 1)),
        _INSPECT,
    ),
    "pcapng: the last block cut": (_bytes(_pcapng(lambda c: c[:-10])), _INSPECT),
    "pcapng: a block of 4 GB": (
        _bytes(_pcapng(lambda c: c[:-1276] + b"\xf0\xff\xff\xff" + c[-1272:])),
        _INSPECT,
    ),
    "pcapng: zeros at the end": (_bytes(_pcapng(lambda c: c + bytes(5000))), _INSPECT),
    "gzip: cut in the middle": (_bytes(lambda: _half(gzip.compress(pcap(_spin())))), _INSPECT),
    "gzip: a byte changed": (
        _bytes(
            lambda: (
                lambda c: c[: len(c) // 2] + bytes([c[len(c) // 2] ^ 255]) + c[len(c) // 2 + 1 :]
            )(gzip.compress(pcap(_spin())))
        ),
        _INSPECT,
    ),
    "gzip: text after the end": (
        _bytes(lambda: gzip.compress(pcap(_spin())) + b"text" * 100),
        _INSPECT,
    ),
    "ROS 2 bag: one of two topics chosen": (
        _bag(".db3", topics=2),
        ("inspect", "a.db3", "--json", "--address", "/scanner1/velodyne_packets"),
    ),
}

#: Nothing is lost.
_USED: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "nothing: a sound pcap": (_bytes(lambda: pcap(_spin())), _INSPECT),
    "two packets exchanged": (_bytes(_order(_swapped)), _INSPECT),
    "the hour of the clock passes": (
        _bytes(_stamped(lambda t: (t + 3_594_800_000) % 3_600_000_000)),
        _INSPECT,
    ),
    "pcap: big-endian": (_bytes(lambda: pcap(_spin(), ">")), _INSPECT),
    "pcap: nanoseconds": (_bytes(lambda: pcap(_spin(), ticks=10**9)), _INSPECT),
    "pcap: version 9.9": (_bytes(_header_field(4, b"\x09\0\x09\0", None)), _INSPECT),
    "pcap: VLAN": (_bytes(lambda: _pcap([vlan_frame(p) for p in as_bytes(_spin())])), _INSPECT),
    "pcap: IP fragments in the wrong order": (_bytes(_fragments(lambda n, part: True)), _INSPECT),
    "pcap: capture times of 0": (
        _bytes(
            lambda: (
                pcap_head()
                + b"".join(struct.pack("<IIII", 0, 0, 1248, 1248) + f for f in _frames(_spin()))
            )
        ),
        _INSPECT,
    ),
    "pcapng": (_bytes(_pcapng()), _INSPECT),
    "gzip in gzip, renamed": (_bytes(lambda: gzip.compress(pcap(_spin())), "a.pcap"), _INSPECT),
    "ROS 1 bag": (_bag(".bag"), ("inspect", "a.bag", "--json")),
    "decode: one packet": (_bytes(lambda: pcap(_spin(1))), ("decode", "a.pcap", "-o", "b.parquet")),
    "decode: less than a rotation": (
        _bytes(lambda: pcap(_spin(50))),
        ("decode", "a.pcap", "-o", "b.parquet"),
    ),
}

CASES = tuple(
    Case(wrong, outcome, make, command)
    for outcome, cases in (
        (Outcome.REFUSED, _REFUSED),
        (Outcome.TOLD, _TOLD),
        (Outcome.USED, _USED),
    )
    for wrong, (make, command) in cases.items()
)
