"""Compare methods of calibration where the truth is known, and write tables of docs/methods.md.

Usage: python benchmarks/calibration.py [--draws N] [--cases NAME ...] [--methods NAME ...]
           [--seed FIRST] [--processes 1] [--out FOLDER] [--write]

Rows of all draws are collected in FOLDER/draws.csv; a run replaces those of its cases, seeds and
methods. The tables of a run are made from all rows of that file. --write puts them into the page.
Seeds from 1001 on are those of the page: use others to develop a method.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from calibration_judge import RANGES_M, judged, study_trial
from calibration_methods import METHODS

from velocal.io.markup import inserted, markdown_table
from velocal.simulation.independent import Noise, Plan, SurveyErrors, Trial, UnitErrors, draw

PAGE = Path(__file__).parents[1] / "docs/methods.md"
FIRST_SEED = 1001
#: The method that people get, the one that is told the true spreads, and what nobody can do.
DEFAULT, ORACLE, TRUTH, FACTORY = "joint", "oracle", "truth", "factory"
#: A set counts as worse than the factory's if its s at unseen stations is larger by this factor.
HARM = 1.02
ALL = tuple(name for names in METHODS for name in names)
FEW = tuple(name for name in ALL if not name.startswith("paper"))


@dataclass(frozen=True)
class Case:
    """One study.

    Attributes
    ----------
    text : str
        For people.
    make : callable
        Trial of a seed.
    methods : tuple of str
        Methods that are run on it.
    """

    text: str
    make: Callable[[int], Trial]
    methods: tuple[str, ...] = ALL


def _independent(text: str, methods: tuple[str, ...] = ALL, **options: object) -> Case:
    return Case(text, partial(draw, Plan(**options)), methods)  # type: ignore[arg-type]


def _study(scanner: str, stations: int, seed: int) -> Trial:
    return study_trial(scanner, stations, seed - FIRST_SEED)


#: A survey whose poses are good to 0.02 deg.
ACCURATE = SurveyErrors(base_m=0.3, scanner_mm=0.1, site_mm=0.2, wall_targets=30, wall_mm=0.4)
WIDE = SurveyErrors(base_m=0.3)
_THINNED = {"scanner": "HDL-64E", "stations": 2, "every": 4, "windows": 1}


def _cases() -> dict[str, Case]:
    found = {}
    for scanner in ("HDL-64E", "HDL-32E", "VLP-16"):
        for n in (1, 2, 4):
            name, text = f"{scanner}-{n}", f"{scanner}, {n} station{'s' * (n > 1)}"
            found[name] = _independent(text, scanner=scanner, stations=n)
    for scanner in ("HDL-64E", "HDL-32E"):
        for n in (1, 2):
            found[f"{scanner}-{n}-wide"] = _independent(
                f"{scanner}, {n}, base of 0.3 m",
                FEW,
                scanner=scanner,
                stations=n,
                survey=WIDE,
                windows=1,
            )
            found[f"{scanner}-{n}-study"] = Case(
                f"study's world, {scanner}, {n}", partial(_study, scanner, n)
            )
    for tilt in (10.0, 20.0):
        found[f"tilt-{tilt:g}"] = _independent(
            f"HDL-64E, 2, tilt {tilt:g} deg", FEW, tilt_deg=tilt, **_THINNED
        )
    found["walls-1"] = _independent(
        "HDL-64E, 1, walls only", FEW, surfaces=("long", "short"), **_THINNED | {"stations": 1}
    )
    found["walls-2"] = _independent(
        "HDL-64E, 2, walls only", FEW, surfaces=("long", "short"), **_THINNED
    )
    found["board"] = _independent(
        "HDL-64E, 1, five surfaces", FEW,
        surfaces=("long", "short", "floor", "board", "far"), **_THINNED | {"stations": 1},
    )  # fmt: skip
    found["pattern"] = _independent(
        "pattern of 2 deg", FEW, noise=Noise(pattern_deg=2.0, pattern_gaussian=True), **_THINNED
    )
    for offset in (0.1, 0.3):
        found[f"common-{offset:g}"] = _independent(
            f"common offset {offset:g} deg, accurate survey", FEW, survey=ACCURATE,
            unit=UnitErrors(alpha_mean_deg=offset, v_mean_deg=offset), **_THINNED,
        )  # fmt: skip
    found["offsets"] = _independent(
        "hoff and voff off by 3 mm", FEW, unit=UnitErrors(hoff_mm=3.0, voff_mm=3.0), **_THINNED
    )
    found["offsets-accurate"] = _independent(
        "hoff and voff off by 3 mm, accurate survey", FEW, survey=ACCURATE,
        unit=UnitErrors(hoff_mm=3.0, voff_mm=3.0), **_THINNED,
    )  # fmt: skip
    found["surfaces"] = _independent(
        "surfaces shift lasers by 2-5 mm", FEW, noise=Noise(surface_mm=(2.0, 5.0)), **_THINNED
    )
    found["near"] = _independent(
        "error of 1.5 cm below 2 m", FEW, noise=Noise(near_cm=1.5), **_THINNED
    )
    for angle in (0.015, 0.05, 0.2):
        found[f"angles-{angle:g}"] = _independent(
            f"angle errors {angle:g} deg", FEW,
            unit=UnitErrors(alpha_deg=angle, v_deg=angle), **_THINNED,
        )  # fmt: skip
    for n in (1, 2, 4):
        found[f"two-point-{n}"] = _independent(
            f"two-point file, {n}", FEW, unit=UnitErrors(two_point_cm=2.0),
            **_THINNED | {"stations": n},
        )  # fmt: skip
    return found


CASES = _cases()


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


def summarised(draws: pd.DataFrame) -> pd.DataFrame:
    """Median, mean, worst and share of harm of every case and method."""
    values = [c for c in draws.columns if c not in ("case", "seed", "method")]
    grouped = draws.groupby(["case", "method"], sort=False)
    parts = {
        "median": grouped[values].median(),
        "worst": grouped[values].max(),
        "mean": grouped[values].mean(),
        "rms": grouped[values].agg(lambda column: np.sqrt(np.mean(np.square(column)))),
    }
    table = pd.concat(parts, axis=1)
    table.columns = [f"{value}_{part}" for part, value in table.columns]
    before = draws[draws["method"] == FACTORY].set_index(["case", "seed"])["unseen_cm"]
    matched = before.reindex(pd.MultiIndex.from_frame(draws[["case", "seed"]])).to_numpy()
    harm = (draws["unseen_cm"] > HARM * matched).groupby([draws["case"], draws["method"]])
    table["harm"] = harm.mean().reindex(table.index)
    table["draws"] = grouped.size()
    order = {name: number for number, name in enumerate(ALL)}
    table = table.reset_index()
    table["place"] = [list(CASES).index(case) for case in table["case"]]
    table["rank"] = [order[method] for method in table["method"]]
    return table.sort_values(["place", "rank"]).drop(columns=["place", "rank"])


def _cell(row: pd.Series, value: str, digits: int) -> str:
    median, worst = row[f"{value}_median"], row[f"{value}_worst"]
    return "" if np.isnan(median) else f"{median:.{digits}f} [{worst:.{digits}f}]"


def main_table(summary: pd.DataFrame, cases: Sequence[str]) -> str:
    """Median [worst] over the draws of the errors and of s at unseen stations."""
    headings = [
        "study", "method", "dl cm", "alpha deg", "v deg", "worst laser cm", "unseen cm",
        "centred cm", "induced cm", "cover dl / alpha / v %", "worse than factory %",
    ]  # fmt: skip
    rows = []
    for case in cases:
        for number, (_, row) in enumerate(summary[summary["case"] == case].iterrows()):
            cover = [row[f"cover_{name}_mean"] for name in ("dl", "alpha", "v")]
            known = [f"{100 * each:.0f}" if np.isfinite(each) else "-" for each in cover]
            rows.append(
                [
                    CASES[case].text if not number else "",
                    row["method"],
                    _cell(row, "dl_cm", 2),
                    _cell(row, "alpha_deg", 3),
                    _cell(row, "v_deg", 3),
                    _cell(row, "worst_dl_cm", 1),
                    _cell(row, "unseen_cm", 2),
                    _cell(row, "centred_cm", 2),
                    _cell(row, "induced_cm", 2),
                    " / ".join(known) if any(each != "-" for each in known) else "",
                    f"{100 * row['harm']:.0f}",
                ]
            )
    return "\n".join(markdown_table(headings, rows, [False, False] + [True] * 9))


def range_table(summary: pd.DataFrame, cases: Sequence[str]) -> str:
    """Root mean square error of points at ranges, mean over the draws: in all, and along."""
    headings = ["study", "method", *(f"{range_m:g} m" for range_m in RANGES_M)]
    rows = []
    for case in cases:
        for number, (_, row) in enumerate(summary[summary["case"] == case].iterrows()):
            cells = [
                f"{row[f'point_{r:g}_cm_rms']:.2f} / {row[f'along_{r:g}_cm_rms']:.2f}"
                for r in RANGES_M
            ]
            rows.append([CASES[case].text if not number else "", row["method"], *cells])
    return "\n".join(markdown_table(headings, rows, [False, False] + [True] * len(RANGES_M)))


def main(arguments: Sequence[str]) -> None:
    """Run, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--cases", nargs="*", choices=CASES, default=list(CASES))
    parser.add_argument("--methods", nargs="*", choices=ALL, default=ALL)
    parser.add_argument("--processes", type=int, choices=(1, 2), default=1)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/calibration"))
    parser.add_argument("--write", action="store_true", help="put the tables into the page")
    chosen = parser.parse_args(arguments)
    chosen.out.mkdir(parents=True, exist_ok=True)
    file = chosen.out / "draws.csv"
    tasks = [
        (case, chosen.seed + number, tuple(chosen.methods))
        for case in chosen.cases
        for number in range(chosen.draws)
    ]
    collect(tasks, chosen.processes, file)
    draws = pd.read_csv(file)
    summary = summarised(draws)
    summary.to_csv(chosen.out / "summary.csv", index=False, float_format="%.6g")
    cases = list(dict.fromkeys(summary["case"]))
    tables = {"bench_all": main_table(summary, cases), "bench_ranges": range_table(summary, cases)}
    for name, table in tables.items():
        (chosen.out / f"{name}.md").write_text(table + "\n", encoding="utf-8")
        if name == "bench_all":
            print(table)
    if chosen.write:
        text = PAGE.read_text(encoding="utf-8")
        for name, table in tables.items():
            text = inserted(text, name, table)
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
