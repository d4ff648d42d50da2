"""Show, check, convert and compare calibration files."""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from velocal.cli.common import Force, Json, escape, print_json, say
from velocal.cli.names import DIALECTS, RANGES_M, RATE_HZ, SCANNERS
from velocal.errors import ConfigError
from velocal.io.output import check_outputs

if TYPE_CHECKING:  # imported where it is used, so that the help appears at once
    from velocal.arrays import Array
    from velocal.calibration.dialects import Dialect
    from velocal.calibration.files.document import CalibrationFile
    from velocal.scanner.models import Scanner

NAMES = ", ".join(DIALECTS)
#: Headings in the terminal.
SHORT = {
    "dist_correction_x_cm": "x_cm",
    "dist_correction_y_cm": "y_cm",
    "two_pt_correction_available": "2pt",
    "focal_distance_cm": "focal",
    "focal_slope": "slope",
    "min_intensity": "min",
    "max_intensity": "max",
}

app = typer.Typer(
    help="Show, check, convert and compare calibration files: db.xml, YAML, our CSV and JSON.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)

File = Annotated[Path, typer.Argument(metavar="FILE", help="Calibration: .xml .yaml .csv .json")]
ScannerName = Annotated[
    str | None,
    typer.Option(
        "--scanner",
        help=f"{', '.join(SCANNERS)}, or a file .yaml. Told by the vertical angles if left out.",
    ),
]
Rate = Annotated[
    float | None,
    typer.Option(
        "--rate-hz", min=0.1, max=50.0, help="Rotation rate, for azimuths within firings."
    ),
]


@app.command()
def show(
    file: File,
    scanner: ScannerName = None,
    as_json: Json = False,
) -> None:
    """Print what a calibration holds, in degrees and centimetres."""
    from velocal.calibration.files import formats

    found = _read(file, scanner)
    dialect = formats.dialect_of(found, file)
    columns, known = _shown(found), _scanner(found, scanner)
    facts: dict[str, Any] = {
        "file": file.name,
        "lasers": len(found.parameters),
        "scanner": known.name if known else "unknown",
        "dialect": dialect.name if found.dialect else f"{dialect.name} (the file does not say)",
        "distance tick": f"{1000 * found.tick_m:g} mm",
        "turned off": _listed(found),
        "rotation rate": f"{found.rotation_rate_hz:g} Hz" if found.rotation_rate_hz else "any",
        "provenance": dict(found.provenance),
    }
    if as_json:
        print_json({**facts, "columns": columns})
        return
    console = Console(highlight=False)
    top = Table(show_header=False, box=None, pad_edge=False)
    for key, value in facts.items():
        if value:
            top.add_row(f"[bold]{key}[/]", escape(value if isinstance(value, str) else str(value)))
    console.print(top)
    # Plain lines: a table would be cut to the width of the terminal, and lose digits.
    texts = {"laser": [str(laser) for laser in range(len(found.parameters))]}
    texts |= {SHORT.get(k, k): [f"{x:.6g}" for x in values] for k, values in columns.items()}
    widths = [max(map(len, (name, *cells))) for name, cells in texts.items()]
    for row in (texts.keys(), *zip(*texts.values(), strict=True)):
        say("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)))


@app.command()
def lint(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Calibrations to check.")],
    scanner: ScannerName = None,
    as_json: Json = False,
) -> None:
    """Look for faults: lasers missing or doubled, units, signs, values that cannot be.

    The exit code is 1 if there are any.
    """
    from velocal.calibration.lint import lint as find_faults
    from velocal.study.scanner_file import scanner_of

    known = scanner_of(scanner, where="--scanner") if scanner else None
    faults = 0
    told: dict[str, list[dict[str, str]]] = {}
    for file in files:
        findings = find_faults(file, known)
        faults += len(findings)
        if as_json:
            told[str(file)] = [asdict(finding) for finding in findings]
            continue
        for finding in findings:
            say(f"{file}: {finding.code}: {finding.text}")
        if not findings:
            say(f"{file}: no problems found")
    if as_json:
        print_json(told)
    if faults:
        raise typer.Exit(1)


@app.command("convert")
def convert_file(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="Calibration to read.")],
    target: Annotated[
        Path, typer.Argument(metavar="TARGET", help="File to write: .xml .yaml .csv .json")
    ],
    source_dialect: Annotated[
        str | None,
        typer.Option(
            "--from", help="Dialect of SOURCE. If left out: what the file says, else manual."
        ),
    ] = None,
    target_dialect: Annotated[
        str | None,
        typer.Option(
            "--to",
            help=f"Program that will read TARGET: {NAMES}. "
            "Chosen by suffix if left out: .xml veloview, .yaml ros, .csv paper, .json as SOURCE.",
        ),
    ] = None,
    scanner: ScannerName = None,
    rate_hz: Rate = None,
    inexact: Annotated[
        bool, typer.Option("--inexact", help="Write TARGET even if its points differ.")
    ] = False,
    force: Force = False,
) -> None:
    """Write a calibration in another format, with the numbers that its reader needs.

    Programs compute points by different formulas ("dialects"). The numbers are converted such
    that the reader of TARGET gets the points that SOURCE stands for. Where two programs only
    interpolate near-point corrections differently, as the manual and ROS do, TARGET is written and
    the differences are printed. Where more is impossible, nothing is written unless --inexact is
    given. A dialect of the same name on both sides keeps all numbers.
    """
    from velocal import __version__
    from velocal.calibration.convert import convert, differences, near_points_differ
    from velocal.calibration.dialects import dialect_named
    from velocal.calibration.files import formats

    check_outputs([target], [source], overwrite=force)
    found = _read(source, scanner)
    before = _dialect(found, source, source_dialect, "--from")
    default = formats.format_of(target).default or before.name
    after = dialect_named(target_dialect or default, where="--to")
    if target.suffix.lower() == ".csv" and after.name != "paper":
        raise ConfigError(
            f"a CSV cannot hold the dialect {after.name}",
            where=str(target),
            allowed="paper",
            hint="Write .json, which says what it holds.",
        )
    known = _scanner(found, scanner)
    rate_hz = rate_hz or found.rotation_rate_hz
    near = near_points_differ(found.parameters, before, after, known, rate_hz)
    inexact = inexact or bool(near)
    parameters = convert(
        found.parameters, before, after, scanner=known, rate_hz=rate_hz, inexact=inexact
    )
    provenance = {
        "velocal": __version__,
        "source": source.name,
        "sha256": hashlib.sha256(source.read_bytes()).hexdigest(),
        "dialect": before.name,
        **({"before": dict(found.provenance)} if found.provenance else {}),
    }
    result = replace(
        found,
        parameters=parameters,
        dialect=after.name,
        scanner=known.name if known else None,
        provenance=provenance,
        disabled=(),
        rotation_rate_hz=rate_hz if known and _turned(before, after, known) else None,
    )
    lost = (found.std or found.covariance) and before != after
    formats.write(target, replace(result, std={}, covariance={}) if lost else result)
    say(f"{target}: {len(parameters)} lasers, {before.name} to {after.name}")
    if found.disabled:
        say(f"Left out, as {source.name} turns them off: {_listed(found)}")
    if inexact and before != after:
        rate = rate_hz or RATE_HZ
        if near:
            say(f"{after.name} is not {before.name}: {'; '.join(near)}")
        say(differences(found.parameters, before, parameters, after, known, rate))
    if lost:
        say("Standard deviations belong to the other dialect and were left out")


