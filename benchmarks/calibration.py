"""Compare methods of calibration where the truth is known, and write tables of docs/methods.md.

Usage: python benchmarks/calibration.py [--draws N] [--cases NAME ...] [--methods NAME ...]
           [--seed FIRST] [--processes 1] [--out FOLDER] [--resume] [--cost] [--harm] [--write]

Rows of all draws are collected in FOLDER/draws.csv; a run replaces those of its cases, seeds and
methods. With --resume it leaves out the draws that are complete there, so that a run that was
stopped can be continued; --draws 0 makes the tables of what there is. The tables are made from all
draws of that file on which all methods of their case were run, and one from the other draws: those
with `--methods factory joint oracle truth` show what is chance. --write puts them into the page.
Seeds from 1001 on are those of the page: use others to develop a method.
"""

from __future__ import annotations

import argparse
import multiprocessing
import pickle
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
from calibration_cases import ALL, CASES, FIRST_SEED
from calibration_judge import judged
from calibration_methods import METHODS, unit_settings, unit_stations
from calibration_tables import DEFAULT, FACTORY, HARM, against, complete, summarised, tables

from velocal.adjustment.unit.adjust import adjust_unit
from velocal.adjustment.unit.station import UnitStation
from velocal.evaluation.holdout import HoldOut, hold_out
from velocal.io.markup import inserted
from velocal.scanner.parameters import LaserParameters
from velocal.simulation.independent.plan import Plan
from velocal.simulation.independent.trial import draw

PAGE = Path(__file__).parents[1] / "docs/methods.md"


def rows_of(task: tuple[str, int, Sequence[str]]) -> list[dict[str, object]]:
    """Run methods on one draw of a case."""
    name, seed, wanted = task
    case = CASES[name]
    trial = case.make(seed)
    rows = []
    for names, method in METHODS.items():
        chosen = [each for each in names if each in wanted and each in case.methods]
        if not chosen:
            continue
        start = time.process_time()
        found = method(trial)
        seconds = time.process_time() - start
        every = found if isinstance(found, tuple) else (found,)
        for each, result in zip(names, every, strict=True):
            if each in chosen:
                heading = {"case": name, "seed": seed, "method": each, "seconds": seconds}
                rows.append(heading | judged(trial, result))
    return rows


def collect(tasks: Sequence[tuple[str, int, Sequence[str]]], processes: int, file: Path) -> None:
    """Run all tasks, and put their rows into the table of draws."""
    started = time.monotonic()
    pool = multiprocessing.Pool(processes) if processes > 1 else None
    results = pool.imap(rows_of, tasks) if pool else map(rows_of, tasks)
    for number, (task, rows) in enumerate(zip(tasks, results, strict=True), start=1):
        new = pd.DataFrame(rows)
        if file.exists() and len(new):
            key = ["case", "seed", "method"]
            new = pd.concat([pd.read_csv(file), new]).drop_duplicates(key, keep="last")
        if len(new):
            new.to_csv(file, index=False, float_format="%.6g")
        passed = time.monotonic() - started
        print(f"{number} of {len(tasks)}, {passed:.0f} s: {task[0]}, seed {task[1]}", flush=True)
    if pool:
        pool.close()


def left(
    tasks: Sequence[tuple[str, int, Sequence[str]]], file: Path
) -> list[tuple[str, int, Sequence[str]]]:
    """Tasks of which the table of draws lacks a method."""
    if not file.exists():
        return list(tasks)
    known = pd.read_csv(file, usecols=["case", "seed", "method"])
    done = set(known.itertuples(index=False, name=None))
    return [
        (case, seed, methods)
        for case, seed, methods in tasks
        if any((case, seed, m) not in done for m in methods if m in CASES[case].methods)
    ]


def _adjusted_alone(file: str) -> dict[str, float]:
    """Adjust a unit in a process that does nothing else: CPU time, and peak memory of all of it."""
    stations, factory, settings = pickle.loads(Path(file).read_bytes())
    medians = sum(len(station.observations.phi) for station in stations)
    start = time.process_time()
    adjust_unit(stations, factory, settings)
    seconds = time.process_time() - start
    # `resource.getrusage` would count the process that started this one too.
    status = Path("/proc/self/status").read_text(encoding="ascii")
    peak = int(status.split("VmHWM:")[1].split()[0]) / 1024.0
    return {"medians": medians, "seconds": seconds, "peak_mb": peak}


