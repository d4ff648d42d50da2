"""Look at recordings and decode them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from velocal.capture.source import SourceFilter
from velocal.cli import stream
from velocal.cli.common import (
    Address,
    Port,
    Recording,
    Returns,
    ScannerName,
    check_returns,
    escape,
    progress,
    scan,
    scanner_of,
)
from velocal.errors import ConfigError
from velocal.recording.returns import write_returns
from velocal.recording.scan import Inspection
from velocal.recording.windows import window_rotations


def inspect(
    file: Recording,
    scanner: ScannerName = None,
    port: Port = None,
    address: Address = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Tell what a recording holds: scanner, rotations, rates, and a ledger of every byte."""
    inspection = scan(file, SourceFilter(port, address))
    try:
        known, remarks = scanner_of(inspection, scanner, file)
        name = known.name
    except ConfigError as error:
        if scanner is not None:
            raise
        name, remarks = "unknown", [error.what]
    facts = {"file": file.name, "scanner": name, **inspection.as_dict(), "remarks": remarks}
    if as_json:
        import json

        from velocal.io.storage import finite

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
        "sent from": ", ".join(f"{name} ({n})" for name, n in ledger.senders.items()) or "unknown",
        "duration": f"{inspection.duration_s:.3f} s ({inspection.clock} clock)",
        "rotations": f"{len(index)}, {int(index.complete.sum())} complete",
        "rotation rate": f"{index.rate_hz():.3f} Hz",
        "packet rate": f"{facts['packet_rate_hz']:.1f} Hz",
        "azimuth step": f"{facts['azimuth_step_deg']:.2f} deg, "
        f"in multiples of {facts['azimuth_resolution_deg']:.2f} deg",
        "blocks": ", ".join(f"{count} {side}" for side, count in inspection.block_counts.items()),
        "returns": facts["returns"],
        "gaps": f"{inspection.gaps}, about {inspection.packets_missing} packets missing",
        "product byte": facts["product"] or "none",
        **stream.rows(inspection.status),
    }
    for key, value in rows.items():
        top.add_row(f"[bold]{key}[/]", value)
    if ledger.reordered:
        top.add_row("[bold]put in order[/]", f"{ledger.reordered} packets that had come late")
    if ledger.assembled:
        top.add_row("[bold]assembled[/]", f"{ledger.assembled} packets from IP fragments")
    if ledger.nmea:
        top.add_row("[bold]NMEA[/]", escape(ledger.nmea))
    for remark in remarks:
        top.add_row("[bold yellow]remark[/]", escape(remark))
    console.print(top)
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
    console.print(table)


def decode(
    file: Recording,
    output: Annotated[Path, typer.Option("--output", "-o", help="Parquet file to write.")],
    scanner: ScannerName = None,
    window: Annotated[
        str, typer.Option(help="Rotations to decode: all, beginning, middle or end.")
    ] = "all",
    rotations: Annotated[int, typer.Option(min=1, help="Complete rotations of a window.")] = 100,
    port: Port = None,
    address: Address = None,
    returns: Returns = "both",
) -> None:
    """Decode rotations to a table of returns in raw ticks (Parquet)."""
    if window not in ("all", "beginning", "middle", "end"):
        raise ConfigError(
            f"unknown window {window!r}", where="--window", allowed="all, beginning, middle, end"
        )
    check_returns(returns)
    source = SourceFilter(port, address)
    inspection = scan(file, source)
    known, _ = scanner_of(inspection, scanner, file)
    chosen = window_rotations(inspection.index, window, rotations, str(file))
    index = inspection.index
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
            source=source,
        )
    print(f"{output}: {rows} returns of {len(chosen)} rotations ({known.name})")
