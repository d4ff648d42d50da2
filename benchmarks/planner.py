"""Planner against adjustment: planned standard deviations over those that the adjustment states.

Usage: python benchmarks/planner.py [--draws N] [--seed S] [--cases NAME ...] [--study DIR]
       [--write]

Units, rooms and surveys are those of the independent world (`velocal.simulation.independent`). The
planner is given the surveyed stations and nothing of what was measured there, except for the sizes
of noise and spreads that the adjustment found ("found"), or not even these ("typical").
`--study` adds the calibrations of a study that has been run, from its folder.
`--write` writes the table into docs/planner.md.
"""

import argparse
from collections.abc import Sequence
from contextlib import chdir
from dataclasses import replace
from pathlib import Path

import numpy as np

from velocal.adjustment.unit.adjust import adjust_unit
from velocal.adjustment.unit.predict import UnitSizes
from velocal.adjustment.unit.result import NAMES, UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.arrays import Array, joined_rows
from velocal.evaluation.holdout import JudgedCalibration
from velocal.evaluation.plan_task import configuration_in, of_study
from velocal.evaluation.planner import Instrument, Setup, plan_unit, typical_sizes
from velocal.io.markup import inserted, markdown_table
from velocal.io.plain import from_plain
from velocal.io.storage import read_json
from velocal.reduction.assignment import Limits
from velocal.scanner.models import SCANNERS
from velocal.simulation.independent.plan import Plan
from velocal.simulation.independent.trial import draw
from velocal.study.reading import read_yaml
from velocal.study.sketch import Candidates
from velocal.study.study import read_study

DOC = Path(__file__).parents[1] / "docs/planner.md"
#: The seeds of the page begin here; others are for development.
FIRST_SEED = 7001
CASES = {
    f"{scanner}, {stations} station{'s' if stations > 1 else ''}": Plan(
        scanner=scanner, stations=stations, every=every
    )
    for scanner, every in (("VLP-16", 1), ("HDL-32E", 2), ("HDL-64E", 2))
    for stations in (1, 2)
}
#: Limits that choose the beams which the independent world takes for the observations: 0.12 m
#: inside the edge of a surface, whose targets lie 0.05 m inside.
LIMITS = Limits(edge_m=0.07, incidence_rad=float(np.deg2rad(79.0)))
KINDS = ("found", "typical")


def std_of(unit: UnitCalibration) -> Array:
    """Standard deviations of dl, alpha and v, shape (lasers, 3)."""
    return np.sqrt(np.diagonal(unit.calibration.covariance, axis1=1, axis2=2))


def ratios(
    unit: UnitCalibration, setups: Sequence[Setup], instrument: Instrument
) -> dict[str, Array]:
    """Planned over stated standard deviations of the observed lasers, by what was known."""
    seen = unit.calibration.observed
    found = {}
    for kind, sizes in (("found", UnitSizes.of(unit)), ("typical", instrument.sizes)):
        plan = plan_unit(setups, replace(instrument, sizes=sizes))
        found[kind] = plan.std[seen] / std_of(unit)[seen]
    return found


def of_trial(plan: Plan, seed: int) -> dict[str, Array]:
    """Ratios of one draw of the independent world."""
    trial = draw(plan, seed)
    scanner = SCANNERS[trial.scanner]
    settings = UnitSettings.recommended(scanner, factory=trial.factory)
    measured = [each.survey.of_unit(joined_rows(each.windows)) for each in trial.stations]
    instrument = Instrument(
        scanner=scanner,
        factory=trial.factory,
        settings=settings,
        sizes=typical_sizes(scanner, settings),
        limits=LIMITS,
        bin_ticks=scanner.azimuth_bin_ticks * plan.every,
    )
    setups = [Setup(each.survey, plan.windows) for each in trial.stations]
    return ratios(adjust_unit(measured, trial.factory, settings), setups, instrument)


def of_results(folder: Path) -> dict[str, dict[str, Array]]:
    """Ratios of the first calibration of every scanner of a study that has been run."""
    found = {}
    with chdir(folder):
        configuration = configuration_in(Path())
        study = read_study(read_yaml(configuration), str(configuration))
        for scanner, calibrations in study.calibrations.items():
            path = Path(
                f"{study.config.folder}/calibrations/{scanner}/{next(iter(calibrations))}.json"
            )
            unit = from_plain(JudgedCalibration, read_json(path), str(path)).unit
            task = of_study(configuration, scanner, Candidates())
            stations = len(task.given)
            name = f"{scanner} of the study, {stations} stations"
            found[name] = ratios(unit, task.given, task.instrument)
    return found


def line(name: str, rows: Sequence[dict[str, Array]]) -> list[str]:
    """Median over draws and lasers, and the quantiles of 5 and 95 %."""
    texts = [name, str(len(rows))]
    for kind in KINDS:
        every = np.concatenate([row[kind] for row in rows])
        for number in range(len(NAMES)):
            low, middle, high = np.quantile(every[:, number], (0.05, 0.5, 0.95))
            texts.append(f"{middle:.2f} ({low:.2f} to {high:.2f})")
    return texts


def main() -> None:
    """Print the table, and write it into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--cases", nargs="*", default=list(CASES))
    parser.add_argument("--study", type=Path)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    lines = []
    for name in given.cases:
        rows = [of_trial(CASES[name], given.seed + number) for number in range(given.draws)]
        lines.append(line(name, rows))
        print(" | ".join(lines[-1]), flush=True)
    if given.study is not None:
        for name, row in of_results(given.study).items():
            lines.append(line(name, [row]))
            print(" | ".join(lines[-1]), flush=True)
    heading = ["case", "units", *(f"{name}, {kind}" for kind in KINDS for name in NAMES)]
    table = "\n".join(markdown_table(heading, lines, [False] + [True] * 7))
    if given.write:
        DOC.write_text(inserted(DOC.read_text("utf-8"), "planner", table), "utf-8")


if __name__ == "__main__":
    main()
