"""Plan of the test field with the medians measured from each position, and its numbers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal.calibration.files.formats import read_or_nominal
from velocal.errors import reported
from velocal.io import schemas, storage
from velocal.reduction.assignment import Limits
from velocal.reporting.figures.plan import View, draw_plan, plan
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.survey.station import read_station
from velocal.survey.targets import read_targets


def main(
    medians: list[Path],
    surveys: list[Path],
    targets: Path,
    calibration: Path | None,
    svg: Path,
    png: Path,
    csv: Path,
    *,
    selection: Mapping[str, Any],
    gates: Mapping[str, float],
    simulated: bool,
) -> None:
    """Write the plan as SVG and PNG and its numbers as CSV; one panel per sample."""
    scanner = scanner_named(selection["scanner"])
    parameters = read_or_nominal(calibration, scanner)
    surveyed, limits = read_targets(targets, "plane"), Limits.from_config(gates)
    panels = []
    for sample, path, survey in zip(selection["samples"], medians, surveys, strict=True):
        columns, facts = storage.read_table(path, schemas.MEDIANS)
        at, rate = read_station(survey), facts["rotation_rate_hz"]
        view = View(at.position, sample, scanner, rate, columns, parameters, at.patches, at.pose)
        panels.append(plan(view, surveyed, limits))
    numbers = pd.concat(panels, ignore_index=True)
    save(draw_plan(numbers, selection, simulated=simulated), svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            [Path(path) for path in snakemake.input.medians],
            [Path(path) for path in snakemake.input.surveys],
            Path(snakemake.input.targets),
            Path(c) if (c := snakemake.input.calibration) else None,
            *(Path(snakemake.output[suffix]) for suffix in ("svg", "png", "csv")),
            selection=snakemake.params.figure,
            gates=snakemake.params.gates,
            simulated=snakemake.params.simulated,
        )
