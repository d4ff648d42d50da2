"""Plan of the test field with the medians measured from each position, and its numbers."""

from pathlib import Path

import pandas as pd

from velocal.calibration.files.formats import read_or_nominal
from velocal.io import schemas, storage
from velocal.io.scripts import for_each, run
from velocal.reporting.figures.plan import draw_plan, plan
from velocal.reporting.style import save
from velocal.scanner.beam import Beams
from velocal.scanner.models import scanner_named
from velocal.study.figures import PlanFigure
from velocal.study.reduction import AssignmentLimits
from velocal.survey.station import read_station
from velocal.survey.targets import read_targets


@for_each("medians", "surveys", "calibration", "svg", "png", "csv", "samples", "selection")
def main(
    *,
    medians: list[Path],
    surveys: list[Path],
    targets: Path,
    calibration: Path | None,
    svg: Path,
    png: Path,
    csv: Path,
    samples: list[str],
    selection: PlanFigure,
    limits: AssignmentLimits,
    simulated: bool,
) -> None:
    """Write the plan as SVG and PNG and its numbers as CSV; one panel per sample.

    `samples` are those of every file of medians and of every survey.
    """
    scanner = scanner_named(selection.scanner)
    parameters = read_or_nominal(calibration, scanner)
    surveyed = read_targets(targets, "plane")
    panels = []
    for sample, path, survey in zip(samples, medians, surveys, strict=True):
        columns, facts = storage.read_table(path, schemas.MEDIANS)
        beams = Beams.from_ticks(columns, scanner, facts["rotation_rate_hz"])
        station = read_station(survey)
        panels.append(plan(sample, station, beams, parameters, surveyed, limits.metric()))
    numbers = pd.concat(panels, ignore_index=True)
    save(draw_plan(numbers, selection, simulated=simulated), svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
