"""Calibrations without a survey where the truth is known: errors, coverage, rooms, range scale.

Usage: python benchmarks/unsurveyed.py [--draws N] [--seed S] [--tables NAME ...] [--cases NAME ...]
[--scanners NAME ...] [--out FOLDER] [--resume] [--write]

`--cases` is for the table `unsurveyed`, `--scanners` for the two others. The draws of the table
`unsurveyed` are collected in FOLDER/draws.csv. With `--resume` those that are there are not made
again, so that a run that was stopped can be continued.

Rooms, units and noise are those of the independent world (`velocal.simulation.independent`), whose
medians are used without its survey. Every plane is fitted to the points that the factory's
parameters give. `--write` writes the tables into docs/field.md.
"""

import argparse
import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from velocal.adjustment.observations import Observations
from velocal.adjustment.unit.result import NAMES, UnitCalibration
from velocal.arrays import Array, joined_rows
from velocal.chain import calibrate_on_planes
from velocal.evaluation.another_plane import with_another_room
from velocal.evaluation.planes_in_data import Cloud, FieldPlane, plane_of
from velocal.evaluation.unsurveyed import (
    Seen,
    adjust_unsurveyed,
    relative_std,
    unsurveyed_settings,
)
from velocal.geometry.planes import fit_plane
from velocal.io.markup import inserted, markdown_table
from velocal.scanner.beam import Beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters
from velocal.simulation.independent.plan import Plan, SurveyErrors, UnitErrors
from velocal.simulation.independent.trial import Trial, draw

DOC = Path(__file__).parents[1] / "docs/field.md"
#: The seeds of the page begin here; others are for the development of methods.
FIRST_SEED = 3001
ROOMS = ("long", "short", "floor")
FULL = ("long", "short", "floor", "board", "far")
#: One azimuth bin of this number is used.
EVERY = {"VLP-16": 2, "HDL-32E": 4}
#: Places, tilt in degrees and surfaces of a scanner.
PLACES = {
    "1 place, 2 walls and floor": (1, 0.0, ROOMS),
    "1 place, 5 planes": (1, 0.0, FULL),
    "2 places, 2 walls and floor": (2, 0.0, ROOMS),
    "2 places tilted by 15 deg, 2 walls and floor": (2, 15.0, ROOMS),
}
#: Worlds that differ from the first one in one thing, and the places where they are tried.
UNEVEN, OFFSETS = "surfaces uneven by 5 mm", "voff and hoff wrong by 3 mm"
WORLDS: dict[str, tuple[dict[str, Any], list[str]]] = {
    "": ({}, list(PLACES)),
    UNEVEN: ({"survey": SurveyErrors(flatness_mm=5.0)}, ["1 place, 5 planes"]),
    OFFSETS: ({"unit": UnitErrors(voff_mm=3.0, hoff_mm=3.0)}, list(PLACES)),
}
CASES = {
    ", ".join(filter(None, (scanner, text, world))): Plan(
        scanner=scanner, stations=n, tilt_deg=tilt, surfaces=surfaces, windows=1, every=every,
        **options,
    )
    for world, (options, places) in WORLDS.items()
    for scanner, every in EVERY.items()
    for text, (n, tilt, surfaces) in ((text, PLACES[text]) for text in places)
}  # fmt: skip
#: The second room, and tilts of the scanner in it, degrees.
OTHER_ROOM = ("short", "far", "floor", "board")
TILTS = (0.0, 15.0)
#: Range scales of the lasers that are simulated: standard deviations, metres per metre.
SCALES = (0.0, 0.001, 0.003)
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


def wanted(trial: Trial, range_m: Array) -> Array:
    """True corrections of dl at the ranges of the lasers, alpha and v, shape (lasers, 3)."""
    true, factory = trial.true, trial.factory
    dl = [float(trial.correction(r, slice(k, k + 1))[0]) for k, r in enumerate(range_m)]
    return np.column_stack(
        [np.array(dl) - factory.dl, true.alpha - factory.alpha, true.v - factory.v]
    )


def judged(plan: Plan, seed: int) -> dict[str, float]:
    """Errors, coverage and thickness of planes of one draw."""
    trial = draw(plan, seed)
    result = calibrate_on_planes(seen_of(trial), trial.scanner)
    calibration, true, factory = result.unit.calibration, trial.true, trial.factory
    truth = wanted(trial, result.unit.mean_range_m)
    found = calibration.corrections
    std = relative_std(result.unit)
    row: dict[str, float] = {"better": float(result.recommended)}
    for i, (name, unit) in enumerate(zip(NAMES, (1e2, _DEG, _DEG), strict=True)):
        before = truth[:, i] - truth[:, i].mean()
        error = found[:, i] - truth[:, i]
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


