"""One figure of statistics per laser with its numbers."""

from functools import cache
from pathlib import Path

import pandas as pd

from velocal.evaluation.statistics import KEYS
from velocal.io import storage
from velocal.io.scripts import for_each, run
from velocal.reporting.figures.per_laser import draw_per_laser, per_laser
from velocal.reporting.style import save
from velocal.study.figures import LaserFigure


@cache
def _table(path: Path) -> pd.DataFrame:
    """Table of statistics, which all figures of a job show."""
    return pd.DataFrame(storage.read_csv(path, text=KEYS))


@for_each("svg", "png", "csv", "selection", "sigma_cm")
def main(
    *,
    lasers: Path,
    summary: Path,
    svg: Path,
    png: Path,
    csv: Path,
    selection: LaserFigure,
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the figure as SVG and PNG and its numbers as CSV."""
    numbers = per_laser(_table(lasers), _table(summary), selection)
    figure = draw_per_laser(numbers, selection, sigma_cm=sigma_cm, simulated=simulated)
    save(figure, svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
