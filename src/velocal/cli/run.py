"""Command that runs the workflow in the folder of a study."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from velocal.errors import ConfigError
from velocal.io.run_lock import BEGIN, VARIABLE

#: What Snakemake needs to continue after a run that was killed, and to be short.
OPTIONS = ("--rerun-incomplete", "--show-failed-logs", "--scheduler", "greedy")
#: Options of Snakemake with which nothing is computed.
DRY = ("-n", "--dry-run", "--dryrun")


def run(
    context: typer.Context,
    cores: Annotated[str, typer.Option("--cores", "-c", help="Number of processes, or all.")],
    folder: Annotated[
        Path, typer.Option("--directory", "-d", help="Folder of the study.", show_default=False)
    ] = Path(),
) -> None:
    """Run the workflow of a study; what a run that was stopped or killed left is continued.

    All other arguments go to Snakemake: targets, --dry-run, --configfile FILE ...
    """
    if not any((folder / name).is_file() for name in ("Snakefile", "workflow/Snakefile")):
        raise ConfigError(
            "there is no Snakefile in this folder",
            where=str(folder.resolve()),
            hint="Change to the folder of a study (--directory), or make one with `velocal init`.",
        )
    os.chdir(folder)
    environment = dict(os.environ)
    if not set(context.args) & set(DRY):
        environment[VARIABLE] = BEGIN
    command = [sys.executable, "-m", "snakemake", "--cores", cores, *OPTIONS, *context.args]
    # Snakemake takes the place of this process, and gets all signals itself.
    os.execve(sys.executable, command, environment)