def relative(unit: UnitCalibration, trial: Trial) -> tuple[Array, Array]:
    """Root mean square over the lasers of the errors and of the stated standard deviations."""
    error = unit.calibration.corrections - wanted(trial, unit.mean_range_m)
    error -= error.mean(axis=0)
    return np.sqrt(np.mean(error**2, axis=0)), np.sqrt(np.mean(relative_std(unit) ** 2, axis=0))


def in_two_rooms(scanner: str, tilt_deg: float, seed: int) -> dict[str, Array]:
    """One room, what another one is predicted to bring, and what it brings.

    The unit of a seed is the same in all rooms.
    """
    plan = Plan(scanner=scanner, surfaces=ROOMS, windows=1, every=EVERY[scanner])
    first = draw(plan, seed)
    # The second station of the other room: another place too.
    other = draw(replace(plan, surfaces=OTHER_ROOM, stations=2, tilt_deg=tilt_deg), seed)
    assert np.array_equal(first.true.dl, other.true.dl)
    one, two = seen_of(first)[0], replace(seen_of(other)[1], name="other room")
    settings = unsurveyed_settings(SCANNERS[scanner], first.factory)
    unit = adjust_unsurveyed([one], settings)
    expected = with_another_room([one], unit, settings, other.stations[1].windows[0])
    both = adjust_unsurveyed([one, two], settings)
    row = {
        "predicted": np.array(
            [expected.dl_mm * 1e-3, *np.deg2rad([expected.alpha_deg, expected.v_deg])]
        )
    }
    for name, found in (("one", unit), ("both", both)):
        row[f"{name}_error"], row[f"{name}_std"] = relative(found, first)
        thick = [thickness(trial, found.calibration.adjusted) for trial in (first, other)]
        row[f"{name}_thick"] = np.array([np.mean(thick)])
    return row


def rooms_table(scanners: Sequence[str], draws: int, seed: int) -> str:
    """Predicted standard deviations beside the errors that were found."""
    lines = []
    for scanner in scanners:
        for tilt in TILTS:
            rows = [in_two_rooms(scanner, tilt, seed + number) for number in range(draws)]
            rms = {
                key: np.sqrt(np.mean([row[key] ** 2 for row in rows], axis=0)) for key in rows[0]
            }
            for i, (name, unit) in enumerate(
                (("dl, cm", 1e2), ("alpha, deg", _DEG), ("v, deg", _DEG))
            ):
                keys = ("one_std", "one_error", "predicted", "both_std", "both_error")
                thick = f"{rms['one_thick'][0]:.2f} / {rms['both_thick'][0]:.2f}" if i == 0 else ""
                case = f"{scanner}, second room tilted by {tilt:g} deg" if i == 0 else ""
                lines.append([case, str(draws) if i == 0 else "", name,
                              *(f"{rms[key][i] * unit:.3f}" for key in keys), thick])  # fmt: skip
            print(*(" | ".join(each) for each in lines[-3:]), sep="\n", flush=True)
    return "\n".join(markdown_table(ROOMS_HEADING, lines, [False, True, False] + [True] * 6))


def with_scale(trial: Trial, size: float, seed: int) -> Trial:
    """The same with a range scale in the distances of every laser."""
    kappa = np.random.default_rng([seed, 3]).normal(0.0, size, len(trial.factory))

    def scaled(data: Observations) -> Observations:
        return replace(data, distance_m=data.distance_m * (1.0 - kappa[data.laser_id]))

    stations = tuple(
        replace(each, windows=tuple(map(scaled, each.windows))) for each in trial.stations
    )
    return replace(trial, stations=stations, unseen=tuple(map(scaled, trial.unseen)))


def scaled_thickness(trial: Trial, unit: UnitCalibration) -> float:
    """As `thickness`, with the range scale that was estimated, constant beyond its ranges."""
    assert unit.range_scale is not None
    changed = []
    for data in trial.unseen:
        length = data.distance_m + unit.calibration.adjusted.dl[data.laser_id]
        more = unit.range_scale.change(length, data.laser_id, unit.mean_range_m)
        changed.append(replace(data, distance_m=data.distance_m + more))
    return thickness(replace(trial, unseen=tuple(changed)), unit.calibration.adjusted)


