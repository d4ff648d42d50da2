"""One figure with its numbers: statistics per laser, or the histogram of a laser."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal.errors import reported
from velocal.evaluation.statistics import KEYS
from velocal.io import schemas, storage
from velocal.reporting.figures.histogram import draw_histogram, histogram, residuals_of
from velocal.reporting.figures.per_laser import draw_per_laser, per_laser
from velocal.reporting.style import save


def main(
    data: list[Path],
    summary: Path,
    svg: Path,
    png: Path,
    csv: Path,
    *,
    selection: Mapping[str, Any],
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the figure as SVG and PNG and its numbers as CSV.

    The data are files of residuals for a histogram, otherwise the statistics of all lasers.
    """
    if selection["kind"] == "histogram":
        names = ["laser_id", "before_m", "after_m"]
        windows = [storage.read_table(path, schemas.RESIDUALS, names)[0] for path in data]
        numbers = histogram(*residuals_of(windows, selection))
        draw = draw_histogram
    else:
        lasers, every = (pd.DataFrame(storage.read_csv(p, text=KEYS)) for p in (data[0], summary))
        numbers = per_laser(lasers, every, selection)
        draw = draw_per_laser
    figure = draw(numbers, selection, sigma_cm=sigma_cm, simulated=simulated)
    save(figure, svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            [Path(path) for path in snakemake.input.data],
            Path(snakemake.input.summary),
            Path(snakemake.output.svg),
            Path(snakemake.output.png),
            Path(snakemake.output.csv),
            selection=snakemake.params.figure,
            sigma_cm=snakemake.params.sigma_cm,
            simulated=snakemake.params.simulated,
        )
