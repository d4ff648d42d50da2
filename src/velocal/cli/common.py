"""What commands share: consoles, progress, arguments that many take."""

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
from velocal.errors import ConfigError
from velocal.packets.dual import CHOICES
from velocal.recording.identify import candidates, check_scanner
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
    typer.Option("--scanner", help=f"What made it: {', '.join(SCANNERS)}. Found if left out."),
]


Returns = Annotated[
    str,
    typer.Option("--return", help="Of shots with two returns: both, strongest or last."),
]


def check_returns(returns: str) -> None:
    """Check the choice of returns.

    Raises
    ------
    ConfigError
        If it is unknown.
    """
    if returns not in CHOICES:
        raise ConfigError(
            f"unknown return {returns!r}",
            where="--return",
            allowed=", ".join(CHOICES),
            hint="It matters only where a scanner was set to dual return.",
        )


def escape(text: str) -> str:
    """Text that the console shows as it is."""
    return text.replace("[", r"\[")


@contextmanager
def progress(what: str) -> Iterator[tuple[Progress, TaskID]]:
    """Progress bar on the terminal's error stream; nothing where that is not a terminal."""
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
    """Scan a recording, with progress."""
    with progress(f"Scanning {escape(file.name)}") as (bar, task):
        return inspect(
            file, lambda done, total: bar.update(task, completed=done, total=total), source
        )


def scanner_of(inspection: Inspection, name: str | None, file: Path) -> tuple[Scanner, list[str]]:
    """The scanner that was named, checked, or the one that fits best."""
    if name is not None:
        scanner = scanner_named(name, where="--scanner")
        return scanner, check_scanner(inspection, scanner, str(file))
    fits = candidates(inspection)
    if not fits:
        raise ConfigError(
            "flags and packet rate fit no known scanner",
            where=str(file),
            hint="Name it with --scanner.",
        )
    return fits[0], check_scanner(inspection, fits[0], str(file))