def scale_table(scanners: Sequence[str], draws: int, seed: int) -> str:
    """What the range scale would bring on planes at places that were not used."""
    lines = []
    for scanner in scanners:
        every = EVERY[scanner]
        for surfaces, text in ((ROOMS, "2 walls and floor"), (FULL, "5 planes")):
            for size in SCALES:
                found = []
                for number in range(draws):
                    plan = Plan(
                        scanner=scanner, surfaces=surfaces, windows=1, every=every, stations=2
                    )
                    trial = with_scale(draw(plan, seed + number), size, seed + number)
                    settings = unsurveyed_settings(SCANNERS[scanner], trial.factory)
                    unit = adjust_unsurveyed(
                        seen_of(trial), replace(settings, integration_points=1)
                    )
                    assert unit.range_scale is not None
                    held = thickness(trial, unit.calibration.adjusted)
                    found.append(
                        (
                            held,
                            scaled_thickness(trial, unit),
                            np.median(unit.range_scale.determined),
                        )
                    )
                held, applied, share = np.array(found).T
                gain = held - applied
                half = stdtrit(draws - 1, 0.975) * gain.std(ddof=1) / np.sqrt(draws)
                lines.append([
                    f"{scanner}, 2 places, {text}", f"{size * 1e3:g}", str(draws),
                    f"{np.mean(share) * 100:.0f}", f"{held.mean():.3f}", f"{applied.mean():.3f}",
                    f"{gain.mean():.3f}", f"{gain.mean() - half:.3f} to {gain.mean() + half:.3f}",
                ])  # fmt: skip
                print(" | ".join(lines[-1]), flush=True)
    return "\n".join(markdown_table(SCALE_HEADING, lines, [False] + [True] * 7))


TABLES = ["unsurveyed", "unsurveyed_cover", "unsurveyed_rooms", "unsurveyed_scale"]
ROOMS_HEADING = [
    "case",
    "draws",
    "",
    "one room: stated std",
    "one room: rms error",
    "both: predicted std",
    "both: stated std",
    "both: rms error",
    "unseen with one / both, cm",
]
SCALE_HEADING = [
    "case",
    "true scale, mm/m",
    "draws",
    "share from data, %",
    "unseen, scale held, cm",
    "unseen, scale applied, cm",
    "gain, cm",
    "95 %, cm",
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
    parser.add_argument("--tables", nargs="*", default=TABLES, choices=TABLES)
    parser.add_argument("--scanners", nargs="*", default=list(EVERY), choices=list(EVERY))
    parser.add_argument("--cases", nargs="*", default=list(CASES))
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/unsurveyed"))
    parser.add_argument("--resume", action="store_true", help="leave out what is done already")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    tables: dict[str, Callable[[], str]] = {
        "unsurveyed": lambda: main_table(
            given.cases, given.draws, given.seed, given.out / "draws.csv", given.resume
        ),
        "unsurveyed_cover": lambda: cover_table(given.out / "draws.csv"),
        "unsurveyed_rooms": lambda: rooms_table(given.scanners, given.draws, given.seed),
        "unsurveyed_scale": lambda: scale_table(given.scanners, given.draws, given.seed),
    }
    for name in given.tables:
        table = tables[name]()
        if given.write:
            DOC.write_text(inserted(DOC.read_text("utf-8"), name, table), "utf-8")


def main_table(cases: Sequence[str], draws: int, seed: int, file: Path, resume: bool) -> str:
    """Errors, coverage and thickness of planes of every case; rows of draws are kept in a file."""
    known = pd.read_csv(file) if resume and file.exists() else pd.DataFrame(columns=["case"])
    rows = known.to_dict("records")
    done = {(row["case"], row["seed"]) for row in rows}
    # One draw of every case after the other, so that a run that is stopped has as many of each.
    for each, name in itertools.product(range(seed, seed + draws), cases):
        if (name, each) not in done:
            rows.append({"case": name, "seed": each} | judged(CASES[name], each))
            pd.DataFrame(rows).to_csv(file, index=False, float_format="%.6g")
            print(f"{name}, seed {each}", flush=True)
    lines = []
    for name in cases:
        own = [row for row in rows if row["case"] == name and seed <= row["seed"] < seed + draws]
        lines.append(line(name, own))
        print(" | ".join(lines[-1]), flush=True)
    return "\n".join(markdown_table(HEADING, lines, [False] + [True] * 9))


def cover_table(file: Path) -> str:
    """Coverage of all cases of a world together, with its standard error.

    The unit of a seed is the same in all cases of a scanner: the standard error is that of the
    mean over units.
    """
    draws = pd.read_csv(file)
    draws["unit"] = draws["case"].str.split(",").str[0] + draws["seed"].astype(str)
    world = pd.Series("as the independent world", draws.index)
    for name in (UNEVEN, OFFSETS):
        world[draws["case"].str.endswith(name)] = name
    lines = []
    for name, own in [*draws.groupby(world, sort=False), ("all", draws)]:
        cells = []
        for parameter in NAMES:
            of_units = own.groupby("unit")[f"{parameter}_cover"].mean() * 100.0
            error = of_units.std(ddof=1) / np.sqrt(len(of_units))
            cells.append(f"{of_units.mean():.1f} ± {error:.1f}")
        lines.append([str(name), str(own["case"].nunique()), str(len(own)), *cells])
    heading = ["world", "cases", "draws", *(f"cover {name}, %" for name in NAMES)]
    return "\n".join(markdown_table(heading, lines, [False] + [True] * 5))


if __name__ == "__main__":
    main()
