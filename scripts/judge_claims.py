"""Judge the claims of the paper that its tables do not answer."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from velocal.evaluation.candidates import IDENTITY
from velocal.evaluation.statistics import KEYS
from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper.claims import lasers as of_lasers
from velocal.paper.claims import light as of_light
from velocal.paper.claims import offsets as of_offsets
from velocal.paper.claims import outdoor, verdict, windows
from velocal.paper.outdoor import HEADING
from velocal.study.figures import Table


def _frame(path: Path) -> pd.DataFrame:
    text = (*KEYS, *HEADING, *IDENTITY, "shown", "position", "without", "with")
    return pd.DataFrame(storage.read_csv(path, text=text))


def main(
    *,
    light: Path,
    offsets: Path,
    lasers: Path,
    summary: Path,
    outdoor_samples: Path,
    outdoor_means: Path,
    drift: Path,
    claims: Path,
    claims_md: Path,
    tables: Mapping[str, Table],
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the table of claims as CSV and Markdown."""
    statistics, rows, moved = _frame(lasers), _frame(summary), _frame(drift)
    judged = verdict.table(
        [
            of_light.judge(_frame(light), moved),
            *windows.judge(moved, rows),
            *of_offsets.judge(_frame(offsets), sigma_cm),
            of_lasers.judge_count(statistics, rows, tables["4"]),
            of_lasers.judge_better(statistics, rows, tables),
            *outdoor.judge_reductions(_frame(outdoor_means)),
            outdoor.judge_25_m(_frame(outdoor_samples)),
        ]
    )
    storage.write_csv(claims, judged)
    storage.write_text(claims_md, verdict.markdown(judged, simulated=simulated))


if "snakemake" in globals():
    run(main, snakemake)
