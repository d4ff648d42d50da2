"""The whole study: jobs, processor time and where it goes, and what a large study would take."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from speed_measure import ROOT, children, table

sys.path.insert(0, str(ROOT / "tests"))

from support.running import copy_project, environment

#: Settings besides those of the study, and the folder of its results, by what is run.
RUNS = {
    "recordings of 33 s": ((), "results"),
    "recordings of five minutes": (("config/five_minutes.yaml",), "results-paper"),
}
#: Samples of the study, and of the large one that is planned from it.
SAMPLES, LARGE = 6, 300
#: Rules that are told apart.
SHOWN = 6


@dataclass(frozen=True)
class Ran:
    """What a run of the whole study took.

    Attributes
    ----------
    clock_s, processor_s : float
        On the clock, and of all processes.
    rules : DataFrame
        Jobs and processor time by rule, the longest first, as the study writes them.
    megabytes : float
        Size of all files that it left.
    """

    clock_s: float
    processor_s: float
    rules: pd.DataFrame
    megabytes: float


def run(folder: Path, what: str, cores: int) -> Ran:
    """Run the study in a copy of the project."""
    place = copy_project(folder / "project")
    settings, results = RUNS[what]
    files = ["--configfile", "config/config.yaml", *settings] if settings else []
    command = [sys.executable, "-m", "velocal", "run", "--cores", str(cores), *files]
    start, before = time.monotonic(), children()
    done = subprocess.run(
        command, cwd=place, env=environment(place), capture_output=True, text=True
    )
    if done.returncode:
        sys.exit(done.stderr[-4000:])
    clock_s, processor_s = time.monotonic() - start, children() - before
    files_left = [each for each in (place / results).rglob("*") if each.is_file()]
    return Ran(
        clock_s,
        processor_s,
        pd.read_csv(place / results / "benchmarks/summary.csv"),
        sum(each.stat().st_size for each in files_left) / 1e6,
    )


def workflow(folder: Path, what: str, cores: int = 2) -> str:
    """Table of one run, and what a study of many samples would take."""
    ran = run(folder, what, cores)
    jobs, rules = int(ran.rules["jobs"].sum()), ran.rules
    in_jobs = float(rules["cpu_s"].sum())
    rows = [
        [what, str(jobs), f"{ran.clock_s:.0f}", f"{ran.processor_s:.0f}",
         f"{100.0 * (1.0 - in_jobs / ran.processor_s):.0f} %",
         f"{rules['memory_mb'].max():.0f}", f"{ran.megabytes:.0f}"],
    ]  # fmt: skip
    headings = [
        "study", "jobs", "s on the clock", "s of processor", "outside the jobs",
        "MB of the largest job", "MB of files",
    ]  # fmt: skip
    longest = ", ".join(
        f"`{row.rule}` {row.cpu_s:.0f} s" for row in rules.head(SHOWN).itertuples(index=False)
    )
    own = rules[rules["jobs"] == SAMPLES]
    each = float(own["cpu_s"].sum()) / SAMPLES
    # Every sample at a position of its own, and all jobs that read all samples in proportion.
    rest = (in_jobs - float(own["cpu_s"].sum())) / SAMPLES
    return "\n\n".join(
        [
            table(headings, rows),
            f"Most processor time: {longest}.",
            f"A job of one sample takes {each / len(own):.1f} s on average, its {len(own)} jobs "
            f"{each:.1f} s together: {LARGE * each / 60:.0f} minutes of processor time for {LARGE} "
            f"samples. All other jobs would take {LARGE * rest / 60:.0f} minutes if "
            "they grew in proportion, but pictures, tables and simulated scenes do not.",
        ]
    )
