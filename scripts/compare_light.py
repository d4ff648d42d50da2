"""Compare the parameters of samples with and without the halogen light."""

from pathlib import Path

from velocal.adjustment.result import CalibrationSet
from velocal.calibration.files.formats import read_or_nominal
from velocal.io import storage
from velocal.io.scripts import run
from velocal.paper.claims.light import differences
from velocal.reporting.figures.claims import draw_light
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named


def main(
    *,
    adjustments: list[Path],
    covariances: list[Path],
    calibration: Path | None,
    csv: Path,
    svg: Path,
    png: Path,
    samples: list[str],
    scanner: str,
    simulated: bool,
) -> None:
    """Write the differences as CSV, and their figure; `samples` are those of every adjustment."""
    factory = read_or_nominal(calibration, scanner_named(scanner))
    sets: dict[str, list[CalibrationSet]] = {}
    for sample, path, covariance in zip(samples, adjustments, covariances, strict=True):
        columns, matrices = storage.read_csv(path), storage.read_csv(covariance)
        own = CalibrationSet.from_columns(columns, factory, matrices)
        sets.setdefault(sample, []).append(own)
    found = differences(sets)
    storage.write_csv(csv, found, digits=6)
    save(draw_light(found, simulated=simulated), svg, png)


if "snakemake" in globals():
    run(main, snakemake)
