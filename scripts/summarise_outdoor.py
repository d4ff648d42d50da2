"""Put the outdoor samples together: one row each, means, and std against distance."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from velocal.errors import reported
from velocal.evaluation.candidates import IDENTITY
from velocal.io import storage
from velocal.paper.outdoor import HEADING, summarise
from velocal.paper.outdoor import facts as single_numbers
from velocal.reporting.figures.panels import draw, top_cm
from velocal.reporting.figures.panels import numbers as numbers_of
from velocal.reporting.style import save


def main(
    panels: list[Path],
    summary: Path,
    means: Path,
    facts: Path,
    figures: list[Path],
    *,
    selections: Mapping[str, Sequence[str]],
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the tables as CSV, and every figure as SVG and PNG with its numbers as CSV."""
    text = (*HEADING, *IDENTITY, "panel")
    tables = [pd.DataFrame(storage.read_csv(path, text=text)) for path in panels]
    samples, of_kinds = summarise(pd.concat(tables, ignore_index=True))
    storage.write_csv(summary, samples)
    storage.write_csv(means, of_kinds)
    storage.write_csv(facts, pd.DataFrame(single_numbers(of_kinds)))
    paths = {path.name: path for path in figures}
    for number, (kind, scanner) in selections.items():
        numbers = numbers_of(samples, kind, scanner)
        figure = draw(
            numbers, kind, scanner, top_cm=top_cm(samples, sigma_cm),
            sigma_cm=sigma_cm, simulated=simulated,
        )  # fmt: skip
        save(figure, paths[f"figure_{number}.svg"], paths[f"figure_{number}.png"])
        storage.write_csv(paths[f"figure_{number}.csv"], numbers)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            [Path(path) for path in snakemake.input.panels],
            Path(snakemake.output.summary),
            Path(snakemake.output.means),
            Path(snakemake.output.facts),
            [Path(path) for path in snakemake.output.figures],
            selections=snakemake.params.figures,
            sigma_cm=snakemake.params.sigma_cm,
            simulated=snakemake.params.simulated,
        )