@app.command()
def diff(
    first: Annotated[Path, typer.Argument(metavar="FIRST", help="Calibration.")],
    second: Annotated[Path, typer.Argument(metavar="SECOND", help="Calibration to compare.")],
    ranges: Annotated[str, typer.Option(help="Ranges in metres, separated by commas.")] = ",".join(
        f"{r:g}" for r in RANGES_M
    ),
    first_dialect: Annotated[
        str | None, typer.Option("--first", help=f"Program that reads FIRST: {NAMES}.")
    ] = None,
    second_dialect: Annotated[
        str | None, typer.Option("--second", help="Program that reads SECOND.")
    ] = None,
    scanner: ScannerName = None,
    rate_hz: Rate = RATE_HZ,
    picture: Annotated[
        Path | None, typer.Option("--figure", help="Picture to write (.png; .svg beside it).")
    ] = None,
    csv: Annotated[Path | None, typer.Option("--csv", help="Differences of every laser.")] = None,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Show the distances between the points of two calibrations, at chosen ranges.

    The same file may be given twice, with different programs: the distances are then what the
    choice of the program costs. Without dialects, the numbers mean what the files say they mean.
    """
    from velocal.calibration.convert import max_point_distance

    at = _ranges(ranges)
    drawn = [] if picture is None else [picture.with_suffix(".svg"), picture.with_suffix(".png")]
    check_outputs([*drawn, *([csv] if csv else [])], [first, second], overwrite=force)
    a, b = _read(first, scanner), _read(second, scanner)
    one = _dialect(a, first, first_dialect, "--first")
    other = _dialect(b, second, second_dialect, "--second")
    known = _scanner(a, scanner)
    apart = max_point_distance(
        (one, a.parameters), (other, b.parameters), at, scanner=known, rate_hz=rate_hz or RATE_HZ
    )
    labels = f"{first.name} ({one.name})", f"{second.name} ({other.name})"
    note = "per laser the largest over all azimuths" + (
        f"; azimuths within a firing of the {known.name} at {rate_hz:g} Hz" if known else ""
    )
    if as_json:
        rows = [
            {"range_m": range_m, "distance_cm": list(row)}
            for range_m, row in zip(at, 100.0 * apart, strict=True)
        ]
        sides = {"first": labels[0], "second": labels[1]}
        print_json({**sides, "scanner": known.name if known else None, "ranges": rows})
    else:
        _print_differences(labels, at, 100.0 * apart, note)
    if picture or csv:
        from velocal.reporting.figures.calibration import difference_table, draw_differences
        from velocal.reporting.style import save

        if csv:
            from velocal.io.storage import write_csv

            write_csv(csv, difference_table(at, apart), digits=4)
        if picture:
            figure = draw_differences(at, apart, *labels, note)
            save(figure, picture.with_suffix(".svg"), picture.with_suffix(".png"))


def _print_differences(
    labels: tuple[str, str], at: tuple[float, ...], apart_cm: Array, note: str
) -> None:
    """Print distances (ranges, lasers) between points as a table."""
    import numpy as np

    table = Table(
        "range", "median", "95 %", "largest", "of laser", title=escape(" against ".join(labels))
    )
    for column in table.columns:
        column.justify = "right"
    for range_m, row in zip(at, apart_cm, strict=True):
        numbers = (np.median(row), np.quantile(row, 0.95), row.max())
        laser = str(int(row.argmax())) if row.max() > 0 else ""
        table.add_row(f"{range_m:g} m", *(f"{value:.2f} cm" for value in numbers), laser)
    console = Console(highlight=False)
    console.print(table)
    console.print(f"{note[0].upper()}{note[1:]}.")


def _read(file: Path, scanner: str | None) -> CalibrationFile:
    from velocal.calibration.files import formats
    from velocal.calibration.fit import check_fit
    from velocal.study.scanner_file import scanner_of

    if scanner is None:
        return formats.read_calibration(file)
    known = scanner_of(scanner, where="--scanner")
    found = formats.read_calibration(file, known.n_lasers, scanner=known.name)
    check_fit(found.parameters.v, known, str(file), found.scanner)
    return found


def _turned(before: Dialect, after: Dialect, scanner: Scanner) -> bool:
    """Whether the numbers of a program hold at one rotation rate, stated or that of the source."""
    from velocal.calibration.convert import depends_on_rate
    from velocal.calibration.dialects import PAPER

    if before == after:
        return depends_on_rate(PAPER, after, scanner)
    return depends_on_rate(before, after, scanner) and depends_on_rate(PAPER, after, scanner)


def _listed(found: CalibrationFile) -> str:
    """Lasers that the file turns off although it has values of them."""
    numbers = ", ".join(map(str, found.disabled))
    return f"laser {numbers}" if numbers else ""


def _dialect(found: CalibrationFile, file: Path, named: str | None, where: str) -> Dialect:
    from velocal.calibration.dialects import dialect_named
    from velocal.calibration.files import formats

    return dialect_named(named, where=where) if named else formats.dialect_of(found, file)


def _scanner(found: CalibrationFile, named: str | None) -> Scanner | None:
    from velocal.calibration.fit import fitting
    from velocal.scanner.models import SCANNERS
    from velocal.study.scanner_file import scanner_of

    if named:
        return scanner_of(named, where="--scanner")
    if found.scanner:
        return SCANNERS.get(found.scanner)
    return next(fitting(found.parameters.v), None)


def _ranges(text: str) -> tuple[float, ...]:
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if not found or not all(0.0 < each <= 1000.0 for each in found):
        raise ConfigError(
            f"ranges are {text!r}", where="--ranges", allowed="metres, up to 1000", hint="3,10,25"
        )
    return found


def _shown(found: CalibrationFile) -> dict[str, Any]:
    """Columns in the units of users, deviations beside their parameter."""
    from velocal.scanner.parameters import UNITS

    units = {"m": ("cm", 100.0), "rad": ("deg", 180.0 / math.pi)}
    columns: dict[str, Any] = {}
    for name, unit in UNITS.items():
        suffix, factor = units[unit]
        columns[f"{name}_{suffix}"] = getattr(found.parameters, name) * factor
        if name in found.std:
            columns[f"{name}_std_{suffix}"] = found.std[name] * factor
    for name, values in found.parameters.carried.items():
        metres = name.startswith(("dist", "focal_d"))
        columns[f"{name}_cm" if metres else name] = values * (100.0 if metres else 1.0)
    return columns