def cost(file: Path) -> None:
    """Measure the adjustment of a unit with 1, 2 and 4 stations of three windows each."""
    rows = []
    for scanner in ("HDL-64E", "HDL-32E"):
        for stations in (1, 2, 4):
            trial = draw(Plan(scanner=scanner, stations=stations), 1)
            with TemporaryDirectory() as folder:
                data = Path(folder) / "unit"
                given = unit_stations(trial), trial.factory, unit_settings(trial)
                data.write_bytes(pickle.dumps(given))
                with multiprocessing.get_context("spawn").Pool(1) as pool:
                    found = pool.apply(_adjusted_alone, (str(data),))
            rows.append({"scanner": scanner, "stations": stations, "windows": 3 * stations} | found)
            print(rows[-1], flush=True)
    pd.DataFrame(rows).to_csv(file, index=False, float_format="%.6g")


def held_out(case: str, seed: int) -> HoldOut:
    """Leave out every station of a draw in turn, as is done before an export."""
    trial = CASES[case].make(seed)
    settings = unit_settings(trial)

    def adjusted(kept: Sequence[UnitStation]) -> LaserParameters:
        return adjust_unit(kept, trial.factory, settings).calibration.adjusted

    return hold_out(unit_stations(trial), trial.factory, adjusted)


def harm(draws: pd.DataFrame, file: Path) -> None:
    """Ask the hold-out about the draws where the default is worse."""
    ratio, rows = against(draws, FACTORY), []
    worse = draws[(draws["method"] == DEFAULT) & (ratio > HARM)]
    for place, case, seed in worse[["case", "seed"]].itertuples(name=None):
        found = held_out(case, seed)
        total = found.total
        held = total.after_m / total.before_m if total else float("nan")
        heading = {"case": case, "seed": seed, "ratio": ratio[place]}
        rows.append(heading | {"held": held, "verdict": found.verdict})
        print(rows[-1], flush=True)
    columns = ["case", "seed", "ratio", "held", "verdict"]
    pd.DataFrame(rows, columns=columns).to_csv(file, index=False, float_format="%.6g")


def main(arguments: Sequence[str]) -> None:
    """Run, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--cases", nargs="*", choices=CASES, default=list(CASES))
    parser.add_argument("--methods", nargs="*", choices=ALL, default=ALL)
    parser.add_argument("--processes", type=int, choices=(1, 2), default=1)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/calibration"))
    parser.add_argument("--resume", action="store_true", help="leave out what is done already")
    parser.add_argument("--cost", action="store_true", help="measure time and memory, nothing else")
    parser.add_argument(
        "--harm", action="store_true", help="leave out stations in the draws that are worse"
    )
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    chosen = parser.parse_args(arguments)
    chosen.out.mkdir(parents=True, exist_ok=True)
    file, costs, held = (chosen.out / f"{name}.csv" for name in ("draws", "cost", "harm"))
    if chosen.cost:
        cost(costs)
    elif chosen.harm:
        harm(pd.read_csv(file), held)
    else:
        tasks = [
            (case, chosen.seed + number, tuple(chosen.methods))
            for case in chosen.cases
            for number in range(chosen.draws)
        ]
        collect(left(tasks, file) if chosen.resume else tasks, chosen.processes, file)
    draws = pd.read_csv(file)
    summarised(complete(draws)).to_csv(chosen.out / "summary.csv", index=False, float_format="%.6g")
    found = tables(draws, *(pd.read_csv(one) if one.exists() else None for one in (costs, held)))
    for name, table in found.items():
        (chosen.out / f"{name}.md").write_text(table + "\n", encoding="utf-8")
    for name in ("bench_issue", "bench_study", "bench_other", "bench_checks"):
        print(found[name], end="\n\n")
    if chosen.write:
        text = PAGE.read_text(encoding="utf-8")
        for name, table in found.items():
            text = inserted(text, name, table)
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
