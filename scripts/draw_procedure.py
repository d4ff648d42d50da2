"""Which recording is calibrated on and which is validated on."""

from collections.abc import Mapping
from pathlib import Path

from velocal.io import storage
from velocal.io.scripts import for_each, run
from velocal.reporting.figures.flow import UsedSample, draw_procedure, procedure_table
from velocal.reporting.style import save
from velocal.study.figures import Table


@for_each("svg", "png", "csv")
def main(
    *,
    svg: Path,
    png: Path,
    csv: Path,
    samples: list[str],
    scanners: list[str],
    positions: list[str],
    parameter_sets: Mapping[str, Mapping[str, list[str]]],
    tables: Mapping[str, Table],
    simulated: bool,
) -> None:
    """Write the drawing as SVG and PNG and what is drawn as CSV.

    `scanners` and `positions` are those of `samples`.
    """
    used = [UsedSample(*each) for each in zip(samples, scanners, positions, strict=True)]
    numbers = procedure_table(used, parameter_sets, tables)
    save(draw_procedure(numbers, simulated=simulated), svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
