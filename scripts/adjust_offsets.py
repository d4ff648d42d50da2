"""Adjust voff and hoff too, on the windows of all samples, and compare them with the truth."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from velocal.calibration.files import formats
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.paper.claims.offsets import FiveParameters, adjust_five, table
from velocal.reporting.figures.claims import draw_offsets
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.study.adjustment import Adjustment
from velocal.survey.station import read_station


def main(
    *,
    assigned: list[Path],
    surveys: list[Path],
    factories: list[Path],
    truths: list[Path],
    csv: Path,
    svg: Path,
    png: Path,
    samples: list[str],
    positions: list[str],
    scanners: list[str],
    factory_scanners: list[str],
    truth_scanners: list[str],
    adjustment: Mapping[str, Adjustment],
    simulated: bool,
) -> None:
    """Write the corrections of every sample and laser as CSV, and their figure.

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
    found: dict[tuple[str, str], list[FiveParameters]] = {}
    windows = zip(assigned, scanners, samples, positions, strict=True)
    for path, scanner, sample, position in windows:
        station = stations[position]
        data = station.observations(storage.read_table(path, schemas.ASSIGNED)[0])
        five = adjust_five(data, factory[scanner], adjustment[scanner], [station.uncertainty()])
        found.setdefault((scanner, sample), []).append(five)
    tables = [table(*key, each, truth.get(key[0])) for key, each in found.items()]
    offsets = pd.concat(tables, ignore_index=True)
    storage.write_csv(csv, offsets, digits=6)
    save(draw_offsets(offsets, simulated=simulated), svg, png)


if "snakemake" in globals():
    run(main, snakemake)
