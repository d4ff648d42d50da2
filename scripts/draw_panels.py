"""Standard deviation against distance of the outdoor samples of one kind and scanner."""

from pathlib import Path

import pandas as pd

from velocal.evaluation.candidates import IDENTITY
from velocal.io import storage
from velocal.io.scripts import for_each, run
from velocal.paper.outdoor import HEADING
from velocal.reporting.figures.panels import draw, top_cm
from velocal.reporting.figures.panels import numbers as numbers_of
from velocal.reporting.style import save


@for_each("svg", "png", "csv", "kind", "scanner", "sigma_cm")
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
    samples = pd.DataFrame(storage.read_csv(summary, text=(*HEADING, *IDENTITY)))
    numbers = numbers_of(samples, kind, scanner)
    figure = draw(
        numbers, kind, scanner, top_cm=top_cm(samples, sigma_cm),
        sigma_cm=sigma_cm, simulated=simulated,
    )  # fmt: skip
    save(figure, svg, png)
    storage.write_csv(csv, numbers)


if "snakemake" in globals():
    run(main, snakemake)
