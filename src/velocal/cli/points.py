"""Command that applies a calibration to a recording and writes its points."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from velocal.cli.common import (
    Address,
    File,
    Force,
    Port,
    Returns,
    ScannerName,
    escape,
    progress,
    say,
    scanned,
    tell,
)
from velocal.cli.names import SUFFIXES
from velocal.errors import ConfigError
from velocal.io.output import check_outputs

if TYPE_CHECKING:  # imported where it is used, so that the help appears at once
    import numpy as np
    from numpy.typing import NDArray

    from velocal.calibration.files.document import CalibrationFile
    from velocal.scanner.models import Scanner
    from velocal.scanner.parameters import LaserParameters

#: Said where nominal values are used although every unit has a file of its own.
NO_FILE = (
    "nominal values are used: every {} has a calibration of its own, without which points are "
    "off by more than a metre. Name its file by --calibration; some units send it "
    "(`velocal calibration from-recording`)"
)
#: Rotations that the picture is made of: enough to show noise, few enough to draw.
PICTURE_ROTATIONS = 3


def points(
    file: File,
    output: Annotated[
        Path, typer.Option("--output", "-o", help=f"File to write: {', '.join(SUFFIXES)}.")
    ],
    calibration: Annotated[
        str,
        typer.Option("--calibration", "-c", help="Calibration (.xml, .yaml, .csv), or nominal."),
    ] = "nominal",
    before: Annotated[
        str | None,
        typer.Option(help="Another calibration: every point gets its shift since that one."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Picture of the effect, .png (and .svg beside it); needs --before."),
    ] = None,
    scanner: ScannerName = None,
    port: Port = None,
    address: Address = None,
    returns: Returns = "strongest",
    rotations: Annotated[
        str, typer.Option(help="Rotations A:B, from A up to B - 1, as in Python.")
    ] = ":",
    every: Annotated[int, typer.Option(min=1, help="Use every N-th rotation.")] = 1,
    min_range: Annotated[
        float, typer.Option(min=0.0, help="Leave out nearer points, metres.")
    ] = 0.0,
    max_range: Annotated[
        float, typer.Option(min=0.0, help="Leave out farther points, metres.")
    ] = math.inf,
    frame: Annotated[
        str | None,
        typer.Option(
            help="Axes. velocal: Y forward, X right; ros: X forward, Y left. If left out: ros for "
            ".mcap, velocal for the others.",
            show_default=False,
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Write the points of a recording with a calibration: cloud, table or bag of ROS 2.

    A file is applied as the program does for which it is written, with its near-point corrections.
    Every point has its laser, rotation, time and intensity. Rotations are numbered from 0. The
    recording usually cuts the first and the last one.
    """
    from velocal.calibration.applied import applied
    from velocal.clouds.origin import Origin, digest
    from velocal.packets.dual import check_choice
    from velocal.points.files import cloud_writer
    from velocal.points.placing import FRAMES, Settings
    from velocal.points.stream import raw_returns, stream

    frame = frame or ("ros" if output.suffix.lower() == ".mcap" else "velocal")
    if frame not in FRAMES:
        raise ConfigError(f"unknown frame {frame!r}", where="--frame", allowed=", ".join(FRAMES))
    if min_range >= max_range:
        raise ConfigError(
            f"from {min_range:g} to {max_range:g} m there is no point",
            where="--min-range, --max-range",
            allowed="a shorter one, then a longer one",
        )
    if picture is not None and (before is None or picture.suffix.lower() != ".png"):
        raise ConfigError(
            f"{picture.name} cannot be drawn",
            where="--picture",
            allowed="a .png, together with --before",
            hint="The picture shows points before and after: --before nominal, or the old file.",
        )
    check_choice(returns, "--return")
    drawn = [] if picture is None else [picture, picture.with_suffix(".svg")]
    named = [name for name in (calibration, before) if name not in (None, "nominal")]
    check_outputs([output, *drawn], [file, *map(Path, filter(None, named))], overwrite=force)
    recording = scanned(file, scanner, port, address)
    inspection, known = recording.scan(), recording.scanner
    tell([*recording.remarks, *recording.motion_remarks()])
    if calibration == "nominal" and known.has_factory_file:
        tell([NO_FILE.format(known.name)])
    chosen = _chosen(rotations, every, len(inspection.index))
    settings = Settings(
        known,
        _calibration(calibration, known),
        None if before is None else _calibration(before, known),
        min_range or -math.inf,  # negative distances are corrected short ones: keep all
        max_range,
        frame,
        returns,
        recording.source,
    )
    rate_hz = inspection.index.rate_for(known, chosen)
    use = applied(settings.parameters, known, rate_hz)
    origin = Origin(known.name, frame, use.dialect.name, rate_hz, digest(use.parameters))
    facts = {**origin.facts(), "rotations": len(chosen)}
    total = int((inspection.index.packet[chosen + 1] - inspection.index.packet[chosen]).sum())
    number, moved = 0, 0.0
    with (
        cloud_writer(output, shift=before is not None, facts=facts) as write,
        progress(f"Writing {escape(output.name)}") as (bar, task),
    ):
        bar.update(task, total=total)
        for columns, packets in stream(file, inspection, chosen, settings):
            write(columns)
            number += len(columns["x"])
            moved += float(columns["shift"].sum()) if before is not None else 0.0
            bar.advance(task, packets)
    say(f"{output}: {number} points of {len(chosen)} rotations ({known.name}, {calibration})")
    read = [(calibration, use)]
    if before is not None and settings.before is not None:
        read.insert(0, (before, applied(settings.before, known, rate_hz)))
        say(f"moved by {100.0 * moved / max(number, 1):.2f} cm on average since {before}")
    for name, each in read:
        if each.left_out:
            say(f"{name}: {each.left_out}")
    if picture is not None:
        from velocal.points.picture import before_and_after
        from velocal.reporting.style import save  # matplotlib takes a second to load

        some = chosen[:PICTURE_ROTATIONS]
        figure = before_and_after(
            raw_returns(file, inspection, some, settings),
            [each for _, each in read],
            [Path(name).name for name, _ in read],
            f"{file.name}, {known.name}, {len(some)} rotations",
        )
        save(figure, picture.with_suffix(".svg"), picture)
        say(f"{picture}: before and after")


def _calibration(name: str, scanner: Scanner) -> CalibrationFile | LaserParameters:
    """What a calibration file holds, or the nominal parameters."""
    from velocal.calibration.files import formats
    from velocal.scanner.parameters import nominal

    return nominal(scanner) if name == "nominal" else formats.read_for(Path(name), scanner)


def _chosen(rotations: str, every: int, n: int) -> NDArray[np.int64]:
    """Numbers of the rotations A:B.

    Raises
    ------
    ConfigError
        If that is not a range, or no rotation lies in it.
    """
    import numpy as np

    first, colon, last = rotations.partition(":")
    try:
        if not colon:
            raise ValueError
        part = slice(int(first) if first else None, int(last) if last else None, every)
    except ValueError:
        raise ConfigError(
            f"{rotations!r} is not a range", where="--rotations", allowed="A:B, A:, :B or :"
        ) from None
    chosen = np.arange(n)[part]
    if not len(chosen):
        raise ConfigError(
            f"{rotations!r} holds no rotation", where="--rotations", allowed=f"within 0:{n}"
        )
    return chosen
