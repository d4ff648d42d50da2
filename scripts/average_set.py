"""Average the adjustments of samples and windows to a parameter set, and export it."""

from pathlib import Path

from velocal import __version__
from velocal.adjustment.average import average, average_covariance, scatter_table
from velocal.adjustment.functional import ADJUSTABLE_UNITS
from velocal.adjustment.tabulate import read_corrections
from velocal.calibration.convert import for_program
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.errors import reported
from velocal.io import storage
from velocal.scanner.models import scanner_named


def main(
    adjustments: list[Path],
    covariances: list[Path],
    calibration: Path | None,
    files: dict[str, Path],
    scatter: Path,
    *,
    scanner: str,
    weights: str,
    positions: list[str],
    export: dict[str, str],
) -> None:
    """Write the set by suffix; adjustments come sample by sample, `positions` of the samples."""
    pairs = zip(adjustments, covariances, strict=True)
    parts = [read_corrections(*(storage.read_csv(path) for path in pair)) for pair in pairs]
    windows = len(parts) // len(positions)
    samples = [parts[first : first + windows] for first in range(0, len(parts), windows)]
    means = {kind: average(samples, kind, positions) for kind in ("equal", "covariance")}
    chosen, known = means[weights], scanner_named(scanner)
    factory, tick_m = formats.read_or_nominal(calibration, known), known.distance_tick_m
    parameters = factory.corrected({name: each.mean for name, each in chosen.items()})
    sources = {"adjustments": ["/".join(path.parts[-2:]) for path in adjustments]}
    sources |= {"calibration": calibration.name if calibration else "nominal", "weights": weights}
    found = CalibrationFile(
        parameters, "paper", scanner, tick_m,
        std={name: each.std for name, each in chosen.items()},
        covariance=average_covariance(samples, weights, positions),
        provenance={"velocal": __version__, **sources},
    )  # fmt: skip
    others = {
        k: CalibrationFile(for_program(parameters, d), d, tick_m=tick_m) for k, d in export.items()
    }
    for suffix, path in files.items():
        formats.write(path, others.get(suffix, found))
    storage.write_csv(scatter, scatter_table(means["equal"], means["covariance"], ADJUSTABLE_UNITS))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            *([Path(path) for path in snakemake.input[k]] for k in ("adjustments", "covariances")),
            Path(c) if (c := snakemake.input.calibration) else None,
            {k: Path(snakemake.output[k]) for k in ("csv", "json", "yaml", "xml")},
            Path(snakemake.output.scatter),
            scanner=snakemake.wildcards.scanner,
            **{k: v for k, v in snakemake.params.items() if k != "library"},
        )
