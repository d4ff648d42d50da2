"""Tables of docs/dialects.md: how far points of one file are apart, and what conversion leaves.

Usage: python benchmarks/dialects.py CALIBRATION... [--write]

The calibrations are of HDL-64E; --write puts the tables into the document.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from velocal.calibration.convert import RANGES_M, convert, for_program, max_point_distance
from velocal.calibration.dialects import DIALECTS, MANUAL, PAPER
from velocal.calibration.files import formats
from velocal.io.markup import inserted
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

DOC = Path(__file__).parents[1] / "docs/dialects.md"


def row(*cells: str) -> str:
    """One line of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def sizes(metres: np.ndarray) -> list[str]:
    """Median and largest over the lasers, centimetres, per range."""
    return [f"{100 * np.median(each):.1f} / {100 * each.max():.1f}" for each in metres]


def differences(path: Path) -> str:
    """Points of every program from the numbers of one file, against those of the manual."""
    parameters = formats.read_calibration(path, 64).parameters
    mrpt = replace(DIALECTS["mrpt"], alpha=True)
    programs = {name: (dialect, None) for name, dialect in DIALECTS.items() if dialect != MANUAL}
    programs["mrpt, if it applied alpha"] = (mrpt, None)
    for name in ("veloview", "velodyne_decoder"):
        programs[f"{name}, interpolating at 10 Hz"] = (DIALECTS[name], SCANNERS["HDL-64E"])
    lines = [
        row(f"`{path.name}`", *(f"{range_m:g} m" for range_m in RANGES_M)),
        row("---", *["---"] * len(RANGES_M)),
    ]
    for name, (dialect, scanner) in programs.items():
        metres = max_point_distance((MANUAL, parameters), (dialect, parameters), scanner=scanner)
        lines.append(row(name, *sizes(metres)))
    return "\n".join(lines)


def leftovers() -> str:
    """What is left of the difference after a set of this project is exported."""
    names = ("HDL-64E", "HDL-32E", "VLP-16", "VLP-32C", "VLS-128")
    lines = [
        row("written for", *names, "and with `--rate-hz 10`"),
        row("---", *["---"] * (len(names) + 1)),
    ]
    for name, dialect in DIALECTS.items():
        cells, turned = [], []
        for scanner in (SCANNERS[each] for each in names):
            design = nominal(scanner)
            pair = (PAPER, design), (dialect, for_program(design, name))
            cells.append(f"{100 * max_point_distance(*pair, (80.0,), scanner=scanner).max():.1f}")
            known = convert(design, PAPER, dialect, scanner=scanner, rate_hz=10.0, inexact=True)
            left = max_point_distance((PAPER, design), (dialect, known), (80.0,), scanner=scanner)
            turned.append(f"{100 * left.max():.1f}")
        lines.append(row(name, *cells, ", ".join(turned)))
    return "\n".join(lines)


def tables(paths: list[Path]) -> dict[str, str]:
    """Tables by the name of their place in the document."""
    found = {"leftovers": leftovers()}
    if paths:
        found["differences"] = "\n\n".join(differences(path) for path in paths)
    return found


if __name__ == "__main__":
    text = DOC.read_text(encoding="utf-8")
    for name, table in tables([Path(each) for each in sys.argv[1:] if each != "--write"]).items():
        print(f"{table}\n")
        text = inserted(text, name, table)
    if "--write" in sys.argv:
        DOC.write_text(text, encoding="utf-8")
