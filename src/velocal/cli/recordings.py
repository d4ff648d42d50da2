"""Commands that look at recordings, decode them, and take out their embedded calibration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from velocal.cli.common import (
    Address,
    Dialect,
    File,
    Force,
    Json,
    MaxMissing,
    Port,
    Returns,
    ScannerName,
    escape,
    print_json,
    progress,
    say,
    scanned,
    tell,
)
from velocal.cli.names import SCANNERS
from velocal.errors import ConfigError, RecordingError
from velocal.io.output import check_outputs
from velocal.study.windows import MAX_MISSING

if TYPE_CHECKING:  # imported where it is used, so that the help appears at once
    from velocal.capture.ledger import Ledger
    from velocal.recording.inspection import Inspection
    from velocal.scanner.models import Scanner


def inspect(
    file: File,
    scanner: ScannerName = None,
    port: Port = None,
    address: Address = None,
    max_missing: MaxMissing = MAX_MISSING,
    dialect: Dialect = None,
    calibration: Annotated[
        Path | None,
        typer.Option("--calibration", "-c", help="Calibration of that program (default: nominal)."),
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="Axes of a cloud, velocal or ros, where it does not say.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show what a recording holds: scanner, rotations, rates, and a ledger of every byte.

    With --dialect it is a cloud of points: how many of them that program makes of raw values.
    """
    if dialect is not None:
        _inspect_cloud(file, scanner, dialect, calibration, frame, address, as_json=as_json)
        return
    from velocal.capture.ledger import NothingUsableError

    try:
        recording = scanned(file, scanner, port, address, max_missing)
    except NothingUsableError as error:
        if as_json:
            print_json({"file": file.name, "ledger": error.ledger.as_dict()})
        else:
            _print_ledger(error.ledger)
        raise
    inspection = recording.scan()
    known: Scanner | None = None
    try:
        known, remarks = recording.scanner, recording.remarks
    except RecordingError as error:
        if scanner is not None:
            raise
        remarks = [error.what, *inspection.remarks]
    name = "unknown" if known is None else known.name
    told = inspection.as_dict(known)
    facts = {"file": file.name, "scanner": name, **told, "remarks": remarks}
    if as_json:
        print_json(facts)
        return
    _print_facts(inspection, known, remarks)


def _inspect_cloud(
    file: Path,
    scanner: str | None,
    dialect: str,
    calibration: Path | None,
    frame: str | None,
    topic: str | None,
    *,
    as_json: bool,
) -> None:
    """Print what `read_cloud` finds, as a table or as JSON."""
    from velocal.calibration.files import formats
    from velocal.recording.cloud import read_cloud
    from velocal.study.scanner_file import scanner_of

    known = None if scanner is None else scanner_of(scanner, where="--scanner")
    numbers = None
    if calibration is not None:
        n_lasers = None if known is None else known.n_lasers
        numbers = formats.read_calibration(calibration, n_lasers)
    found = read_cloud(file, known, numbers, dialect=dialect, frame=frame, topic=topic)
    if as_json:
        print_json({"file": file.name, "scanner": found.returns.scanner.name, **found.as_dict()})
        return
    top = Table(show_header=False, box=None, pad_edge=False)
    for label, text in {"scanner": found.returns.scanner.name, **found.facts}.items():
        top.add_row(f"[bold]{label}[/]", escape(text))
    Console(highlight=False).print(top)


def _print_facts(inspection: Inspection, scanner: Scanner | None, remarks: list[str]) -> None:
    """Print facts, remarks and the ledger as tables."""
    ledger = inspection.ledger
    console = Console(highlight=False)
    top = Table(show_header=False, box=None, pad_edge=False)
    senders = ", ".join(f"{name} ({n})" for name, n in ledger.senders.items())
    name = "unknown" if scanner is None else scanner.name
    rows = {"scanner": name, "framing": ledger.framing, "sent from": senders or "unknown"}
    rows |= {fact.label: fact.text for fact in inspection.facts(scanner) if fact.label}
    if ledger.reordered:
        rows["put in order"] = f"{ledger.reordered} packets that had come late"
    if ledger.assembled:
        rows["assembled"] = f"{ledger.assembled} packets from IP fragments"
    if ledger.nmea:
        rows["NMEA"] = ledger.nmea
    for label, text in rows.items():
        top.add_row(f"[bold]{label}[/]", escape(text))
    for remark in remarks:
        top.add_row("[bold yellow]remark[/]", escape(remark))
    console.print(top)
    _print_ledger(ledger)


