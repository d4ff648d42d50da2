"""Command that makes the folder of a new study."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from velocal.cli.common import say
from velocal.errors import ConfigError
from velocal.scanner.models import SCANNERS, Scanner, scanner_named
from velocal.study.template import CAPTURES, FACTORY, write_study

#: Holds `workflow/` where velocal was installed from a checkout, as `make` does.
CHECKOUT = Path(__file__).parents[3]


def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the new study.")],
    scanner: Annotated[
        str, typer.Option("--scanner", help=f"One of {', '.join(SCANNERS)}.")
    ] = "HDL-64E",
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
    dialect: Annotated[
        str | None,
        typer.Option(
            help="The recordings are clouds of points that this program computed.",
            show_default=False,
        ),
    ] = None,
    checkout: Annotated[
        Path, typer.Option(help="Checkout of velocal that holds the workflow.", show_default=False)
    ] = CHECKOUT,
) -> None:
    """Write a ready folder for your own study: configuration, sample table, survey templates.

    With --recording or --no-survey the study has no survey: planes are found in the recordings.
    """
    known = scanner_named(scanner, where="--scanner")
    captures = recording or ([] if not survey else None)
    if dialect is not None and not captures:
        raise ConfigError("a dialect without clouds", where="--dialect", allowed="with --recording")
    workflow = checkout / "workflow/Snakefile"
    for path in write_study(folder, known, positions, workflow, captures, dialect):
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
