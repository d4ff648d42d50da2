"""Average the adjustments of samples and windows to a parameter set, and export it."""

from pathlib import Path

from velocal import __version__
from velocal.adjustment.average import average, average_covariance, scatter_table
from velocal.adjustment.functional import ADJUSTABLE_UNITS
from velocal.adjustment.tabulate import Corrections, read_corrections
from velocal.calibration.convert import exported
from velocal.calibration.files import formats
from velocal.calibration.files.document import Calibration
from velocal.io import storage
from velocal.io.scripts import run
from velocal.scanner.models import scanner_named
from velocal.study.config import Export


def main(
    *,
    adjustments: list[Path],
    covariances: list[Path],
    calibration: Path | None,
    csv: Path,
    json: Path,
    yaml: Path,
    xml: Path,
    scatter: Path,
    scanner: str,
    samples: list[str],
    positions: list[str],
    weights: str,
    export: Export,
) -> None:
    """Write the set in every format; `samples` and `positions` are those of every adjustment."""
    pairs = zip(adjustments, covariances, strict=True)
    parts = [read_corrections(*(storage.read_csv(path) for path in pair)) for pair in pairs]
    windows: dict[str, list[Corrections]] = {}
    stood: dict[str, str] = {}
    for sample, position, part in zip(samples, positions, parts, strict=True):
        windows.setdefault(sample, []).append(part)
        stood[sample] = position
    grouped, places = list(windows.values()), list(stood.values())
    means = {kind: average(grouped, kind, places) for kind in ("equal", "covariance")}
    chosen, known = means[weights], scanner_named(scanner)
    factory, tick_m = formats.read_or_nominal(calibration, known), known.distance_tick_m
    parameters = factory.corrected({name: mean.mean for name, mean in chosen.items()})
    sources = {
        "adjustments": ["/".join(path.parts[-2:]) for path in adjustments],
        "calibration": calibration.name if calibration else "nominal",
        "weights": weights,
    }
    found = Calibration(
        parameters, "paper", scanner, tick_m,
        std={name: mean.std for name, mean in chosen.items()},
        covariance=average_covariance(grouped, weights, places),
        provenance={"velocal": __version__, **sources},
    )  # fmt: skip
    others = {
        suffix: Calibration(exported(parameters, program), program, tick_m=tick_m)
        for suffix, program in (("yaml", export.yaml), ("xml", export.xml))
    }
    for suffix, path in {"csv": csv, "json": json, "yaml": yaml, "xml": xml}.items():
        formats.write(path, others.get(suffix, found))
    storage.write_csv(scatter, scatter_table(means["equal"], means["covariance"], ADJUSTABLE_UNITS))


if "snakemake" in globals():
    run(main, snakemake)
