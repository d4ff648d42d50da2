"""Adjust all lasers, stations and planes of a unit together, and export the calibration."""

from pathlib import Path

from velocal import __version__
from velocal.calibration.files import formats
from velocal.chain import calibrate_unit
from velocal.evaluation.holdout import to_columns
from velocal.exports import write_calibration_files
from velocal.io import schemas, storage
from velocal.io.plain import to_plain
from velocal.io.scripts import run
from velocal.scanner.beam import Beams
from velocal.scanner.models import scanner_named
from velocal.study.adjustment import Joint
from velocal.study.outputs import DECODER, Export
from velocal.study.reduction import AssignmentLimits
from velocal.survey.station import read_station


def main(
    *,
    medians: list[Path],
    surveys: list[Path],
    calibration: Path | None,
    checks: Path,
    csv: Path,
    json: Path,
    yaml: Path,
    xml: Path,
    decoder: Path,
    judged: Path,
    lasers: Path,
    hold_out: Path,
    scanner: str,
    positions: list[str],
    limits: AssignmentLimits,
    joint: Joint,
    export: Export,
) -> None:
    """Write the calibration in every format, what it rests on, and what was held out.

    `positions` are those of every file of medians. `checks` is not read: it exists only if the
    checks found no error of the survey.
    """
    known = scanner_named(scanner)
    factory = formats.read_or_nominal(calibration, known)
    stations = {station.position: station for station in map(read_station, surveys)}
    recordings, rates_hz = [], []
    for path, position in zip(medians, positions, strict=True):
        columns, facts = storage.read_table(path, schemas.MEDIANS)
        beams = Beams.from_ticks(columns, known, facts["rotation_rate_hz"])
        recordings.append((beams, stations[position]))
        rates_hz.append(facts["rotation_rate_hz"])
    found = calibrate_unit(
        recordings,
        factory,
        settings=joint.settings(known, factory),
        limits=limits.metric(),
        near_points=joint.near_points,
    )
    sources = {
        "medians": ["/".join(path.parts[-2:]) for path in medians],
        "factory": calibration.name if calibration else "nominal",
    }
    write_calibration_files(
        found,
        known,
        ours=(csv, json),
        programs=((yaml, export.yaml), (xml, export.xml), (decoder, DECODER)),
        distance=export.distance,
        rates_hz=rates_hz,
        provenance={"velocal": __version__, **sources},
    )
    storage.write_json(judged, to_plain(found))
    storage.write_csv(lasers, found.unit.to_columns())
    storage.write_csv(hold_out, to_columns(found.hold_out))


if "snakemake" in globals():
    run(main, snakemake)
