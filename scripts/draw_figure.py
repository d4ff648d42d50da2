"""One figure with its numbers: statistics per laser, or the histogram of a laser."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.reporting.figures import lasers as figures


def main(
    *,
    data: list[Path],
    summary: Path,
    svg: Path,
    png: Path,
    csv: Path,
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
        numbers = figures.histogram(*figures.residuals_of(windows, selection))
        draw = figures.draw_histogram
    else:
        lasers, windows = (pd.DataFrame(storage.read_csv(p)) for p in (data[0], summary))
        numbers = figures.per_laser(lasers, windows, selection)
        draw = figures.draw_per_laser
    figure = draw(numbers, selection, sigma_cm=sigma_cm, simulated=simulated)
    figures.save(figure, svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
