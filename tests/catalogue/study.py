"""A sound study of a user, in which a case changes one file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from velocal.scanner.models import SCANNERS
from velocal.study.template import write_study

ROOT = Path(__file__).parents[2]
SCANNER = "HDL-32E"
#: Corners of two walls and the floor.
_PLANES = {
    "wall1": [(0, 0, 0), (5, 0, 0), (5, 0, 2), (0, 0, 2)],
    "wall2": [(0, 0, 0), (0, 4, 0), (0, 4, 2), (0, 0, 2)],
    "floor": [(0, 0, 0), (5, 0, 0), (5, 4, 0), (0, 4, 0)],
}
_BASE = [(-0.3, 0.15, 0.0), (0.3, 0.15, 0.0), (0.0, -0.3, 0.1), (0.1, 0.2, 0.15)]
PLANES, BASE, SITE, SAMPLES, CONFIG = (
    "survey/planes.csv",
    "survey/base_scanner.csv",
    "survey/base_field.csv",
    "samples.tsv",
    "config.yaml",
)


def sound(folder: Path) -> None:
    """Write the folder of `velocal init` with a survey; its captures are empty files."""
    write_study(folder, SCANNERS[SCANNER], 2)
    for number in (1, 2):
        (folder / f"captures/sample{number}.pcap").touch()
    rows = {
        PLANES: [
            f"{plane}_{number},{plane},{x},{y},{z},1,1,1"
            for plane, corners in _PLANES.items()
            for number, (x, y, z) in enumerate(corners)
        ],
        BASE: [f"B{n},{SCANNER},{x},{y},{z},1,1,1" for n, (x, y, z) in enumerate(_BASE)],
        SITE: [
            f"B{n},{position},{x + shift},{y + 1.5},{z + 0.8},1,1,1"
            for position, shift in (("P1", 1.5), ("P2", 2.5))
            for n, (x, y, z) in enumerate(_BASE)
        ],
    }
    for name, lines in rows.items():
        path = folder / name
        head = [line for line in path.read_text().splitlines() if line.startswith("target")]
        path.write_text("\n".join(["# surveyed on Monday", *head, *lines, ""]))


def replaced(*changes: tuple[str, str, str]) -> Callable[[Path], None]:
    """Replace the first occurrence of a text in a file, several times."""

    def make(folder: Path) -> None:
        sound(folder)
        for name, old, new in changes:
            text = (folder / name).read_text()
            assert old in text, (old, text)
            (folder / name).write_text(text.replace(old, new, 1))

    return make


def rewritten(name: str, change: Callable[[str], str | bytes]) -> Callable[[Path], None]:
    """Rewrite a whole file."""

    def make(folder: Path) -> None:
        sound(folder)
        after = change((folder / name).read_text())
        data = after if isinstance(after, bytes) else after.encode()
        (folder / name).write_bytes(data)

    return make
