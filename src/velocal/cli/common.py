"""What commands share: the console of errors, progress bars, arguments and options."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from velocal.capture.source import SourceFilter
from velocal.recording.identify import identify
from velocal.recording.inspection import Inspection
from velocal.recording.scan import inspect
from velocal.scanner.models import SCANNERS, Scanner, scanner_named

errors = Console(stderr=True, highlight=False, soft_wrap=True)

Recording = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help="Capture: records of 1206 or 1248 bytes, pcap, pcapng, any of them gzipped; ROS bag.",
    ),
]
Port = Annotated[
    int | None,
    typer.Option("--port", min=0, max=65535, help="UDP port to which the scanner sends."),
]
Address = Annotated[
    str | None,
    typer.Option("--address", help="IPv4 address from which it sends; in a bag, its topic."),
]
ScannerName = Annotated[
    str | None,
    typer.Option(
        "--scanner", help=f"Scanner: {', '.join(SCANNERS)}. Identified by its packets if left out."
    ),
]


Returns = Annotated[
    str,
    typer.Option("--return", help="Where a shot has two returns: both, strongest or last."),
]


def escape(text: str) -> str:
    """Protect a text from being read as markup of the console."""
    return text.replace("[", r"\[")


@contextmanager
def progress(what: str) -> Iterator[tuple[Progress, TaskID]]:
    """Show a progress bar on the error stream, if that is a terminal.

    Parameters
    ----------
    what : str
        Text before the bar.

    Yields
    ------
    bar : Progress
    task : TaskID
        To be updated by the caller.
    """
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=errors,
        transient=True,
        disable=not errors.is_terminal,
    )
    with bar:
        yield bar, bar.add_task(what, total=None)


def scan(file: Path, source: SourceFilter) -> Inspection:
    """Scan a recording, with progress.

    Raises
    ------
    RecordingError
        As `inspect`.
    """
    with progress(f"Scanning {escape(file.name)}") as (bar, task):
        return inspect(
            file, lambda done, total: bar.update(task, completed=done, total=total), source
        )


def scanner_of(inspection: Inspection, name: str | None, file: Path) -> tuple[Scanner, list[str]]:
    """Scanner that made a recording, and remarks; see `identify`.

    Parameters
    ----------
    inspection : Inspection
        Of the recording.
    name : str or None
        Name that the user stated.
    file : Path
        The recording, for errors.
    """
    stated = None if name is None else scanner_named(name, where="--scanner")
    return identify(inspection, stated, str(file))
