"""Average the adjustments of samples and windows to a parameter set."""

from pathlib import Path

from velocal import storage
from velocal.adjustment.functional import ADJUSTABLE_UNITS
from velocal.adjustment.tabulate import read_corrections
from velocal.averaging import average, scatter_table
from velocal.calibration_files import formats, table
from velocal.errors import reported
from velocal.sensors import scanner_named


def main(
    adjustments: list[Path],
    calibration: Path | None,
    csv: Path,
    yaml: Path,
    xml: Path,
    scatter: Path,
    *,
    scanner: str,
    windows: int,
    weights: str,
) -> None:
    """Write the set as CSV with standard deviations, ROS YAML and the vendor's XML.

    The adjustments come sample by sample, `windows` of each.
    """
    parts = [read_corrections(storage.read_csv(path)) for path in adjustments]
    samples = [parts[first : first + windows] for first in range(0, len(parts), windows)]
    means = {kind: average(samples, kind) for kind in ("equal", "covariance")}
    chosen = means[weights]
    factory = formats.read_or_nominal(calibration, scanner_named(scanner))
    parameters = factory.corrected({name: each.mean for name, each in chosen.items()})
    table.write(csv, parameters, {name: each.std for name, each in chosen.items()})
    formats.write(yaml, parameters)
    formats.write(xml, parameters)
    columns = scatter_table(means["equal"], means["covariance"], ADJUSTABLE_UNITS)
    storage.write_csv(scatter, columns)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            [Path(path) for path in snakemake.input.adjustments],
            Path(c) if (c := snakemake.input.calibration) else None,
            Path(snakemake.output.csv),
            Path(snakemake.output.yaml),
            Path(snakemake.output.xml),
            Path(snakemake.output.scatter),
            scanner=snakemake.wildcards.scanner,
            windows=snakemake.params.windows,
            weights=snakemake.params.weights,
        )
