"""Put the outdoor samples together: one row each, means, and std against distance."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from velocal.evaluation import panels as outdoor
from velocal.io import storage
from velocal.io.scripts import run
from velocal.reporting.figures import panels as outdoor_figure
from velocal.reporting.figures.lasers import save


def main(
    *,
    panels: list[Path],
    summary: Path,
    means: Path,
    facts: Path,
    figures: list[Path],
    selections: Mapping[str, Sequence[str]],
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the tables as CSV, and every figure as SVG and PNG with its numbers as CSV."""
    every = pd.concat([pd.read_csv(path) for path in panels], ignore_index=True)
    rows = [{str(key): value for key, value in row.items()} for row in every.to_dict("records")]
    each, of_kinds = outdoor.summarise(rows)
    samples = pd.DataFrame(each)
    storage.write_csv(summary, samples)
    storage.write_csv(means, pd.DataFrame(of_kinds))
    storage.write_csv(facts, pd.DataFrame(outdoor.facts(of_kinds)))
    paths = {path.name: path for path in figures}
    for number, (kind, scanner) in selections.items():
        numbers = outdoor_figure.numbers(samples, kind, scanner)
        figure = outdoor_figure.draw(
            numbers, kind, scanner, top_cm=outdoor_figure.top_cm(samples, sigma_cm),
            sigma_cm=sigma_cm, simulated=simulated,
        )  # fmt: skip
        save(figure, paths[f"figure_{number}.svg"], paths[f"figure_{number}.png"])
        storage.write_csv(paths[f"figure_{number}.csv"], numbers)


if "snakemake" in globals():
    run(main, snakemake)
