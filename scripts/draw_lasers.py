"""One figure of statistics per laser with its numbers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal.io import storage
from velocal.io.scripts import run
from velocal.reporting.figures import lasers as figures


def main(
    *,
    lasers: Path,
    summary: Path,
    svg: Path,
    png: Path,
    csv: Path,
    selection: Mapping[str, Any],
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the figure as SVG and PNG and its numbers as CSV."""
    of_lasers, of_windows = (pd.DataFrame(storage.read_csv(path)) for path in (lasers, summary))
    numbers = figures.per_laser(of_lasers, of_windows, selection)
    figure = figures.draw_per_laser(numbers, selection, sigma_cm=sigma_cm, simulated=simulated)
    figures.save(figure, svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
