"""What commands share: the console of errors, progress bars, arguments and options."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich import markup
from rich.console import Console

from velocal.cli.names import DIALECTS, SCANNERS
from velocal.errors import visible
from velocal.study.windows import MAX_MISSING

if TYPE_CHECKING:  # imported where it is used, so that the help appears at once
    from rich.progress import Progress, TaskID

    from velocal.recording.recording import Recording

errors = Console(stderr=True, highlight=False, soft_wrap=True)

File = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help="Capture: records of 1206 or 1248 bytes, pcap, pcapng, compressed or not; ROS bag.",
    ),
]
Port = Annotated[
    int | None,
    typer.Option("--port", min=0, max=65535, help="UDP port to which the scanner sends."),
]
Address = Annotated[
    str | None,
    typer.Option("--address", help="IP address from which it sends; in a bag, its topic."),
]
ScannerName = Annotated[
    str | None,
    typer.Option(
        "--scanner", help=f"Scanner: {', '.join(SCANNERS)}. Identified by its packets if left out."
    ),
]


Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")]
MaxMissing = Annotated[
    float,
    typer.Option(
        "--max-missing",
        min=0.0,
        max=1.0,
        help="Share of its azimuth that a complete rotation may miss where packets are lost.",
    ),
]

Dialect = Annotated[
    str | None,
    typer.Option(
        help="FILE is a cloud of points that this program computed: "
        f"{', '.join(DIALECTS)}. --address is a topic of PointCloud2.",
        show_default=False,
    ),
]

Returns = Annotated[
    str,
    typer.Option("--return", help="Where a shot has two returns: both, strongest or last."),
]


def print_json(facts: Mapping[str, Any]) -> None:
    """Print facts for programs; numbers that JSON lacks are null."""
    from velocal.io.storage import finite

    print(json.dumps(finite(facts), indent=1, allow_nan=False))


def escape(text: str, *, newlines: bool = False) -> str:
    """Protect a text from being read as markup of the console, and from acting on the terminal.

    Parameters
    ----------
    text : str
    newlines : bool
        As of `velocal.errors.visible`.
    """
    return markup.escape(visible(text, newlines=newlines))


def say(text: str) -> None:
    """Print what a command did; file names in it may hold anything."""
    print(visible(text, newlines=True))


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
    from rich.progress import Progress

    with Progress(console=errors, transient=True, disable=not errors.is_terminal) as bar:
        yield bar, bar.add_task(what, total=None)


def tell(remarks: list[str]) -> None:
    """Print remarks on the error stream."""
    for remark in remarks:
        errors.print(f"[bold yellow]remark[/] {escape(remark)}")


def scanned(
    file: Path,
    scanner: str | None = None,
    port: int | None = None,
    address: str | None = None,
    max_missing: float = MAX_MISSING,
) -> Recording:
    """Open a recording and scan it, with progress.

    Parameters and errors are those of `open_recording` and of `Recording.scan`.
    """
    from velocal.recording.recording import open_recording
    from velocal.scanner.models import scanner_named

    stated = None if scanner is None else scanner_named(scanner, where="--scanner")
    recording = open_recording(file, stated, port, address, max_missing)
    with progress(f"Scanning {escape(file.name)}") as (bar, task):
        recording.scan(lambda done, total: bar.update(task, completed=done, total=total))
    return recording