def _print_ledger(ledger: Ledger) -> None:
    """Print the ledger as a table."""
    table = Table("ledger", "packets", "bytes", title=None)
    for column in table.columns[1:]:
        column.justify = "right"
    table.add_row("data packets, payload", f"{ledger.data.packets}", f"{ledger.data.bytes}")
    table.add_row("their framing", "", f"{ledger.framing_bytes}")
    table.add_row("position packets", f"{ledger.position.packets}", f"{ledger.position.bytes}")
    for reason, count in ledger.rejected.items():
        table.add_row(f"rejected: {escape(reason)}", f"{count.packets}", f"{count.bytes}")
    table.add_row("unaccounted", "", f"{ledger.unaccounted_bytes}")
    table.add_section()
    table.add_row("content of the file", "", f"{ledger.file_bytes}")
    Console(highlight=False).print(table)


def decode(
    file: File,
    output: Annotated[Path, typer.Option("--output", "-o", help="Parquet file to write.")],
    scanner: ScannerName = None,
    window: Annotated[
        str, typer.Option(help="Rotations to decode: all, beginning, middle or end.")
    ] = "all",
    rotations: Annotated[int, typer.Option(min=1, help="Complete rotations of a window.")] = 100,
    port: Port = None,
    address: Address = None,
    max_missing: MaxMissing = MAX_MISSING,
    returns: Returns = "both",
    force: Force = False,
) -> None:
    """Decode rotations to a table of returns in raw ticks (Parquet)."""
    from velocal.packets.dual import check_choice
    from velocal.recording.recording import WINDOWS
    from velocal.recording.returns import write_returns

    if window not in WINDOWS:
        raise ConfigError(
            f"unknown window {window!r}", where="--window", allowed=", ".join(WINDOWS)
        )
    check_choice(returns, "--return")
    check_outputs([output], [file], overwrite=force)
    recording = scanned(file, scanner, port, address, max_missing)
    known, index = recording.scanner, recording.rotations
    tell(recording.remarks)
    chosen = recording.select(window, rotations)
    total = int(index.packet[chosen[-1] + 1] - index.packet[chosen[0]])
    with progress(f"Decoding {escape(file.name)}") as (bar, task):
        rows = write_returns(
            file,
            index,
            chosen,
            known,
            output,
            lambda done: bar.update(task, completed=done, total=total),
            returns=returns,
            source=recording.source,
        )
    say(f"{output}: {rows} returns of {len(chosen)} rotations ({known.name})")


def from_recording(
    file: File,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Calibration to write: .xml .yaml .csv .json")
    ],
    port: Port = None,
    address: Address = None,
    force: Force = False,
) -> None:
    """Write the factory's calibration that an HDL-64E S2 or S3 sends in its status bytes."""
    from velocal.calibration.files import formats

    check_outputs([output], [file], overwrite=force)
    status = scanned(file, port=port, address=address).status
    formats.write(output, status.calibration(str(file)))
    say(f"{output}: {status.tables_text}")


def from_cloud(
    file: File,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Calibration to write: .csv or .json")
    ],
    scanner: Annotated[
        str, typer.Option("--scanner", help=f"One of {', '.join(SCANNERS)}, or a file .yaml")
    ],
    frame: Annotated[
        str | None, typer.Option(help="Axes of the cloud, velocal or ros, where it does not say.")
    ] = None,
    address: Address = None,
    force: Force = False,
) -> None:
    """Write the vertical angles and offsets with which the points of a cloud were computed.

    For clouds whose calibration file is not public, as that of KITTI: the file that is written
    stands for it, and the cloud is one of the dialect paper then.
    """
    import numpy as np

    from velocal.calibration.files import formats
    from velocal.calibration.files.document import CalibrationFile
    from velocal.recording.cloud import parameters_of_cloud
    from velocal.study.scanner_file import scanner_of

    check_outputs([output], [file], overwrite=force)
    known = scanner_of(scanner, where="--scanner")
    found = parameters_of_cloud(file, known, frame=frame, topic=address)
    formats.write(output, CalibrationFile(found, "paper", known.name, known.distance_tick_m))
    degrees = np.rad2deg(found.v - known.vertical_rad)
    say(f"{output}: vertical angles {np.median(degrees):+.3f} deg from the nominal ones (median)")
