"""Fail if a number of the paper that was reproduced within its tolerance no longer is."""

from pathlib import Path

import pandas as pd

from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper.agreement import check
from velocal.paper.printed import known_misses


def main(
    *, agreement: Path, known: Path, report: Path, misses: Path, rotations: int | None
) -> None:
    """Write the items that are missed, with the known reason of each, as CSV.

    The report is not read. It has to exist already: it shows what is wrong if this check fails.
    """
    judged = pd.DataFrame(storage.read_csv(agreement, text=("item", "within")))
    storage.write_csv(misses, check(judged, known_misses(known, rotations)))


if "snakemake" in globals():
    run(main, snakemake)
