"""Average the adjustments of samples and windows to a parameter set, and export it."""

from pathlib import Path
from typing import Literal

import numpy as np

from velocal import __version__
from velocal.adjustment.average import Member, average, scatter_columns
from velocal.adjustment.result import CalibrationSet
from velocal.calibration.files import formats
from velocal.exports import as_file, write_calibration
from velocal.io import schemas, storage
from velocal.io.scripts import for_each, run
from velocal.scanner.models import scanner_named
from velocal.study.outputs import DECODER, Export


@for_each(
    "adjustments", "covariances", "assigned", "calibration", "csv", "json", "yaml", "xml",
    "decoder", "scatter", "scanner", "samples", "positions",
)  # fmt: skip
def main(
    *,
    adjustments: list[Path],
    covariances: list[Path],
    assigned: list[Path],
    calibration: Path | None,
    csv: Path,
    json: Path,
    yaml: Path,
    xml: Path,
    decoder: Path,
    scatter: Path,
    scanner: str,
    samples: list[str],
    positions: list[str],
    weights: Literal["equal", "covariance"],
    export: Export,
) -> None:
    """Write the set in every format; `samples` and `positions` are those of every adjustment.

    `assigned` are the medians of every adjustment; the files for programs are made at their
    rotation rate.
    """
    known = scanner_named(scanner)
    factory = formats.read_or_nominal(calibration, known)
    tables = [
        CalibrationSet.from_columns(storage.read_csv(one), factory, storage.read_csv(other))
        for one, other in zip(adjustments, covariances, strict=True)
    ]
    members = [Member(*each) for each in zip(samples, positions, tables, strict=True)]
    mean = average(members, weights)
    sources = {
        "adjustments": ["/".join(path.parts[-2:]) for path in adjustments],
        "calibration": calibration.name if calibration else "nominal",
        "weights": weights,
    }
    found = as_file(mean, known, {"velocal": __version__, **sources})
    for path in (csv, json):
        formats.write(path, found)
    rates_hz = [
        storage.read_table(path, schemas.ASSIGNED, [])[1]["rotation_rate_hz"] for path in assigned
    ]
    rate_hz = round(float(np.median(rates_hz)), 3)
    for path, program in ((yaml, export.yaml), (xml, export.xml), (decoder, DECODER)):
        write_calibration(path, mean, known, program=program, rate_hz=rate_hz)
    storage.write_csv(scatter, scatter_columns(members))


if "snakemake" in globals():
    run(main, snakemake)
