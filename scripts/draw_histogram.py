"""Histogram of the residuals of one laser with its numbers."""

from pathlib import Path

from velocal.io import schemas, storage
from velocal.io.scripts import for_each, run
from velocal.reporting.figures.histogram import draw_histogram, histogram, residuals_of
from velocal.reporting.style import save
from velocal.study.figures import HistogramFigure


@for_each("residuals", "svg", "png", "csv", "selection", "sigma_cm")
def main(
    *,
    residuals: list[Path],
    svg: Path,
    png: Path,
    csv: Path,
    selection: HistogramFigure,
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the figure as SVG and PNG and its numbers as CSV; the windows are taken together."""
    names = ["laser_id", "before_m", "after_m"]
    windows = [storage.read_table(path, schemas.RESIDUALS, names)[0] for path in residuals]
    numbers = histogram(*residuals_of(windows, selection))
    figure = draw_histogram(numbers, selection, sigma_cm=sigma_cm, simulated=simulated)
    save(figure, svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
