"""Where the time and the memory of a run went: a summary of what Snakemake measured of its jobs."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from velocal.io import markup, storage


@dataclass
class RuleTimes:
    """What the jobs of a rule took together.

    Attributes
    ----------
    rule : str
    jobs : int
    wall_s, cpu_s : float
        Sums over the jobs, in seconds. Snakemake looks at a job twice a second, and after a quarter
        of a minute twice a minute: processor time after the last look is missing.
    memory_mb : float
        Largest resident memory of a job.
    """

    rule: str
    jobs: int = 0
    wall_s: float = 0.0
    cpu_s: float = 0.0
    memory_mb: float = 0.0


def rule_times(folder: Path) -> list[RuleTimes]:
    """Add up what was measured, by rule.

    Parameters
    ----------
    folder : Path
        Contains a file ``RULE.tsv`` or files ``RULE/*.tsv`` as Snakemake writes them.

    Returns
    -------
    list of RuleTimes
        The longest first. A measurement that a job was too short for counts as zero.
    """
    found: dict[str, RuleTimes] = {}
    for path in sorted(folder.rglob("*.tsv")):
        rule = path.relative_to(folder).parts[0].removesuffix(".tsv")
        times = found.setdefault(rule, RuleTimes(rule))
        for row in csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")), delimiter="\t"):
            times.jobs += 1
            times.wall_s += _number(row, "s")
            times.cpu_s += _number(row, "cpu_time")
            times.memory_mb = max(times.memory_mb, _number(row, "max_rss"))
    return sorted(found.values(), key=lambda times: (-times.wall_s, times.rule))


def _number(row: Mapping[str, str | None], name: str) -> float:
    """Value of a column; zero where there is none, or a word in its place."""
    try:
        return float(row.get(name) or 0.0)
    except ValueError:
        return 0.0


def write_summary(folder: Path) -> None:
    """Write `rule_times` as ``summary.csv`` and ``summary.md`` into the folder, if it exists."""
    if not folder.is_dir():
        return
    times = rule_times(folder)
    total = RuleTimes(
        "all",
        sum(each.jobs for each in times),
        sum(each.wall_s for each in times),
        sum(each.cpu_s for each in times),
        max((each.memory_mb for each in times), default=0.0),
    )
    rows = [
        (each.rule, f"{each.jobs}", f"{each.wall_s:.1f}", f"{each.cpu_s:.1f}",
         f"{each.memory_mb:.0f}")
        for each in (*times, total)
    ]  # fmt: skip
    lines = ("rule,jobs,wall_s,cpu_s,memory_mb", *map(",".join, rows[:-1]))
    storage.write_text(folder / "summary.csv", "\n".join(lines) + "\n")
    head = ("rule", "jobs", "wall time (s)", "processor time seen (s)", "largest memory (MB)")
    table = markup.markdown_table(head, rows, (False, True, True, True, True))
    storage.write_text(folder / "summary.md", "\n".join(table) + "\n")
