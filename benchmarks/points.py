"""Seconds of recording that `velocal points` writes per second of processor, by format.

Usage: python benchmarks/points.py [rotations] [--write]   (default 100: a simulated HDL-64E, 10 Hz)

--write puts the table into docs/how-to.md.

velodyne-decoder decodes the same packets in the same run, without writing anything.
"""

import struct
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import velodyne_decoder as vd
import yaml

from velocal.calibration.files import formats
from velocal.io.markup import inserted, markdown_table
from velocal.points.files import FORMATS, cloud_writer
from velocal.points.stream import Settings, stream
from velocal.recording.scan import inspect
from velocal.scanner.models import SCANNERS
from velocal.simulation import capture, truth, world

ROOT = Path(__file__).parents[1]
DOC = ROOT / "docs/how-to.md"


def best(work: Callable[[], int], rounds: int = 3) -> tuple[int, float]:
    """Result of the work and the least processor time, of all threads, that it took."""
    least = np.inf
    for _ in range(rounds):
        start = time.process_time()
        result = work()
        least = min(least, time.process_time() - start)
    return result, least


def theirs(pcap: Path, calibration: Path) -> int:
    """Points that velodyne-decoder finds."""
    config = vd.Config(
        model=vd.Model.HDL64E_S2, calibration=vd.Calibration.read(str(calibration)), min_range=0.0
    )
    return sum(len(cloud) for _, cloud in vd.read_pcap(str(pcap), config))


def ours(path: Path, settings: Settings, out: Path | None) -> int:
    """Points that are found, scan of the recording included, and written if asked for."""
    found = inspect(path)
    pieces = stream(path, found, np.arange(len(found.index)), settings)
    if out is None:
        return sum(len(columns["x"]) for columns, _ in pieces)
    number = 0
    with cloud_writer(out, shift=settings.before is not None, facts={}) as write:
        for columns, _ in pieces:
            write(columns)
            number += len(columns["x"])
    return number


def main(rotations: int) -> list[list[str]]:
    """Print a line per format; return what, times real time and times velodyne-decoder."""
    simulated = world.load(yaml.safe_load((ROOT / "config/world.yaml").read_text()))
    scanner = SCANNERS["HDL-64E"]
    factory = truth.factory_parameters(simulated, scanner.name)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, calibration = folder / "x.pcap", folder / "x.yaml"
        formats.write(calibration, factory)
        with path.open("wb") as file:
            file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1))
            number = 0
            for block in capture.records(simulated, scanner.name, "P2", "x", rotations):
                for at in range(0, len(block), 1248):
                    micro = number * 288
                    head = struct.pack("<IIII", micro // 10**6, micro % 10**6, 1248, 1248)
                    file.write(head + block[at : at + 1248])
                    number += 1
        seconds = inspect(path).duration_s
        settings = Settings(scanner, factory)
        cases: dict[str, Callable[[], int]] = {
            "velodyne-decoder, nothing written": lambda: theirs(path, calibration),
            "velocal, nothing written": lambda: ours(path, settings, None),
        }
        for suffix in FORMATS:
            out = folder / f"o{suffix}"
            cases[f"velocal, {suffix}"] = lambda out=out: ours(path, settings, out)
        with_shift = Settings(
            scanner, factory, truth.unit_truth(simulated, scanner.name).parameters
        )
        cases["velocal, .ply with shift"] = lambda: ours(path, with_shift, folder / "o.ply")
        print(f"{seconds:.1f} s of recording, {path.stat().st_size / 1e6:.0f} MB")
        reference, rows = None, []
        for label, work in cases.items():
            points, took = best(work)
            reference = reference or took
            print(
                f"{label:36s} {points / 1e6:6.2f} M points {took:6.2f} s "
                f"{seconds / took:6.1f} x real time {reference / took:6.2f} x velodyne-decoder"
            )
            rows.append([label, f"{seconds / took:.1f}", f"{reference / took:.1f}"])
    return rows


if __name__ == "__main__":
    given = [int(each) for each in sys.argv[1:] if each != "--write"]
    found = main(*given or [100])
    if "--write" in sys.argv:
        headings = ["", "x real time", "x velodyne-decoder"]
        table = "\n".join(markdown_table(headings, found, [False, True, True]))
        DOC.write_text(inserted(DOC.read_text(encoding="utf-8"), "points", table), "utf-8")
