"""Average the adjustments of samples and windows to a parameter set, and export it."""

from pathlib import Path

from velocal import __version__
from velocal.adjustment.average import Member, average, scatter_columns
from velocal.adjustment.result import CalibrationSet
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
    samples: list[str],
    positions: list[str],
    weights: str,
    export: dict[str, str],
) -> None:
    """Write the set by suffix; `samples` and `positions` are those of every adjustment."""
    known = scanner_named(scanner)
    factory, tick_m = formats.read_or_nominal(calibration, known), known.distance_tick_m
    tables = [
        CalibrationSet.from_columns(storage.read_csv(one), factory, storage.read_csv(other))
        for one, other in zip(adjustments, covariances, strict=True)
    ]
    members = [Member(*each) for each in zip(samples, positions, tables, strict=True)]
    mean = average(members, weights)
    parameters = mean.adjusted
    sources = {"adjustments": ["/".join(path.parts[-2:]) for path in adjustments]}
    sources |= {"calibration": calibration.name if calibration else "nominal", "weights": weights}
    found = CalibrationFile(
        parameters, "paper", scanner, tick_m,
        std=mean.std_by_name(),
        covariance=mean.covariance_by_pair(),
        provenance={"velocal": __version__, **sources},
    )  # fmt: skip
    others = {
        k: CalibrationFile(for_program(parameters, d), d, tick_m=tick_m) for k, d in export.items()
    }
    for suffix, path in files.items():
        formats.write(path, others.get(suffix, found))
    storage.write_csv(scatter, scatter_columns(members))


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
