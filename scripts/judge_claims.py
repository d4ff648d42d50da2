"""Judge the claims of the paper that its tables do not answer."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from velocal.adjustment.result import CalibrationSet
from velocal.calibration.files import formats
from velocal.evaluation.candidates import IDENTITY
from velocal.evaluation.statistics import KEYS
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.paper.claims import lasers as of_lasers
from velocal.paper.claims import light, offsets, outdoor, verdict, windows
from velocal.paper.outdoor import HEADING
from velocal.reporting.figures import claims as figures
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.study.adjustment import Adjustment
from velocal.study.figures import Table
from velocal.survey.station import read_station


def _frame(path: Path) -> pd.DataFrame:
    text = (*KEYS, *HEADING, *IDENTITY, "shown", "position")
    return pd.DataFrame(storage.read_csv(path, text=text))


def main(
    *,
    assigned: list[Path],
    adjustments: list[Path],
    covariances: list[Path],
    surveys: list[Path],
    factories: list[Path],
    truths: list[Path],
    lasers: Path,
    summary: Path,
    outdoor_samples: Path,
    outdoor_means: Path,
    drift: Path,
    claims: Path,
    claims_md: Path,
    light_csv: Path,
    light_svg: Path,
    light_png: Path,
    offsets_csv: Path,
    offsets_svg: Path,
    offsets_png: Path,
    samples: list[str],
    positions: list[str],
    scanners: list[str],
    factory_scanners: list[str],
    truth_scanners: list[str],
    adjustment: Mapping[str, Adjustment],
    tables: Mapping[str, Table],
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the table of claims, and what two of them rest on with a figure each.

    `samples`, `positions` and `scanners` are those of every file of assigned medians.
    """
    stations = {station.position: station for station in map(read_station, surveys)}
    known = dict(zip(factory_scanners, factories, strict=True))
    factory = {
        name: formats.read_or_nominal(known.get(name), scanner_named(name)) for name in adjustment
    }
    truth = {
        name: formats.read(path, len(factory[name]))
        for name, path in zip(truth_scanners, truths, strict=True)
    }
    sets: dict[str, list[CalibrationSet]] = {}
    fives: dict[tuple[str, str], list[offsets.FiveParameters]] = {}
    for sample, position, scanner, medians, table, other in zip(
        samples, positions, scanners, assigned, adjustments, covariances, strict=True
    ):
        start = factory[scanner]
        sets.setdefault(sample, []).append(
            CalibrationSet.from_columns(storage.read_csv(table), start, storage.read_csv(other))
        )
        station = stations[position]
        data = station.observations(storage.read_table(medians, schemas.ASSIGNED)[0])
        five = offsets.adjust_five(data, start, adjustment[scanner], [station.uncertainty()])
        fives.setdefault((scanner, sample), []).append(five)
    differences = light.differences(sets)
    of_offsets = pd.concat(
        [offsets.table(*key, each, truth.get(key[0])) for key, each in fives.items()],
        ignore_index=True,
    )
    statistics, rows, moved = _frame(lasers), _frame(summary), _frame(drift)
    judged = verdict.table(
        [
            light.judge(differences, moved),
            *windows.judge(moved, rows),
            *offsets.judge(of_offsets, sigma_cm),
            of_lasers.judge_count(statistics, rows, tables["4"]),
            of_lasers.judge_better(statistics, rows, tables),
            *outdoor.judge_reductions(_frame(outdoor_means)),
            outdoor.judge_25_m(_frame(outdoor_samples)),
        ]
    )
    storage.write_csv(claims, judged)
    storage.write_text(claims_md, verdict.markdown(judged, simulated=simulated))
    storage.write_csv(light_csv, differences, digits=6)
    storage.write_csv(offsets_csv, of_offsets, digits=6)
    save(figures.draw_light(differences, simulated=simulated), light_svg, light_png)
    save(figures.draw_offsets(of_offsets, simulated=simulated), offsets_svg, offsets_png)


if "snakemake" in globals():
    run(main, snakemake)
