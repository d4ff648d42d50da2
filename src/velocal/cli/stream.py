"""The status stream of HDL-64E recordings on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from velocal.calibration.files import formats
from velocal.capture.source import SourceFilter
from velocal.cli.common import Address, Port, Recording, scan
from velocal.packets.status import StatusStream


def from_recording(
    file: Recording,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Calibration to write: .xml .yaml .csv .json")
    ],
    port: Port = None,
    address: Address = None,
) -> None:
    """Write the factory's calibration that an HDL-64E S2 or S3 sends in its status bytes."""
    status = scan(file, SourceFilter(port, address)).status
    formats.write(output, status.calibration(str(file)))
    print(f"{output}: {table_summary(status)}")


def rows(status: StatusStream) -> dict[str, str]:
    """What `velocal inspect` tells of the trailing bytes."""
    told = {}
    if status.temperature_deg_c is not None:
        first, last = status.temperature_deg_c
        told["temperature"] = f"{first:.0f} deg C" + (
            f", later {last:.0f}" if last != first else ""
        )
    if status.firmware is not None:
        told["firmware"] = status.firmware
    if status.gps is not None:
        time = f"{status.gps_time:%Y-%m-%d %H:%M:%S}" if status.gps_time else "no date"
        free = "" if status.gps_valid else ", clock runs free"
        told["GPS time"] = f"{time} (GPS: {status.gps}{free})"
    told["calibration in stream"] = (
        f"complete, {table_summary(status)}"
        if status.parameters is not None
        else f"no: {status.why_not[0]}"
    )
    return told


def table_summary(status: StatusStream) -> str:
    """Form of the table, how often it was found, and what was left out."""
    found = f"{status.series}, {status.tables} table{'s' if status.tables != 1 else ''} alike"
    left = {
        "with packets missing": status.broken,
        "failed their check": status.failed,
        "deviating": status.deviating,
    }
    return "; ".join([found, *(f"{count} {why}" for why, count in left.items() if count)])
