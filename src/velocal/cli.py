"""The command line `velocal`: look at recordings and decode them."""

from __future__ import annotations

import sys
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
from rich.table import Table

from velocal import __version__
from velocal.errors import ConfigError, VelocalError
from velocal.recording.identify import candidates, check_scanner
from velocal.recording.rotations import Inspection, inspect
from velocal.recording.windows import window_rotations
from velocal.returns import write_returns
from velocal.sensors import SCANNERS, Scanner, scanner_named

app = typer.Typer(
    help="Calibrate Velodyne laser scanners against surveyed planes.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_errors = Console(stderr=True, highlight=False, soft_wrap=True)

Recording = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="Capture: records of 1206 or 1248 bytes, or classic pcap."),
]
ScannerName = Annotated[
    str | None,
    typer.Option("--scanner", help=f"What made it: {', '.join(SCANNERS)}. Found if left out."),
]


def main() -> None:
    """Run the command line; faults of the input end in one message and exit code 1."""
    try:
        app()
    except VelocalError as error:
        _errors.print(f"[bold red]Error:[/] {_escape(str(error))}")
        sys.exit(1)


def _escape(text: str) -> str:
    return text.replace("[", r"\[")


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"velocal {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show version.")
    ] = False,
) -> None:
    pass


@contextmanager
def _progress(what: str) -> Iterator[tuple[Progress, TaskID]]:
    """Progress bar on the terminal's error stream; nothing where that is not a terminal."""
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=_errors,
        transient=True,
        disable=not _errors.is_terminal,
    )
    with bar:
        yield bar, bar.add_task(what, total=None)


def _scan(file: Path) -> Inspection:
    with _progress(f"Scanning {_escape(file.name)}") as (bar, task):
        return inspect(file, lambda done, total: bar.update(task, completed=done, total=total))


def _scanner(inspection: Inspection, name: str | None, file: Path) -> tuple[Scanner, list[str]]:
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


@app.command("inspect")
def inspect_command(
    file: Recording,
    scanner: ScannerName = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Tell what a recording holds: scanner, rotations, rates, and a ledger of every byte."""
    inspection = _scan(file)
    try:
        known, remarks = _scanner(inspection, scanner, file)
        name = known.name
    except ConfigError as error:
        if scanner is not None:
            raise
        name, remarks = "unknown", [error.what]
    facts = {"file": file.name, "scanner": name, **inspection.as_dict(), "remarks": remarks}
    if as_json:
        import json

        from velocal.storage import finite

        print(json.dumps(finite(facts), indent=1, allow_nan=False))
        return
    _print_facts(inspection, name, remarks)


def _print_facts(inspection: Inspection, scanner: str, remarks: list[str]) -> None:
    facts, ledger = inspection.as_dict(), inspection.ledger
    console = Console(highlight=False)
    top = Table(show_header=False, box=None, pad_edge=False)
    index = inspection.index
    rows = {
        "scanner": scanner,
        "framing": ledger.framing,
        "duration": f"{inspection.duration_s:.3f} s ({inspection.clock} clock)",
        "rotations": f"{len(index)}, {int(index.complete.sum())} complete",
        "rotation rate": f"{index.rate_hz():.3f} Hz",
        "packet rate": f"{facts['packet_rate_hz']:.1f} Hz",
        "azimuth step": f"{facts['azimuth_step_deg']:.2f} deg, "
        f"in multiples of {facts['azimuth_resolution_deg']:.2f} deg",
        "blocks": ", ".join(f"{count} {side}" for side, count in inspection.block_counts.items()),
        "gaps": f"{inspection.gaps}, about {inspection.packets_missing} packets missing",
        "product byte": facts["product"] or "none",
        "calibration in stream": "yes" if inspection.calibration_in_stream else "no",
    }
    for key, value in rows.items():
        top.add_row(f"[bold]{key}[/]", value)
    for remark in remarks:
        top.add_row("[bold yellow]remark[/]", _escape(remark))
    console.print(top)
    table = Table("ledger", "packets", "bytes", title=None)
    for column in table.columns[1:]:
        column.justify = "right"
    table.add_row("data packets, payload", f"{ledger.data.packets}", f"{ledger.data.bytes}")
    table.add_row("their framing", "", f"{ledger.framing_bytes}")
    table.add_row("position packets", f"{ledger.position.packets}", f"{ledger.position.bytes}")
    for reason, count in ledger.rejected.items():
        table.add_row(f"rejected: {_escape(reason)}", f"{count.packets}", f"{count.bytes}")
    table.add_row("unaccounted", "", f"{ledger.unaccounted_bytes}")
    table.add_section()
    table.add_row("file", "", f"{ledger.file_bytes}")
    console.print(table)


@app.command()
def decode(
    file: Recording,
    output: Annotated[Path, typer.Option("--output", "-o", help="Parquet file to write.")],
    scanner: ScannerName = None,
    window: Annotated[
        str, typer.Option(help="Rotations to decode: all, beginning, middle or end.")
    ] = "all",
    rotations: Annotated[int, typer.Option(min=1, help="Complete rotations of a window.")] = 100,
) -> None:
    """Decode rotations to a table of returns in raw ticks (Parquet)."""
    if window not in ("all", "beginning", "middle", "end"):
        raise ConfigError(
            f"unknown window {window!r}", where="--window", allowed="all, beginning, middle, end"
        )
    inspection = _scan(file)
    known, _ = _scanner(inspection, scanner, file)
    chosen = window_rotations(inspection.index, window, rotations, str(file))
    index = inspection.index
    total = int(index.packet[chosen[-1] + 1] - index.packet[chosen[0]])
    with _progress(f"Decoding {_escape(file.name)}") as (bar, task):
        rows = write_returns(
            file,
            index,
            chosen,
            known,
            output,
            lambda done: bar.update(task, completed=done, total=total),
        )
    print(f"{output}: {rows} returns of {len(chosen)} rotations ({known.name})")


if __name__ == "__main__":
    main()
