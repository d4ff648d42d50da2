"""One run of the workflow at a time in a folder of results, also after a run was killed.

The locks are those of the operating system: each ends with the process that holds it, however that
ends, so that none is left behind. Two files in `.snakemake/velocal` belong to every folder of
results. A run holds the first alone. Its jobs share the second, which contains the number of the
run: a new run waits until no job of a killed one is left, and a job that comes late ends.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import sys
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

from velocal.errors import RunError
from velocal.io.output import PART

if sys.platform != "win32":
    import fcntl

#: Environment variable that tells a job of the workflow to which run it belongs.
VARIABLE = "VELOCAL_RUN"
#: Its value in a process that has to begin a run as soon as it knows the folder of results.
BEGIN = "begin"
_FOLDER = Path(".snakemake/velocal")
#: Folder in which Snakemake notes the files of a run; the notes of a killed run remain there.
_SNAKEMAKE_LOCKS = Path(".snakemake/locks")
_PART_NAME = re.compile(rf"\..*\.[0-9a-f]{{16}}{re.escape(PART)}")
#: What a file system without locks answers. Then only Snakemake's own notes protect a run.
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)
#: Open files whose locks this process holds until it ends.
_held: list[int] = []


def begin(results: str, tell: Callable[[str], None]) -> None:
    """Begin a run: from now on this process is the only one that runs on a folder of results.

    Files that a killed run left unfinished there are removed. The second call does nothing.

    Parameters
    ----------
    results : str
        Folder of results, relative to the current folder.
    tell : callable
        Is told in one sentence when jobs of a killed run are waited for.

    Raises
    ------
    RunError
        If another run is at work.
    """
    if _held:
        return
    _FOLDER.mkdir(parents=True, exist_ok=True)
    name = _FOLDER / quote(results, safe="")
    run = _opened(Path(f"{name}.run"))
    if not _locked(run, alone=True, wait=False):
        holder = os.pread(run, 100, 0).decode(errors="replace").strip()
        os.close(run)
        raise RunError(
            f"another run is at work there (process {holder or 'unknown'})",
            where=results,
            hint="Wait until it has ended, or end it with Ctrl-C.",
        )
    _held.append(run)
    _overwrite(run, str(os.getpid()))
    jobs_file = Path(f"{name}.jobs").absolute()
    jobs = _opened(jobs_file)
    if not _locked(jobs, alone=True, wait=False):
        tell(f"Waiting for the end of jobs that a run which was killed left at work in {results}.")
        _locked(jobs, alone=True, wait=True)
    number = secrets.token_hex(8)
    _overwrite(jobs, number)
    os.close(jobs)
    os.environ[VARIABLE] = f"{number}:{jobs_file}"
    for parent, _, names in os.walk(results):
        for each in names:
            if _PART_NAME.fullmatch(each):
                Path(parent, each).unlink(missing_ok=True)


def join() -> None:
    """Tell a new run that this process is a job of the present one; without a run, do nothing.

    Raises
    ------
    RunError
        If the run to which this job belongs has ended, and another one has begun.
    """
    number, _, path = os.environ.get(VARIABLE, "").partition(":")
    if not path or _held:
        return
    try:
        jobs = _opened(Path(path))
    except OSError:
        return  # on another machine that does not share the folder
    _locked(jobs, alone=False, wait=True)
    if os.pread(jobs, 100, 0).decode(errors="replace") != number:
        os.close(jobs)
        raise RunError("the run to which this job belongs was killed, and another one has begun")
    _held.append(jobs)


def remove_snakemake_locks(results: str) -> None:
    """Remove what killed runs on a folder of results left in Snakemake's own folder of locks.

    Only a process that holds the lock of `begin`, and none that Snakemake has made yet, may call
    this. Notes of other workflows in the same folder remain.

    Parameters
    ----------
    results : str
        Folder of results, relative to the current folder.
    """
    for path in sorted(_SNAKEMAKE_LOCKS.glob("*.lock")):
        if any(line.startswith(f"{results}/") for line in path.read_text("utf-8").splitlines()):
            path.unlink(missing_ok=True)


def _opened(path: Path) -> int:
    return os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)


def _overwrite(descriptor: int, text: str) -> None:
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, text.encode(), 0)


def _locked(descriptor: int, *, alone: bool, wait: bool) -> bool:
    """Lock an open file; False if another process holds it and it is not waited for."""
    if sys.platform == "win32":
        return True
    how = (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | (0 if wait else fcntl.LOCK_NB)
    try:
        fcntl.flock(descriptor, how)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    return True
