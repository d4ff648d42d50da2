"""Reduce returns to medians per laser and azimuth bin."""

from dataclasses import asdict
from pathlib import Path

from velocal.errors import reported
from velocal.io import schemas, storage
from velocal.reduction.medians import binned_medians
from velocal.scanner.models import scanner_named


def main(
    returns: Path, medians: Path, *, scanner: str, cell_deg: float | None, min_count: int
) -> None:
    """Write the medians as Parquet; the width of a bin defaults to the scanner's."""
    known = scanner_named(scanner)
    bin_ticks = known.azimuth_bin(cell_deg)
    columns, facts = storage.read_table(
        returns, schemas.RETURNS, ["azimuth", "laser_id", "distance"]
    )
    reduced = binned_medians(
        columns["azimuth"],
        columns["laser_id"],
        columns["distance"],
        lasers_per_firing=known.lasers_per_firing,
        bin_ticks=bin_ticks,
        min_count=min_count,
    )
    facts |= {"cell_ticks": bin_ticks, "min_count": min_count}
    storage.write_table(medians, schemas.MEDIANS, asdict(reduced), **facts)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.returns),
            Path(snakemake.output.medians),
            scanner=snakemake.params.scanner,
            cell_deg=snakemake.params.cell_deg,
            min_count=snakemake.params.min_count,
        )
