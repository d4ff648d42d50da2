"""Adjust all lasers of a unit and planes that nobody surveyed together, and export the result."""

from pathlib import Path

import pandas as pd

from velocal import __version__
from velocal.adjustment.unit.result import NAMES
from velocal.calibration.files import formats
from velocal.chain import calibrate_on_planes, points_of
from velocal.evaluation.another_plane import with_another_plane
from velocal.evaluation.holdout import to_columns
from velocal.evaluation.unsurveyed import (
    PlaneKey,
    Seen,
    drawn,
    relative_std,
    unsurveyed_settings,
)
from velocal.exports import write_calibration_files
from velocal.io import schemas, storage
from velocal.io.plain import to_plain
from velocal.io.scripts import run
from velocal.reporting.figures.unsurveyed import field_calibration
from velocal.reporting.style import save
from velocal.scanner.beam import Beams
from velocal.study.adjustment import Joint
from velocal.study.outputs import DECODER, Export
from velocal.study.planes import Judged
from velocal.study.scanner_file import scanner_of


def main(
    *,
    medians: list[Path],
    members: list[Path],
    calibration: Path | None,
    description: Path | None,
    csv: Path,
    json: Path,
    yaml: Path,
    xml: Path,
    decoder: Path,
    judged: Path,
    lasers: Path,
    hold_out: Path,
    more: Path,
    svg: Path,
    png: Path,
    scanner: str,
    unit: str,
    samples: list[str],
    joint: Joint,
    export: Export,
    chosen: Judged,
) -> None:
    """Write the calibration with what it rests on, was judged on, and would gain by more planes.

    `samples` are those of every file of medians.
    """
    known = scanner_of(description or scanner)
    factory = formats.read_or_nominal(calibration, known)
    recordings, rates_hz = [], []
    for name, path, on_planes in zip(samples, medians, members, strict=True):
        columns, facts = storage.read_table(path, schemas.MEDIANS)
        beams = Beams.from_ticks(columns, known, facts["rotation_rate_hz"])
        rates_hz.append(facts["rotation_rate_hz"])
        cloud = points_of(beams, factory, joint.near_points)
        rows, planes = storage.read_table(on_planes, schemas.MEMBERS)
        recordings.append(
            Seen.of_members(name, cloud, rows["row"], rows["plane"], planes["planes"])
        )
    settings = unsurveyed_settings(known, factory, joint.prior.std() if joint.prior else None)
    only_judged = _only_judged(recordings, chosen)
    result = calibrate_on_planes(
        recordings,
        known,
        settings=settings,
        judged=only_judged,
        near_points=joint.near_points,
    )
    used = [each.without(only_judged) for each in recordings]
    storage.write_csv(more, pd.DataFrame(with_another_plane(used, result.unit, settings)))
    sources = {
        "medians": ["/".join(path.parts[-2:]) for path in medians],
        "factory": calibration.name if calibration else "nominal",
    }
    write_calibration_files(
        result,
        known,
        ours=(csv, json),
        programs=((yaml, export.yaml), (xml, export.xml), (decoder, DECODER)),
        distance=export.distance,
        rates_hz=rates_hz,
        provenance={"velocal": __version__, **sources},
    )
    storage.write_json(judged, to_plain(result))
    relative = zip(NAMES, relative_std(result.unit).T, strict=True)
    table = result.unit.to_columns() | {f"{name}_relative_std": each for name, each in relative}
    storage.write_csv(lasers, table)
    storage.write_csv(hold_out, to_columns(result.hold_out))
    save(field_calibration(result, f"{scanner}, {unit}"), svg, png)


def _only_judged(recordings: list[Seen], chosen: Judged) -> list[PlaneKey]:
    """Planes that the configuration keeps out of the adjustment."""
    if chosen.share is not None:
        return drawn(recordings, chosen.share, chosen.seed)
    return [
        key
        for each in recordings
        for key in each.keys
        if each.name in chosen.names or "/".join(key) in chosen.names
    ]


if "snakemake" in globals():
    run(main, snakemake)
