"""Calibrations without a survey where the truth is known: one room against two, errors, coverage.

Usage: python benchmarks/unsurveyed.py [--draws N] [--seed S] [--cases NAME ...] [--write]

Rooms, units and noise are those of the independent world (`velocal.simulation.independent`), whose
medians are used without its survey. Every plane is fitted to the points that the factory's
parameters give. `--write` writes the table into docs/field.md.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from velocal.adjustment.unit.result import NAMES
from velocal.arrays import joined_rows
from velocal.chain import calibrate_on_planes
from velocal.evaluation.planes_in_data import Cloud, FieldPlane, plane_of
from velocal.evaluation.unsurveyed import Seen, relative_std
from velocal.geometry.planes import fit_plane
from velocal.io.markup import inserted, markdown_table
from velocal.scanner.beam import Beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters
from velocal.simulation.independent.plan import Plan
from velocal.simulation.independent.trial import Trial, draw

DOC = Path(__file__).parents[1] / "docs/field.md"
#: The seeds of the page begin here; others are for the development of methods.
FIRST_SEED = 3001
ROOMS = ("long", "short", "floor")
FULL = ("long", "short", "floor", "board", "far")
CASES = {
    f"{scanner}, {text}": Plan(
        scanner=scanner, stations=n, tilt_deg=tilt, surfaces=surfaces, windows=1, every=every
    )
    for scanner, every in (("VLP-16", 1), ("HDL-32E", 2))
    for text, n, tilt, surfaces in (
        ("1 place, 2 walls and floor", 1, 0.0, ROOMS),
        ("1 place, 5 planes", 1, 0.0, FULL),
        ("2 places, 2 walls and floor", 2, 0.0, ROOMS),
        ("2 places tilted by 15 deg, 2 walls and floor", 2, 15.0, ROOMS),
    )
}
#: Half width of a 95 % interval in standard deviations.
NORMAL_95 = 1.959964
_DEG = 180.0 / np.pi


def seen_of(trial: Trial) -> list[Seen]:
    """Points and planes of every place."""
    tick = SCANNERS[trial.scanner].distance_tick_m
    found = []
    for number, station in enumerate(trial.stations):
        data = joined_rows(station.windows)
        beams = Beams(data.distance_m, data.phi, data.laser_id, tick)
        cloud = Cloud.from_beams(beams, trial.factory)
        planes: list[FieldPlane] = []
        for plane in np.unique(data.plane_number):
            planes.append(
                plane_of(f"plane{plane}", cloud, np.flatnonzero(data.plane_number == plane))
            )
        found.append(Seen(f"place{number + 1}", cloud, tuple(planes)))
    return found


def thickness(trial: Trial, parameters: LaserParameters) -> float:
    """Standard deviation of s about fitted planes at places that were not used, cm."""
    tick = SCANNERS[trial.scanner].distance_tick_m
    found = []
    for data in trial.unseen:
        cloud = Cloud.from_beams(Beams(data.distance_m, data.phi, data.laser_id, tick), parameters)
        for plane in np.unique(data.plane_number):
            rows = np.flatnonzero(data.plane_number == plane)
            found.append(np.std(cloud.s(rows, fit_plane(cloud.xyz[rows]).plane)))
    return float(np.mean(found)) * 1e2


def judged(plan: Plan, seed: int) -> dict[str, float]:
    """Errors, coverage and thickness of planes of one draw."""
    trial = draw(plan, seed)
    result = calibrate_on_planes(seen_of(trial), trial.scanner)
    calibration, true, factory = result.unit.calibration, trial.true, trial.factory
    at = result.unit.mean_range_m
    wanted = np.column_stack(
        [
            [float(trial.correction(r, slice(k, k + 1))[0]) for k, r in enumerate(at)] - factory.dl,
            true.alpha - factory.alpha,
            true.v - factory.v,
        ]
    )
    found = calibration.corrections
    std = relative_std(result.unit)
    row: dict[str, float] = {"better": float(result.recommended)}
    for i, (name, unit) in enumerate(zip(NAMES, (1e2, _DEG, _DEG), strict=True)):
        before = wanted[:, i] - wanted[:, i].mean()
        error = found[:, i] - wanted[:, i]
        error = error - error.mean()
        row[f"{name}_before"] = float(np.sqrt(np.mean(before**2))) * unit
        row[f"{name}_after"] = float(np.sqrt(np.mean(error**2))) * unit
        row[f"{name}_cover"] = float(np.mean(np.abs(error) <= NORMAL_95 * std[:, i]))
        row[f"{name}_std"] = float(np.sqrt(np.mean(std[:, i] ** 2))) * unit
    row["thick_before"] = thickness(trial, factory)
    row["thick_after"] = thickness(trial, calibration.adjusted)
    row["thick_true"] = thickness(trial, true)
    total = result.hold_out.total
    assert total is not None
    row["held_before"], row["held_after"] = total.before_m * 1e2, total.after_m * 1e2
    return row


def line(name: str, rows: Sequence[dict[str, float]]) -> list[str]:
    """Medians over the draws; coverage as a mean."""

    def median(key: str) -> str:
        return f"{np.median([row[key] for row in rows]):.2f}"

    def cover(key: str) -> str:
        return f"{np.mean([row[key] for row in rows]) * 100:.0f}"

    worst = max(row["thick_after"] / row["thick_before"] for row in rows)
    return [
        name,
        str(len(rows)),
        f"{median('dl_before')} / {median('dl_after')} / {median('dl_std')}",
        f"{median('alpha_before')} / {median('alpha_after')}",
        f"{median('v_before')} / {median('v_after')}",
        f"{cover('dl_cover')} / {cover('alpha_cover')} / {cover('v_cover')}",
        f"{median('thick_before')} / {median('thick_after')} / {median('thick_true')}",
        f"{worst:.2f}",
        f"{median('held_before')} / {median('held_after')}",
        f"{sum(row['better'] for row in rows):.0f}",
    ]


HEADING = [
    "case",
    "draws",
    "dl before / after / stated, cm",
    "alpha before / after, deg",
    "v before / after, deg",
    "cover dl / alpha / v, %",
    "unseen before / after / truth, cm",
    "worst ratio",
    "left out before / after, cm",
    "told better",
]


def main() -> None:
    """Print the table, and write it into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--cases", nargs="*", default=list(CASES))
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    lines = []
    for name in given.cases:
        rows = [judged(CASES[name], given.seed + number) for number in range(given.draws)]
        lines.append(line(name, rows))
        print(" | ".join(lines[-1]), flush=True)
    table = "\n".join(markdown_table(HEADING, lines, [False] + [True] * 9))
    if given.write:
        DOC.write_text(inserted(DOC.read_text("utf-8"), "unsurveyed", table), "utf-8")


if __name__ == "__main__":
    main()
