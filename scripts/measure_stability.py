"""Measure whether a unit without a survey measures the same distances at several times."""

from pathlib import Path

import numpy as np
import pandas as pd

from velocal.calibration.files import formats
from velocal.capture.source import SourceFilter
from velocal.chain import observe_again, points_of
from velocal.evaluation import stability
from velocal.evaluation.holdout import JudgedCalibration
from velocal.evaluation.unsurveyed import Seen, unit_station_of, unsurveyed_settings
from velocal.io import schemas, storage
from velocal.io.plain import from_plain
from velocal.io.scripts import run
from velocal.recording.windows import read_index, temperature_deg_c
from velocal.reporting.figures.stability import draw
from velocal.reporting.style import save
from velocal.scanner.beam import Beams
from velocal.scanner.models import scanner_named
from velocal.study.adjustment import Joint


def main(
    *,
    returns: list[Path],
    medians: list[Path],
    members: list[Path],
    recordings: list[Path],
    rotations: list[Path],
    calibration: Path | None,
    judged: Path,
    csv: Path,
    svg: Path,
    png: Path,
    scanner: str,
    unit: str,
    samples: list[str],
    ports: list[int | None],
    addresses: list[str | None],
    joint: Joint,
) -> None:
    """Write the changes between the windows of every recording, and between recordings.

    `samples`, `ports` and `addresses` are those of every recording.
    """
    known = scanner_named(scanner)
    factory = formats.read_or_nominal(calibration, known)
    found = from_plain(JudgedCalibration, storage.read_json(judged), str(judged)).unit
    changes, times, seen = {}, {"recordings": [(name, "", np.nan) for name in samples]}, []
    files = zip(samples, returns, medians, members, recordings, rotations, strict=True)
    sources = map(SourceFilter, ports, addresses)
    for (name, raw, path, on_planes, recording, index_file), source in zip(
        files, sources, strict=True
    ):
        columns, facts = storage.read_table(path, schemas.MEDIANS)
        rows, planes = storage.read_table(on_planes, schemas.MEMBERS)
        beams = Beams.from_ticks(columns, known, facts["rotation_rate_hz"])
        whole = points_of(beams, factory, joint.near_points)
        seen.append(Seen.of_members(name, whole, rows["row"], rows["plane"], planes["planes"]))
        if not seen[-1].planes:
            continue
        bins = stability.BinsOnPlanes.of(
            columns,
            rows["row"],
            rows["plane"],
            seen[-1].planes,
            ticks=facts["cell_ticks"],
            min_count=facts["min_count"],
        )
        index, rate_hz = read_index(index_file), facts["rotation_rate_hz"]
        shots, _ = storage.read_table(
            raw, schemas.RETURNS, ["rotation", "azimuth", "laser_id", "distance"]
        )
        windows, when = [], []
        for number, own in enumerate(stability.parts_in_time(np.flatnonzero(index.complete))):
            chosen = np.isin(shots["rotation"], own)
            part = {column: values[chosen] for column, values in shots.items()}
            windows.append(observe_again(part, rate_hz, bins, known, factory, joint.near_points))
            when.append((name, str(number + 1), temperature_deg_c(recording, index, own, source)))
        within = stability.between_windows(windows, found.calibration.adjusted)
        if within is not None:
            changes[name], times[name] = within, when
    stations = [unit_station_of(each) for each in seen if each.planes]
    times["recordings"] = [time for time, each in zip(times["recordings"], seen, strict=True)
                           if each.planes]  # fmt: skip
    settings = unsurveyed_settings(known, factory, joint.prior.std() if joint.prior else None)
    between = stability.between_recordings(stations, found, settings)
    if between is not None:
        changes["recordings"] = between
    table = pd.DataFrame(stability.tabulate(changes, times), columns=list(stability.COLUMNS))
    storage.write_csv(csv, table, digits=5)
    save(draw(changes, times, f"{scanner}, {unit}"), svg, png)


if "snakemake" in globals():
    run(main, snakemake)
