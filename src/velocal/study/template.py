"""A ready folder for a user's own study, from the templates in `data`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import jinja2

from velocal.calibration.dialects import DIALECTS, dialect_named
from velocal.errors import ConfigError
from velocal.io import storage
from velocal.io.output import writing
from velocal.scanner.models import SCANNERS, Scanner

#: Where the capture and the factory's file are looked for until the sample table says otherwise.
CAPTURES = "captures"
FACTORY = "factory.xml"


def write_study(
    folder: Path,
    scanner: Scanner,
    positions: int,
    recordings: Sequence[Path] | None = None,
    dialect: str | None = None,
    description: Path | None = None,
) -> list[Path]:
    """Write the files of a study, none of which may exist.

    Parameters
    ----------
    folder : Path
        Is made where it does not exist.
    scanner : Scanner
    positions : int
        Surveyed positions of the scanner, one recording each.
    recordings : sequence of Path, optional
        Captures of a study without a survey; where none is given, its table names `positions`
        captures that are still to be recorded. If left out, the study has a survey.
    dialect : str, optional
        Program that computed the points, where the recordings are clouds.
    description : Path, optional
        File that describes the scanner, where it is not among `SCANNERS`.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ConfigError
        If a file exists, or a recording does not, or no dialect has that name.
    """
    if dialect is not None:
        dialect_named(dialect, where="--dialect")
    for path in recordings or ():
        if not path.is_file():
            raise ConfigError(
                "there is no such file", where=str(path), hint="Name a capture with --recording."
            )
    samples = [f"sample{number + 1}" for number in range(len(recordings or ()) or positions)]
    captures = [str(path.resolve()) for path in recordings or ()]
    values = {
        "scanner": scanner.name,
        "scanner_cell": scanner.name if description is None else str(description.resolve()),
        "described": description is not None,
        "scanners": ", ".join(SCANNERS),
        "origin_height_m": scanner.origin_height_m,
        "azimuth_bin_deg": scanner.azimuth_bin_ticks / 100,
        "captures": CAPTURES,
        "samples": samples,
        "recordings": list(zip(samples, captures or [f"{n}.pcap" for n in samples], strict=True)),
        "dialect": dialect,
        "dialects": ", ".join(DIALECTS),
        "positions": [f"P{number + 1}" for number in range(positions)],
        # Scanners without a file of their unit are made to the nominal values.
        "calibration": FACTORY if scanner.has_factory_file else "nominal",
    }
    kind = "surveyed" if recordings is None else "unsurveyed"
    return write_templates(folder, kind, values)


def write_templates(folder: Path, kind: str, values: Mapping[str, Any]) -> list[Path]:
    """Write the templates that every study has and those of one kind, and make `CAPTURES`.

    Parameters
    ----------
    folder : Path
        Is made where it does not exist.
    kind : str
        Folder of templates in `data`.
    values : mapping
        Names that the templates use.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    ConfigError
        If one of the files exists.
    """
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    data = resources.files("velocal.study") / "data"
    texts = {
        folder / name: environment.from_string(source.read_text("utf-8")).render(values)
        for part in ("both", kind)
        for name, source in _templates(data / part).items()
    }
    for path in texts:
        if path.exists():
            raise ConfigError(
                "exists already, nothing was written",
                where=str(path),
                hint="Choose another folder, or move the old files away.",
            )
    for path, text in texts.items():
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        storage.write_text(path, text)
    with writing(folder / CAPTURES):
        (folder / CAPTURES).mkdir(exist_ok=True)
    return list(texts)


def _templates(folder: Traversable, below: str = "") -> dict[str, Traversable]:
    """Files of a folder and those below it, by relative path."""
    found: dict[str, Traversable] = {}
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        path = below + entry.name
        found |= _templates(entry, path + "/") if entry.is_dir() else {path: entry}
    return found
