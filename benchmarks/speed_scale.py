"""Processor time and peak memory of recordings of 1, 5 and 20 minutes: a table and a figure.

Usage: python benchmarks/speed_scale.py WORK FILE   (one measurement, in a process of its own)

The recording is one minute of a simulated HDL-32E again and again, with time stamps that go on.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from speed_measure import HEADERS, read, records, table

from velocal.packets.data import view
from velocal.recording.recording import Recording, open_recording
from velocal.scanner.parameters import nominal

SCANNER = "HDL-32E"
MINUTES = (1, 5, 20)
_HOUR_US = 3_600_000_000


def scan(recording: Recording) -> int:
    """Index of rotations and ledger."""
    return len(recording.rotations)


def decode(recording: Recording) -> int:
    """Scan, and raw columns of all rotations, a part at a time."""
    return sum(len(part) for part in recording.stream_returns("all"))


def points(recording: Recording) -> int:
    """Scan, and X, Y, Z of all rotations, a part at a time."""
    from velocal.points.stream import stream_points

    parameters = nominal(recording.scanner)
    return sum(len(part["x"]) for part in stream_points(recording, parameters))


def medians(recording: Recording) -> int:
    """Scan, and medians of three windows of 100 rotations, as a study takes them."""
    return sum(len(recording.medians(each)) for each in ("beginning", "middle", "end"))


WORKS: dict[str, Callable[[Recording], int]] = {
    "scan": scan,
    "scan and raw columns": decode,
    "scan and X, Y, Z": points,
    "scan and medians of three windows": medians,
}


def measure(work: str, path: Path) -> dict[str, float]:
    """Processor time and peak memory of one work; the imports count as well."""
    read(path)  # into the memory of the system, as far as it fits
    start = resource.getrusage(resource.RUSAGE_SELF)
    WORKS[work](open_recording(path, SCANNER))
    end = resource.getrusage(resource.RUSAGE_SELF)
    took = end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime
    # The peak of this process only: `ru_maxrss` begins with that of the process that started it.
    status = Path("/proc/self/status").read_text("ascii")
    peak = int(status.split("VmHWM:")[1].split()[0])
    return {"seconds": took, "mebibytes": peak / 1024}


def measured(folder: Path) -> dict[str, list[dict[str, float]]]:
    """Measure every work, in a process of its own, on recordings that become longer."""
    path = folder / "long.bin"
    # A whole number of rotations, so that the azimuth goes on where the minute begins again.
    payloads = records(SCANNER, 600)[:, HEADERS:]
    azimuth = view(payloads)["blocks"]["azimuth"][:, 0].astype(np.int64)
    begins = np.flatnonzero(np.diff(azimuth) < 0) + 1
    minute = np.ascontiguousarray(payloads[begins[0] : begins[600]])
    stamps = view(minute)["timestamp"].astype(np.int64)
    interval = int(np.median(np.diff(stamps) % _HOUR_US))
    stamps = (stamps - stamps[0]) % _HOUR_US
    found: dict[str, list[dict[str, float]]] = {work: [] for work in WORKS}
    number = 0
    for minutes in MINUTES:
        with path.open("ab") as file:
            while number < minutes:
                since = stamps + number * (stamps[-1] + interval)
                view(minute)["timestamp"][:] = since % _HOUR_US
                file.write(minute)
                number += 1
        for work, results in found.items():
            command = [sys.executable, __file__, work, str(path)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            results.append(json.loads(done.stdout) | {"bytes": path.stat().st_size})
    return found


def scaling(found: dict[str, list[dict[str, float]]]) -> str:
    """Table of processor time per minute of recording, and of peak memory."""
    rows = []
    for work, results in found.items():
        per_minute = [
            f"{each['seconds'] / minutes:.3f}"
            for each, minutes in zip(results, MINUTES, strict=True)
        ]
        peaks = [each["mebibytes"] for each in results]
        grows = f"{100 * (peaks[-1] / peaks[0] - 1):+.0f} %"
        rows.append([work, *per_minute, *(f"{peak:.0f}" for peak in peaks), grows])
    headings = [
        "what",
        *(f"s per minute, {minutes} min" for minutes in MINUTES),
        *(f"MiB, {minutes} min" for minutes in MINUTES),
        "memory, 1 to 20 min",
    ]
    return table(headings, rows)


def draw(found: dict[str, list[dict[str, float]]], svg: Path, png: Path) -> None:
    """Draw processor time and peak memory over the length of the recording."""
    from matplotlib.figure import Figure

    from velocal.reporting.style import COLOURS, finish, save, style

    with style():
        figure = Figure(figsize=(7.4, 3.2))
        left, right = figure.subplots(1, 2)
        for (work, results), colour in zip(found.items(), COLOURS, strict=False):
            seconds = [each["seconds"] for each in results]
            peaks = [each["mebibytes"] for each in results]
            left.plot(MINUTES, seconds, "o-", color=colour, markersize=4, label=work)
            right.plot(MINUTES, peaks, "o-", color=colour, markersize=4)
        for ax, label in ((left, "processor time [s]"), (right, "peak memory [MiB]")):
            ax.set_xlabel("recording [min]")
            ax.set_ylabel(label)
            ax.set_xticks(MINUTES)
            ax.set_xlim(0, 1.05 * MINUTES[-1])
            ax.set_ylim(bottom=0)
        finish(
            figure,
            [left],
            "Processor time grows with the recording, and memory does not",
            simulated=True,
            ncols=2,
        )
        save(figure, svg, png)


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1], Path(sys.argv[2]))))
