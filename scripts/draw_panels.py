"""Standard deviation against distance of the outdoor samples of one kind and scanner."""

from pathlib import Path

import pandas as pd

from velocal.io import storage
from velocal.io.scripts import run
from velocal.reporting.figures import panels as outdoor_figure
from velocal.reporting.figures.lasers import save


def main(
    *,
    summary: Path,
    svg: Path,
    png: Path,
    csv: Path,
    kind: str,
    scanner: str,
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the figure as SVG and PNG and its numbers as CSV; all figures have one scale."""
    samples = pd.DataFrame(storage.read_csv(summary))
    numbers = outdoor_figure.numbers(samples, kind, scanner)
    figure = outdoor_figure.draw(
        numbers, kind, scanner, top_cm=outdoor_figure.top_cm(samples, sigma_cm),
        sigma_cm=sigma_cm, simulated=simulated,
    )  # fmt: skip
    save(figure, svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
