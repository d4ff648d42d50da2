"""Measure whether a surveyed unit measures the same distances in all windows of a position."""

from pathlib import Path

import pandas as pd

from velocal.adjustment.observations import Observations
from velocal.capture.source import SourceFilter
from velocal.evaluation import stability
from velocal.evaluation.holdout import JudgedCalibration
from velocal.io import schemas, storage
from velocal.io.plain import from_plain
from velocal.io.scripts import for_each, run
from velocal.recording.windows import read_index, temperature_deg_c, window_rotations
from velocal.reporting.figures.stability import draw
from velocal.reporting.style import save
from velocal.survey.station import read_station


@for_each(
    "assigned", "surveys", "recordings", "rotations", "judged", "csv", "svg", "png", "scanner",
    "unit", "samples", "windows", "names", "positions", "ports", "addresses",
)  # fmt: skip
def main(
    *,
    assigned: list[Path],
    surveys: list[Path],
    recordings: list[Path],
    rotations: list[Path],
    judged: Path,
    csv: Path,
    svg: Path,
    png: Path,
    scanner: str,
    unit: str,
    samples: list[str],
    windows: list[str],
    names: list[str],
    positions: list[str],
    ports: list[int | None],
    addresses: list[str | None],
    length: int,
    simulated: bool,
) -> None:
    """Write the changes between all windows of every position, also of several recordings.

    `samples` and `windows` are those of every file of assigned medians; `names` and what follows
    belong to every recording.
    """
    found = from_plain(JudgedCalibration, storage.read_json(judged), str(judged)).unit
    stations = {station.position: station for station in map(read_station, surveys)}
    stood = dict(zip(names, positions, strict=True))
    sources = map(SourceFilter, ports, addresses)
    recorded = dict(
        zip(names, zip(recordings, map(read_index, rotations), sources, strict=True), strict=True)
    )
    seen: dict[str, list[Observations]] = {}
    times: dict[str, list[tuple[str, str, float]]] = {}
    for path, sample, window in zip(assigned, samples, windows, strict=True):
        position, (recording, index, source) = stood[sample], recorded[sample]
        columns, _ = storage.read_table(path, schemas.ASSIGNED)
        seen.setdefault(position, []).append(stations[position].observations(columns))
        chosen = window_rotations(index, window, length, str(recording))
        warmth = temperature_deg_c(recording, index, chosen, source)
        times.setdefault(position, []).append((sample, window, warmth))
    compared = {
        position: stability.between_windows(each, found.calibration.adjusted)
        for position, each in seen.items()
    }
    changes = {position: each for position, each in compared.items() if each is not None}
    table = pd.DataFrame(stability.tabulate(changes, times), columns=list(stability.COLUMNS))
    storage.write_csv(csv, table, digits=5)
    save(draw(changes, times, f"{scanner}, {unit}", simulated=simulated), svg, png)


if "snakemake" in globals():
    run(main, snakemake)
