"""Put the outdoor samples together: one row each, and means per kind of sample."""

from pathlib import Path

import pandas as pd

from velocal.evaluation import panels as outdoor
from velocal.io import storage
from velocal.io.scripts import run


def main(*, panels: list[Path], summary: Path, means: Path, facts: Path) -> None:
    """Write the tables as CSV."""
    every = pd.concat([pd.read_csv(path) for path in panels], ignore_index=True)
    rows = [{str(key): value for key, value in row.items()} for row in every.to_dict("records")]
    each, of_kinds = outdoor.summarise(rows)
    storage.write_csv(summary, pd.DataFrame(each))
    storage.write_csv(means, pd.DataFrame(of_kinds))
    storage.write_csv(facts, pd.DataFrame(outdoor.facts(of_kinds)))


if "snakemake" in globals():
    run(main, snakemake)
