"""Command that makes the folder of a new study."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from velocal.cli.common import say
from velocal.cli.names import SCANNERS
from velocal.errors import ConfigError

if TYPE_CHECKING:  # imported where it is used, so that the help appears at once
    from velocal.scanner.models import Scanner

#: Scanner of a study where none is named.
SCANNER = "HDL-64E"


def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the new study.")],
    scanner: Annotated[
        str | None,
        typer.Option(
            "--scanner",
            help=f"One of {', '.join(SCANNERS)}, or a file .yaml that describes the scanner of "
            f"clouds. {SCANNER} if left out.",
            show_default=False,
        ),
    ] = None,
    positions: Annotated[
        int, typer.Option(min=1, max=99, help="Surveyed positions, one recording each.")
    ] = 2,
    survey: Annotated[
        bool,
        typer.Option(
            help="Whether walls and floor are surveyed; without a survey, planes are "
            "found in the recordings."
        ),
    ] = True,
    recording: Annotated[
        list[Path] | None,
        typer.Option(
            help="Capture of a study without a survey; may be given several times.",
            show_default=False,
        ),
    ] = None,
    example: Annotated[
        bool,
        typer.Option("--example", help="Write a small complete study of SIMULATED captures."),
    ] = False,
    dialect: Annotated[
        str | None,
        typer.Option(
            help="The recordings are clouds of points that this program computed.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Write a ready folder for your own study: configuration, sample table, survey templates.

    With --recording or --no-survey the study has no survey: planes are found in the recordings.
    With --example nothing has to be filled in: the folder contains simulated captures, their
    survey and a factory's file, and takes less than 5 MB.
    """
    from velocal.study.scanner_file import is_scanner_file, scanner_of
    from velocal.study.template import CAPTURES, FACTORY, write_study

    if example:
        if recording or scanner or not survey:
            raise ConfigError(
                "the example has a scanner, captures and a survey of its own",
                where="--example",
                hint="Leave out --scanner, --recording and --no-survey, or --example.",
            )
        from velocal.simulation.example import write_example  # only here, as it takes a second

        for path in write_example(folder):
            say(f"wrote {path}")
        say(
            f"""
The captures, the survey and the factory's file are SIMULATED; docs/tutorial.md explains them.
Next: cd {folder} && velocal run --cores 2
The report will be {folder / "results/report.html"}."""
        )
        return
    known = scanner_of(scanner or SCANNER, where="--scanner")
    described = Path(scanner) if scanner and is_scanner_file(scanner) else None
    captures = recording or ([] if not survey else None)
    if dialect is not None and not captures:
        raise ConfigError("a dialect without clouds", where="--dialect", allowed="with --recording")
    if described and dialect is None:
        raise ConfigError(
            f"{scanner!r} describes a scanner whose packets are not read",
            where="--scanner",
            allowed=", ".join(SCANNERS),
            hint="Give clouds of points of it with --recording, and their program with --dialect.",
        )
    for path in write_study(folder, known, positions, captures, dialect, described):
        say(f"wrote {path}")
    if captures is not None:
        say(_unsurveyed(folder, known, bool(captures)))
        return
    factory = f", the factory's calibration as {folder / FACTORY}" if known.has_factory_file else ""
    say(
        f"""
Next:
1. Put the captures into {folder / CAPTURES}{factory}; see {folder / "samples.tsv"}.
2. Write the surveyed targets into {folder / "survey"}, and the names of the planes into
   {folder / "config.yaml"} (assignment: planes).
3. cd {folder} && velocal run --cores 2
The report will be {folder / "results/report.html"}; docs/how-to.md explains every step."""
    )


def _unsurveyed(folder: Path, scanner: Scanner, captures: bool) -> str:
    """Next steps of a study without a survey."""
    from velocal.study.template import CAPTURES, FACTORY

    steps = []
    if not captures:
        steps.append(f"Put the captures into {folder / CAPTURES}; see {folder / 'samples.tsv'}.")
    if scanner.has_factory_file:
        steps.append(
            f"Put the factory's calibration into {folder / FACTORY}, or write nominal or embedded "
            f"into {folder / 'samples.tsv'}."
        )
    steps.append(f"cd {folder} && velocal run --cores 2")
    numbered = "\n".join(f"{number}. {step}" for number, step in enumerate(steps, 1))
    return f"""
Next:
{numbered}
The report will be {folder / "results/report.html"}, and the files for programs
{folder / "results/parameter_sets" / scanner.name}; docs/field.md tells what they are worth."""
