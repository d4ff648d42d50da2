"""Command that tells what a calibration will state, before anybody measures."""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from velocal.cli.common import Force, Json, escape, print_json, progress, say, tell
from velocal.cli.names import SCANNERS
from velocal.errors import ConfigError

if TYPE_CHECKING:
    from velocal.evaluation.plan_task import PlanTask
    from velocal.evaluation.planner import Judged, Plan

#: Files that `--out` writes.
FILES = (
    "plan.json",
    "lasers.csv",
    "candidates.csv",
    "plan.svg",
    "plan.png",
    "lasers.svg",
    "lasers.png",
)
_UNITS = (("dl", "mm", 1e3), ("alpha", "deg", 57.29577951308232), ("v", "deg", 57.29577951308232))


def plan(
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="STUDY|SKETCH", help="Folder of a study, or sketch of a site (YAML)."
        ),
    ] = None,
    scanner: Annotated[
        str | None,
        typer.Option("--scanner", help=f"Of a study with several: {', '.join(SCANNERS)}."),
    ] = None,
    candidates: Annotated[
        Path | None,
        typer.Option("--candidates", help="YAML with stations to compare, for a study."),
    ] = None,
    template: Annotated[
        Path | None, typer.Option("--template", help="Write an example of a sketch, and end.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for tables, JSON and pictures.")
    ] = None,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Tell what a calibration will state: standard deviations per laser, and the best station.

    The scanner's beams are followed to the planes of a study's survey or of a sketch. No recording
    is needed. The adjustment of the unit then states the covariance, as it will after measuring.
    """
    from velocal.io.output import check_outputs, writing

    if template is not None:
        from velocal.io.storage import write_text
        from velocal.study.sketch import TEMPLATE

        check_outputs([template], overwrite=force)
        write_text(template, TEMPLATE)
        say(f"wrote {template}; next: velocal plan {template}")
        return
    if source is None:
        raise typer.BadParameter("name a study or a sketch", param_hint="STUDY|SKETCH")
    task = _task(source, scanner, candidates)
    if out is not None:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
        check_outputs([out / name for name in FILES], overwrite=force)
    from velocal.evaluation.planner import judge, plan_unit

    base, given = None, task.given
    with progress("Planning") as (bar, running):
        bar.update(running, total=bool(given) + len(task.candidates) * (1 if given else 2))
        if given:
            base = plan_unit(given, task.instrument)
            bar.advance(running)
        judged = judge(given, task.candidates, task.instrument, lambda: bar.advance(running))
        if base is None and judged[0].alone is not None:
            # The best one is taken; then the others are judged beside it.
            best = judged[0]
            first = next(c for c in task.candidates if c.station.position == best.name)
            base, given = best.alone, (first,)
            others = [c for c in task.candidates if c is not first]
            judged = judge(given, others, task.instrument, lambda: bar.advance(running))
    if base is None:
        raise ConfigError(
            "no candidate meets a plane",
            where=str(source),
            hint="Look whether heights, headings and tilts are right.",
        )
    facts = _facts(task, base, judged)
    tell(list(task.remarks))
    if as_json:
        print_json(facts)
    else:
        _print(task, base, judged)
    if out is not None:
        _write(out, task, given, base, judged, facts)
        if not as_json:
            say(f"{out}: {', '.join(FILES)}")


def _task(source: Path, scanner: str | None, candidates: Path | None) -> PlanTask:
    from velocal.evaluation.plan_task import configuration_in, of_sketch, of_study
    from velocal.study.sketch import Candidates, read_candidates, read_sketch

    if not source.exists():
        raise ConfigError(
            "there is no such folder or file",
            where=str(source),
            hint="`velocal plan --template room.yaml` writes an example of a sketch.",
        )
    if source.is_dir():
        wanted = read_candidates(candidates) if candidates else Candidates()
        configuration = configuration_in(source)
        with chdir(source):
            return of_study(configuration, scanner, wanted)
    for option, value in (("--scanner", scanner), ("--candidates", candidates)):
        if value is not None:
            raise ConfigError("is for studies only", where=option, hint="Write it into the sketch.")
    return of_sketch(read_sketch(source), source.parent)


def _summary(plan: Plan) -> list[dict[str, Any]]:
    """Median and worst standard deviation of every parameter over the observed lasers."""
    seen = plan.unit.calibration.observed.nonzero()[0]
    found = []
    for number, (name, unit, factor) in enumerate(_UNITS):
        std = sorted((float(plan.std[k, number]) * factor, int(k)) for k in seen)
        worst, laser = std[-1]
        found.append(
            {
                "name": name,
                "unit": unit,
                "median_std": 0.5 * (std[(len(std) - 1) // 2][0] + std[len(std) // 2][0]),
                "worst_std": worst,
                "worst_laser": laser,
                "weakly_determined": plan.weakly_determined(name).tolist(),
                "stays_with_factory": plan.held(name).tolist(),
            }
        )
    return found


def _facts(task: PlanTask, base: Plan, judged: tuple[Judged, ...]) -> dict[str, Any]:
    """Everything for programs."""
    from velocal import __version__

    sizes = task.instrument.sizes
    spread = {name: float(value) for name, value in sizes.spread.items()}
    return {
        "velocal": __version__,
        "scanner": task.instrument.scanner.name,
        "assumed": {
            "spread": spread,
            "pattern_m": float(sizes.tau_m.mean()),
            "median_m": float(sizes.omega_m.mean()),
            "pattern_deg": float(sizes.length_rad) * _UNITS[1][2],
        },
        "stations": [station.name for station in base.unit.stations],
        "planes": {
            station.name: {
                plane: {
                    "lasers": int((medians > 0).sum()),
                    "medians": int(medians.sum()),
                }
                for plane, medians in zip(base.planes, of_station.T, strict=True)
            }
            for station, of_station in zip(base.unit.stations, base.medians, strict=True)
        },
        "parameters": _summary(base),
        "unobserved": base.unobserved.tolist(),
        "judged_at_m": task.instrument.range_m,
        "point_std_mm": 1e3 * base.point_std_m,
        "candidates": [
            {
                "name": each.name,
                "alone_point_std_mm": each.alone and 1e3 * each.alone.point_std_m,
                "beside_point_std_mm": each.beside and 1e3 * each.beside.point_std_m,
                "parameters": each.plan and _summary(each.plan),
                "unobserved": each.plan and each.plan.unobserved.tolist(),
            }
            for each in judged
        ],
        "best_candidate": judged[0].name if judged and judged[0].plan else None,
        "lasers": base.to_columns(),
        "remarks": list(task.remarks),
    }


def _lasers(numbers: list[int]) -> str:
    """Numbers of lasers as ranges."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][1] + 1:
            parts[-1][1] = number
        else:
            parts.append([number, number])
    return ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in parts) or "none"


