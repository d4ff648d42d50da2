"""Files that a study names: they exist, and a survey holds targets of what the study uses."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path

from velocal.errors import ConfigError
from velocal.io.written_tables import read_written_table
from velocal.study.config import Coordinates
from velocal.study.samples import NOMINAL, OutdoorSample, Sample, embedded_path
from velocal.study.study import Study

#: Seconds that the time of a file may be ahead, as clocks of servers are.
AHEAD_S = 1.0
#: Where a study says which targets it needs, by the column of the survey file.
_NAMED_IN = {
    "plane": "`assignment: planes`",
    "scanner": "the sample table",
    "position": "the sample table",
}


def given_files(study: Study) -> dict[str, str]:
    """Files that people hand over: those that a study names and no rule makes.

    Parameters
    ----------
    study : Study

    Returns
    -------
    dict of str to str
        What every file is, by its path.
    """
    folder = study.config.folder
    made = study.made_files() | {embedded_path(folder, name) for name in study.samples}
    return {path: what for what, path in _named(study) if path not in made | {NOMINAL}}


def check_times(folder: Path) -> None:
    """Check that no result has a time in the future.

    Snakemake tells by the times of files what is older than what it was made from. A clock that
    was once ahead would let old results pass for new ones.

    Parameters
    ----------
    folder : Path
        Of results; it need not exist.

    Raises
    ------
    ConfigError
        If a file has such a time.
    """
    for parent, folders, names in os.walk(folder):
        folders.sort()
        for path in (Path(parent, name) for name in sorted(names)):
            _check_time(
                path,
                str(path),
                f"Correct the clock of this machine, and remove all such files (`find {folder} "
                "-newermt now -delete`): they are made again.",
            )


def _check_time(path: Path, where: str, hint: str) -> None:
    """Raise an error if a file has a time in the future."""
    try:
        changed = path.lstat().st_mtime
    except OSError:
        return
    if changed > time.time() + AHEAD_S:
        when = datetime.fromtimestamp(changed).isoformat(" ", "seconds")
        raise ConfigError(f"its time is in the future: {when}", where=where, hint=hint)


def check_files(study: Study, where: str) -> None:
    """Check the files that no rule makes; without this, old results would hide a missing one.

    Parameters
    ----------
    study : Study
    where : str
        How to call the configuration in errors.

    Raises
    ------
    ConfigError
        If a file is missing or has a time in the future, or a survey file has no target of a
        plane, a scanner or a position that the study uses.
    """
    made, folder = study.made_files(), study.config.folder
    hint = (
        "Put it there, or name another; paths are relative to the folder in which snakemake runs."
    )
    if made:
        hint += f" Simulated files lie below {folder}/simulation, each under its sample's name."
    for path, what in given_files(study).items():
        if not _is_file(path):
            raise ConfigError(f"{what}: no file {path!r}", where=where, hint=hint)
        _check_time(Path(path), f"{what}: {path}", f"Set it to now: touch {shlex.quote(path)}")
    if study.surveyed and isinstance(study.config.survey, Coordinates):
        survey = study.config.survey
        scanners, positions = study.scanners, list(study.positions)
        _check_targets("survey.planes", survey.planes, "plane", study.assignment.planes)
        _check_targets("survey.base_scanner", survey.base_scanner, "scanner", scanners)
        _check_targets("survey.base_site", survey.base_site, "position", positions)


def _named(study: Study) -> Iterable[tuple[str, str]]:
    """What every file of a study is, and its path."""
    if study.observations:
        for key, path in study.observations.plain().items():
            if path is not None:
                yield f"survey.observations.{key}", path
    elif study.config.survey:
        for key, path in study.config.survey.plain().items():
            yield f"survey.{key}", path
    samples: list[Sample | OutdoorSample] = [*study.samples.values(), *study.outdoor.values()]
    for sample in samples:
        if not sample.is_remote:
            yield f"recording of sample {sample.name!r}", sample.recording
        yield f"calibration of sample {sample.name!r}", sample.calibration
    for name, path in study.scanner_files.items():
        yield f"description of scanner {name!r}", path
    if study.config.simulation:
        yield "simulation.world", study.config.simulation.world


def _check_targets(key: str, path: str, column: str, wanted: Iterable[str]) -> None:
    """Check that a survey file has targets of every plane, scanner or position that is used."""
    table = read_written_table(Path(path), [column], ConfigError, optional=None)
    found = list(dict.fromkeys(table.columns[column]))
    for name in wanted:
        if name not in found:
            raise ConfigError(
                f"{key}: there is no target of {column} {name!r}",
                where=path,
                allowed=", ".join(found) or None,
                hint="Write the surveyed targets into this file, below its heading, or correct the "
                f"name in {_NAMED_IN[column]}.",
            )


def _is_file(path: str) -> bool:
    """Whether there is a file; there is none under a name that no file can have."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False
