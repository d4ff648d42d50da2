"""Measure how the distances of every laser change over windows and samples of a position."""

from pathlib import Path

import pandas as pd

from velocal.adjustment.observations import Observations
from velocal.calibration.files.formats import read_or_nominal
from velocal.capture.source import SourceFilter
from velocal.evaluation.drift import Window, drift_table, summarised, temperature_table
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.recording.windows import read_index, temperature_deg_c, window_rotations
from velocal.reporting.figures.drift import draw
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.survey.station import read_station


def main(
    *,
    assigned: list[Path],
    surveys: list[Path],
    recordings: list[Path],
    rotations: list[Path],
    factories: list[Path],
    lasers: Path,
    summary: Path,
    temperature: Path,
    svg: Path,
    png: Path,
    samples: list[str],
    windows: list[str],
    names: list[str],
    scanners: list[str],
    positions: list[str],
    ports: list[int | None],
    addresses: list[str | None],
    factory_scanners: list[str],
    length: int,
    simulated: bool,
) -> None:
    """Write the change per laser and window, its means, and how they follow the temperature.

    `samples` and `windows` are those of every file of assigned medians; `names` and what follows
    belong to every recording, `factory_scanners` to every calibration.
    """
    stations = {station.position: station for station in map(read_station, surveys)}
    known = dict(zip(factory_scanners, factories, strict=True))
    medians: dict[tuple[str, str], Observations] = {}
    stood = dict(zip(names, positions, strict=True))
    for path, sample, window in zip(assigned, samples, windows, strict=True):
        columns, _ = storage.read_table(path, schemas.ASSIGNED)
        medians[sample, window] = stations[stood[sample]].observations(columns)
    rows: list[Window] = []
    tables = zip(names, scanners, positions, recordings, rotations, ports, addresses, strict=True)
    for name, scanner, position, recording, path, port, address in tables:
        index, source = read_index(path), SourceFilter(port, address)
        for window in (each for sample, each in medians if sample == name):
            chosen = window_rotations(index, window, length, str(recording))
            warmth = temperature_deg_c(recording, index, chosen, source)
            data = medians[name, window]
            rows.append(Window(scanner, position, name, window, warmth, data))
    parameters = {
        name: read_or_nominal(known.get(name), scanner_named(name))
        for name in dict.fromkeys(scanners)
    }
    table = pd.DataFrame(drift_table(rows, parameters))
    means = summarised(table)
    storage.write_csv(lasers, table, digits=5)
    storage.write_csv(summary, means, digits=5)
    storage.write_csv(temperature, temperature_table(means), digits=5)
    save(draw(table, means, simulated=simulated), svg, png)


if "snakemake" in globals():
    run(main, snakemake)
