"""Speed of reading recordings, against velodyne-decoder and dpkt."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from speed_measure import Measures, Recorded, read, table

from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.capture.reading import open_capture
from velocal.packets.firings import decode
from velocal.points.placing import Settings
from velocal.points.stream import stream
from velocal.recording.inspection import Inspection
from velocal.recording.scan import inspect
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters

SCANNER = SCANNERS["HDL-64E"]
#: File of the other program with the same packets, by framing: it reads no compressed files.
THEIRS = {"bin": "bin", "pcap": "pcap", "pcapng": "pcap", "pcap.gz": "pcap"}


def theirs(of: Recorded, framing: str) -> int:
    """Points of velodyne-decoder, X, Y, Z, intensity, ring and time."""
    import velodyne_decoder as vd

    calibration = vd.Calibration.read(str(of.calibration))
    config = vd.Config(model=vd.Model.HDL64E_S2, calibration=calibration, min_range=0.0)
    if framing == "pcap":
        return sum(len(cloud) for _, cloud in vd.read_pcap(str(of.files["pcap"]), config))
    decoder, count = vd.StreamDecoder(config), 0
    content = memoryview(of.files["bin"].read_bytes())
    for number, at in enumerate(range(0, len(content), 1206)):
        scan = decoder.decode(number / SCANNER.packet_rate_hz, content[at : at + 1206])
        count += 0 if scan is None else len(scan[1])
    scan = decoder.finish()
    return count + (0 if scan is None else len(scan[1]))


def dpkt_loop(path: Path) -> int:
    """Packets that dpkt's reader gives, nothing of them looked at."""
    import dpkt

    with path.open("rb") as file:
        return sum(1 for _ in dpkt.pcap.Reader(file))


def raw_columns(path: Path) -> int:
    """Decode all packets, in order and with the ledger of every byte."""
    return sum(len(decode(chunk.payloads, SCANNER)) for chunk in open_capture(path).read())


def points(
    path: Path, found: Inspection, calibration: CalibrationFile | LaserParameters
) -> Iterator[int]:
    """Numbers of points, piece by piece."""
    every = np.arange(len(found.index))
    for columns, _ in stream(path, found, every, Settings(SCANNER, calibration)):
        yield len(columns["x"])


def decoding(of: Recorded, rounds: int) -> str:
    """Table of all framings."""
    measures, factory = Measures(), formats.read_calibration(of.calibration, SCANNER.n_lasers)
    rows = []
    for framing, path in of.files.items():
        found = inspect(path)
        other = f"velodyne-decoder to X, Y, Z {THEIRS[framing]}"
        if framing in ("bin", "pcap"):
            measures.add(
                other, lambda framing=framing: theirs(of, framing), needs="velodyne_decoder"
            )
        names = {"read the bytes": lambda path=path: read(path)}
        if framing == "bin":
            held = np.fromfile(path, np.uint8)
            names["copy the bytes in memory"] = held.copy
        if framing == "pcap":
            measures.add(f"dpkt's loop {framing}", lambda path=path: dpkt_loop(path), needs="dpkt")
        if framing == "pcap.gz":
            names["unpack only"] = lambda path=path: gzip.decompress(path.read_bytes())
        names |= {
            "scan with ledger (`velocal inspect`)": lambda path=path: inspect(path),
            "raw columns with ledger": lambda path=path: raw_columns(path),
            "X, Y, Z": lambda path=path, found=found: sum(points(path, found, of.factory)),
            "X, Y, Z with a scan before": lambda path=path: sum(
                points(path, inspect(path), of.factory)
            ),
            "X, Y, Z with near points": lambda path=path, found=found: sum(
                points(path, found, factory)
            ),
        }
        for name, work in names.items():
            measures.add(f"{name} {framing}", work)
        if framing == "pcap":
            names = {"dpkt's loop": None, **names}
        rows += [(framing, name, other) for name in names]
        if framing in ("bin", "pcap"):
            rows.append((framing, other.rsplit(" ", 1)[0], other))
    measures.run(rounds)
    return table(
        ["framing", "what", "ms", "times as fast as velodyne-decoder"],
        [
            [f, name, measures.time_of(f"{name} {f}"), measures.ratio(f"{name} {f}", other)]
            for f, name, other in rows
        ],
        texts=2,
    )