def _print(task: PlanTask, base: Plan, judged: tuple[Judged, ...]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False, soft_wrap=True)
    at = task.instrument.range_m
    names = " and ".join(station.name for station in base.unit.stations)
    say(f"{task.instrument.scanner.name} at {names}: expected standard deviations")
    table = Table(box=None, pad_edge=False)
    for heading in (
        "parameter",
        "median",
        "worst",
        "laser id",
        "weakly determined",
        "stays with factory",
    ):
        table.add_column(heading)
    for row in _summary(base):
        table.add_row(
            f"{row['name']} [{row['unit']}]".replace("[", r"\["),
            f"{row['median_std']:.3g}",
            f"{row['worst_std']:.3g}",
            str(row["worst_laser"]),
            f"{len(row['weakly_determined'])} lasers",
            f"{len(row['stays_with_factory'])} lasers",
        )
    console.print(table)
    met = Table(box=None, pad_edge=False)
    for heading in ("station", "plane", "lasers", "medians"):
        met.add_column(heading)
    for station, medians in zip(base.unit.stations, base.medians, strict=True):
        for plane, of_plane in zip(base.planes, medians.T, strict=True):
            met.add_row(
                escape(station.name), escape(plane), str((of_plane > 0).sum()), str(of_plane.sum())
            )
    console.print(met)
    say(f"Ids of lasers that meet no plane: {_lasers(base.unobserved.tolist())}")
    say(f"A point at {at:g} m: {1e3 * base.point_std_m:.1f} mm (root mean square over all lasers)")
    if not judged:
        return
    ranking = Table(box=None, pad_edge=False)
    columns = (
        "candidate",
        "alone, mm",
        f"beside {names}, mm",
        "dl, mm",
        "alpha, deg",
        "v, deg",
        "unobserved",
    )
    for heading in columns:
        ranking.add_column(heading)
    for each in judged:
        shown = [f"{1e3 * p.point_std_m:.1f}" if p else "-" for p in (each.alone, each.beside)]
        rows = (
            [f"{row['median_std']:.3g}" for row in _summary(each.plan)] if each.plan else ["-"] * 3
        )
        last = f"{len(each.plan.unobserved)} lasers" if each.plan else "meets no plane"
        ranking.add_row(escape(each.name), *shown, *rows, last)
    say(f"Candidates by the standard deviation of a point at {at:g} m, the best first:")
    console.print(ranking)


def _write(
    out: Path,
    task: PlanTask,
    given: tuple[Any, ...],
    base: Plan,
    judged: tuple[Judged, ...],
    facts: dict[str, Any],
) -> None:
    """Write tables, JSON and pictures."""
    import pandas as pd

    from velocal.evaluation.planner import expected_medians
    from velocal.io.storage import write_csv, write_json
    from velocal.reporting.figures.plan import draw_plan
    from velocal.reporting.figures.plan import plan as plan_numbers
    from velocal.reporting.figures.planned import draw_lasers
    from velocal.reporting.style import save
    from velocal.study.figures import PlanFigure

    instrument = task.instrument
    write_json(out / "plan.json", facts)
    write_csv(out / "lasers.csv", base.to_columns())
    rows = [
        {
            "candidate": each.name,
            "alone_point_std_mm": each.alone and 1e3 * each.alone.point_std_m,
            "beside_point_std_mm": each.beside and 1e3 * each.beside.point_std_m,
        }
        for each in judged
    ]
    columns = ["candidate", "alone_point_std_mm", "beside_point_std_mm"]
    write_csv(out / "candidates.csv", pd.DataFrame(rows, columns=columns))
    best = [c for c in task.candidates if judged and c.station.position == judged[0].name]
    numbers = []
    for setup in (*given, *best):
        station = setup.station
        beams = expected_medians(
            instrument.factory, station.patches, instrument.scanner, instrument.bin_ticks
        )
        what = "best candidate" if setup in best else "planned"
        numbers.append(
            plan_numbers(what, station, beams, instrument.factory, task.targets, instrument.limits)
        )
    selection = PlanFigure(
        kind="plan",
        scanner=instrument.scanner.name,
        samples=tuple(s.station.position for s in given),
    )
    figure = draw_plan(pd.concat(numbers), selection, simulated=False, measured=False)
    save(figure, out / "plan.svg", out / "plan.png")
    save(draw_lasers(base, instrument.scanner.name), out / "lasers.svg", out / "lasers.png")
