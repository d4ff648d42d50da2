"""A case of the catalogue, and how it is run: in this process, through the command line."""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from unittest.mock import patch

from support.running import small_disk

from velocal.cli import main
from velocal.errors import VelocalError
from velocal.io import schemas, storage
from velocal.simulation.world import read as read_world
from velocal.study.files import check_files
from velocal.study.reading import check_configuration
from velocal.study.study import read_study
from velocal.survey.files import check_survey
from velocal.survey.network.field_book import FILES, read_field_book
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.station import adjust_station, read_station
from velocal.survey.targets import read_covariances

#: Readers of files of our own, which no command reads.
READERS: dict[str, Callable[[Path], object]] = {
    "medians": lambda path: storage.read_table(path, schemas.MEDIANS),
    "station": read_station,
    "covariances": read_covariances,
    "columns": storage.read_csv,
    "world": read_world,
    "observations": lambda folder: adjust_field_book(
        read_field_book({name: folder / f"{name}.csv" for name in FILES}), where="survey"
    ),
}
#: Command of a case that plans a study, as the Snakefile of `velocal init` does.
PLAN = ("snakemake",)


class Outcome(StrEnum):
    """What happens with an input."""

    USED = "used"
    TOLD = "told"
    REFUSED = "refused"
    BROKEN = "traceback"


@dataclass(frozen=True)
class Case:
    """A faulty input.

    Attributes
    ----------
    wrong : str
        What is wrong with it, for the page; unique within its kind.
    outcome : Outcome
        What has to happen.
    make : callable
        Writes the input into a folder.
    command : tuple of str
        Arguments of `velocal`; `PLAN`; or "read", the name of a reader in `READERS`, and a file.
    disk_bytes : int, optional
        Largest size of a file while the command runs: stands for a disk that is full.
    """

    wrong: str
    outcome: Outcome
    make: Callable[[Path], object]
    command: tuple[str, ...]
    disk_bytes: int | None = None


@dataclass(frozen=True)
class Result:
    """What happened.

    Attributes
    ----------
    outcome : Outcome
    message : str
        First line, without "Error:"; what was told, if nothing was refused.
    hint : str
    """

    outcome: Outcome
    message: str = ""
    hint: str = ""


def run(case: Case, folder: Path) -> Result:
    """Write the input of a case into an empty folder, and run its command there.

    Parameters
    ----------
    case : Case
    folder : Path

    Returns
    -------
    Result
    """
    case.make(folder)
    with _inside(folder), _captured() as (out, err), small_disk(case.disk_bytes):
        try:
            code: int | str = _command(case.command)
        except VelocalError as error:
            code = f"Error: {error}"
        except BaseException as error:
            # Not its text: it may hold the number of a process.
            return Result(Outcome.BROKEN, type(error).__name__)
    said = code if isinstance(code, str) else err.getvalue()
    lines = said.splitlines()
    if lines and lines[0].startswith("Error: "):
        hint = next((line for line in lines if line.startswith("Hint: ")), "")
        return Result(Outcome.REFUSED, lines[0][len("Error: ") :], hint[len("Hint: ") :])
    told = _told(case.command, out.getvalue(), code)
    return Result(Outcome.TOLD if told else Outcome.USED, told)


def _command(arguments: tuple[str, ...]) -> int:
    if arguments == PLAN:
        return _plan()
    if arguments[0] == "read":
        READERS[arguments[1]](Path(arguments[2]))
        return 0
    with patch.object(sys, "argv", ["velocal", *arguments]):
        try:
            main()
        except SystemExit as end:
            return end.code if isinstance(end.code, int) else 1
    return 0


def _plan() -> int:
    """Check a study as the Snakefiles do, and adjust the stations as the first rule does."""
    from snakemake.common.configfile import load_configfile

    check_configuration(Path("config.yaml"))
    study = read_study(load_configfile("config.yaml"), "config.yaml")
    check_files(study, "config.yaml")
    check_survey(study)
    if survey := study.coordinates:
        for position, scanner in study.positions.items():
            adjust_station(
                survey.planes, survey.base_scanner, survey.base_site,
                position=position, scanner=scanner, names=study.assignment.planes,
            )  # fmt: skip
    return 0


def _told(command: tuple[str, ...], out: str, code: object) -> str:
    """What a command that refused nothing says of its input."""
    if command[0] == "inspect":
        facts = json.loads(out)
        rejected = facts["ledger"]["rejected"]
        parts = [*facts["remarks"]]
        parts += [f"rejected: {why} ({n['packets']})" for why, n in rejected.items()]
        if facts["scanner"] == "unknown":
            parts.insert(0, "scanner: unknown")
        if facts["packets_missing"]:
            parts.append(f"gaps: {facts['gaps']}, packets missing: {facts['packets_missing']}")
        if facts.get("clock", "device") != "device":
            parts.append(f"clock: {facts['clock']}")
        if not facts["rotations_complete"]:
            parts.append("rotations complete: 0")
        return "; ".join(parts)
    return out.splitlines()[0] if command[:2] == ("calibration", "lint") and code else ""


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


@contextlib.contextmanager
def _captured() -> Iterator[tuple[io.StringIO, io.StringIO]]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield out, err
