"""Command that runs the workflow in the folder of a study."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from velocal.errors import ConfigError, RunError
from velocal.io.run_lock import BEGIN, VARIABLE

#: What Snakemake needs to continue after a run that was killed, and to be short.
OPTIONS = ("--rerun-incomplete", "--show-failed-logs", "--scheduler", "greedy")
#: What Snakemake need not tell while it computes: about the machine, why each job runs, and all
#: files of a job. It still tells which jobs are finished, how many there are, and their errors.
QUIET = ("--quiet", "host", "reason", "rules")
#: Options of Snakemake with which nothing is computed.
DRY = {"-n", "--dry-run", "--dryrun"}
#: Options that say how much Snakemake tells.
LOUD = {"-q", "--quiet", "--verbose", "-p", "--printshellcmds"}


def run(
    context: typer.Context,
    cores: Annotated[str, typer.Option("--cores", "-c", help="Number of processes, or all.")],
    folder: Annotated[
        Path, typer.Option("--directory", "-d", help="Folder of the study.", show_default=False)
    ] = Path(),
) -> None:
    """Run the workflow of a study; what a run that was stopped or killed left is continued.

    The last line says where the report is and what it says. All other arguments go to Snakemake:
    targets, --dry-run, --configfile FILE ...
    """
    if not any((folder / name).is_file() for name in ("Snakefile", "workflow/Snakefile")):
        raise ConfigError(
            "there is no Snakefile in this folder",
            where=str(folder.resolve()),
            hint="Change to the folder of a study (--directory), or make one with `velocal init`.",
        )
    if find_spec("snakemake") is None:
        raise RunError(
            "the workflow needs the package snakemake, which is not installed",
            hint=f"Install it: {sys.executable} -m pip install snakemake",
        )
    os.chdir(folder)
    environment, given = dict(os.environ), set(context.args)
    dry = bool(given & DRY)
    if not dry:
        environment[VARIABLE] = BEGIN
    # `--quiet` takes all words up to the next option.
    quiet = () if dry or given & LOUD else QUIET
    command = ["-m", "snakemake", "--cores", cores, *quiet, *OPTIONS, *context.args]
    # Snakemake takes the place of this process, and gets all signals itself.
    os.execve(sys.executable, [sys.executable, *command], environment)
