"""Speed of velocal against other programs, and against reading and copying the same bytes.

Usage: python benchmarks/speed.py [--write] [--only NAME ...] [--rounds N] [--rotations N]

Only `--only five_minutes` runs the study with recordings of five minutes, 7 GB of files.

`make bench` installs the other programs, measures everything and writes the tables and the figure
of docs/performance.md. Without one of them, its rows say that it is missing.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from speed_adjustment import adjustment
from speed_decoding import decoding
from speed_measure import ROOT, Measures, Recorded, children, machine, recorded, table
from speed_scale import draw, measured, scaling
from speed_tables import medians, parquet, points
from speed_workflow import workflow

from velocal.io.markup import inserted

PAGE = ROOT / "docs/performance.md"
FIGURE = ROOT / "docs/images/scaling.svg"
#: Parts of the page, in its order.
SECTIONS = (
    "machine", "decoding", "medians", "parquet", "points", "adjustment", "starts", "scaling",
    "workflow", "five_minutes",
)  # fmt: skip
#: Free space for the recordings, bytes.
SPACE = 5e9
PROGRAMS = (
    "velodyne-decoder", "dpkt", "numpy", "scipy", "pandas", "polars", "duckdb", "pyarrow",
)  # fmt: skip


def about(rotations: int) -> str:
    """Machine, versions and size of what is measured."""
    known = []
    for name in PROGRAMS:
        try:
            known.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            known.append(f"{name} (not installed)")
    python = ".".join(map(str, sys.version_info[:3]))
    return (
        f"Measured on {datetime.now(UTC):%Y-%m-%d}: {machine()}; Python {python}, "
        f"{', '.join(known)}. The recording: {rotations} rotations of a simulated HDL-64E."
    )


def starts(folder: Path, rounds: int) -> str:
    """Table of the processor time of commands on small files."""
    small, out = recorded(_made(folder / "small"), "HDL-32E", 12), str(folder / "out")
    capture, file = str(small.files["pcap"]), str(small.calibration)
    commands = {
        "velocal --help": ["--help"],
        "velocal --version": ["--version"],
        "velocal points --help": ["points", "--help"],
        "velocal inspect": ["inspect", capture],
        "velocal decode": ["decode", capture, "-o", f"{out}.parquet", "--force"],
        "velocal points": ["points", capture, "-o", f"{out}.ply", "-c", file, "--force"],
        "velocal calibration show": ["calibration", "show", file],
        "velocal calibration lint": ["calibration", "lint", file],
        "velocal calibration convert": ["calibration", "convert", file, f"{out}.csv", "--force"],
        "velocal init": ["init", str(folder / "study")],
    }
    measures = Measures()

    def started(*arguments: str) -> None:
        shutil.rmtree(folder / "study", ignore_errors=True)
        command = [sys.executable, *arguments]
        subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)

    measures.add("python, nothing else", partial(started, "-c", "pass"))
    measures.add("python, import numpy", partial(started, "-c", "import numpy"))
    for name, arguments in commands.items():
        measures.add(name, partial(started, "-m", "velocal", *arguments))
    measures.run(rounds, children)
    return table(["what", "ms"], [[name, measures.time_of(name)] for name in measures.works])


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def main() -> None:
    """Measure, print the tables, and write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--only", nargs="*", choices=SECTIONS)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--rotations", type=int, default=100)
    given = parser.parse_args()
    texts: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if shutil.disk_usage(folder).free < SPACE:
            sys.exit(f"error: less than {SPACE / 1e9:.0f} GB are free in {folder.parent}")
        recording: Recorded = recorded(folder, "HDL-64E", given.rotations)

        def scale() -> str:
            found = measured(folder)
            draw(found, FIGURE if given.write else folder / "s.svg", folder / "scaling.png")
            return scaling(found)

        sections: dict[str, Callable[[], str]] = {
            "machine": lambda: about(given.rotations),
            "decoding": lambda: decoding(recording, given.rounds),
            "medians": lambda: medians(recording, given.rounds),
            "parquet": lambda: parquet(recording, folder, given.rounds),
            "points": lambda: points(recording, folder, max(given.rounds - 2, 1)),
            "adjustment": lambda: adjustment(max(given.rounds - 2, 1)),
            "starts": lambda: starts(folder, given.rounds),
            "scaling": scale,
            "workflow": lambda: workflow(folder, "recordings of 33 s"),
            "five_minutes": lambda: workflow(folder, "recordings of five minutes"),
        }
        for section in given.only or [name for name in SECTIONS if name != "five_minutes"]:
            texts[section] = sections[section]()
            print(f"## {section}\n\n{texts[section]}\n", flush=True)
    if given.write:
        page = PAGE.read_text("utf-8")
        for section, text in texts.items():
            page = inserted(page, section, text)
        PAGE.write_text(page, "utf-8")


if __name__ == "__main__":
    main()
