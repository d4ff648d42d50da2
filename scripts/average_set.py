"""Average the adjustments of samples and windows to a parameter set, and export it."""

from pathlib import Path

from velocal import __version__, storage
from velocal.adjustment.functional import ADJUSTABLE_UNITS
from velocal.adjustment.tabulate import read_corrections
from velocal.averaging import average, scatter_table
from velocal.calibration_files import formats
from velocal.calibration_files.lasers import Calibration
from velocal.conversion import exported
from velocal.errors import reported
from velocal.sensors import scanner_named


def main(
    adjustments: list[Path],
    calibration: Path | None,
    files: dict[str, Path],
    scatter: Path,
    *,
    scanner: str,
    windows: int,
    weights: str,
    export: dict[str, str],
) -> None:
    """Write the set by suffix; the adjustments come sample by sample, `windows` of each."""
    parts = [read_corrections(storage.read_csv(path)) for path in adjustments]
    samples = [parts[first : first + windows] for first in range(0, len(parts), windows)]
    means = {kind: average(samples, kind) for kind in ("equal", "covariance")}
    chosen = means[weights]
    known = scanner_named(scanner)
    factory, tick_m = formats.read_or_nominal(calibration, known), known.distance_tick_m
    parameters = factory.corrected({name: each.mean for name, each in chosen.items()})
    sources = {"adjustments": ["/".join(path.parts[-2:]) for path in adjustments]}
    sources |= {"calibration": calibration.name if calibration else "nominal", "weights": weights}
    provenance, std = {"velocal": __version__, **sources}, {k: e.std for k, e in chosen.items()}
    found = Calibration(parameters, "paper", scanner, tick_m, std=std, provenance=provenance)
    for suffix, path in files.items():
        numbers = exported(parameters, export[suffix]) if suffix in export else None
        formats.write(
            path, Calibration(numbers, export[suffix], tick_m=tick_m) if numbers else found
        )
    columns = scatter_table(means["equal"], means["covariance"], ADJUSTABLE_UNITS)
    storage.write_csv(scatter, columns)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            [Path(path) for path in snakemake.input.adjustments],
            Path(c) if (c := snakemake.input.calibration) else None,
            {k: Path(snakemake.output[k]) for k in ("csv", "json", "yaml", "xml")},
            Path(snakemake.output.scatter),
            scanner=snakemake.wildcards.scanner,
            windows=snakemake.params.windows,
            weights=snakemake.params.weights,
            export=snakemake.params.export,
        )
