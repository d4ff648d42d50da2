"""Command that makes the folder of a new study."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from velocal.scanner.models import SCANNERS, scanner_named
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
    checkout: Annotated[
        Path, typer.Option(help="Checkout of velocal that holds the workflow.", show_default=False)
    ] = CHECKOUT,
) -> None:
    """Write a ready folder for your own study: configuration, sample table, survey templates."""
    known = scanner_named(scanner, where="--scanner")
    for path in write_study(folder, known, positions, checkout / "workflow/Snakefile"):
        print(f"wrote {path}")
    factory = f", the factory's calibration as {folder / FACTORY}" if known.has_factory_file else ""
    print(
        f"""
Next:
1. Put the captures into {folder / CAPTURES}{factory}; see {folder / "samples.tsv"}.
2. Write the surveyed targets into {folder / "survey"}, and the names of the planes into
   {folder / "config.yaml"} (assignment: planes).
3. cd {folder} && velocal run --cores 2
The report will be {folder / "results/report.html"}; docs/how-to.md explains every step."""
    )
