"""Corrections of every laser with their 95 % intervals, and their numbers."""

from pathlib import Path

from velocal.calibration.files.formats import read_calibration, read_or_nominal
from velocal.io import storage
from velocal.io.scripts import for_each, run
from velocal.reporting.figures.corrections import (
    CorrectedSet,
    corrections,
    draw_corrections,
    weak_parameters,
)
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.study.figures import CorrectionsFigure


@for_each(
    "sets",
    "adjustments",
    "calibration",
    "svg",
    "png",
    "csv",
    "selection",
    "set_names",
    "adjusted_for",
)
def main(
    *,
    sets: list[Path],
    adjustments: list[Path],
    calibration: Path | None,
    svg: Path,
    png: Path,
    csv: Path,
    selection: CorrectionsFigure,
    set_names: list[str],
    adjusted_for: list[str],
    simulated: bool,
) -> None:
    """Write the figure as SVG and PNG and its numbers as CSV.

    `set_names` are those of `sets`, and `adjusted_for` names the set of every file of
    `adjustments`.
    """
    scanner = scanner_named(selection.scanner)
    weak: dict[str, list[list[tuple[str, ...]]]] = {name: [] for name in set_names}
    for name, path in zip(adjusted_for, adjustments, strict=True):
        weak[name].append(weak_parameters(storage.read_csv(path)["weakly_determined"]))
    found = []
    for name, path in zip(set_names, sets, strict=True):
        of_set = read_calibration(path, scanner.n_lasers)
        found.append(CorrectedSet(name, of_set.parameters, of_set.std, weak[name]))
    numbers = corrections(found, read_or_nominal(calibration, scanner))
    save(draw_corrections(numbers, selection, simulated=simulated), svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
