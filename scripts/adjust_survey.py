"""Pose of a scanner from the targets of its base, and the planes in its frame."""

from pathlib import Path

from velocal.io import storage
from velocal.io.scripts import run
from velocal.survey.station import adjust_station


def main(
    *,
    planes: Path,
    base_scanner: Path,
    base_field: Path,
    covariance: Path | None,
    survey: Path,
    position: str,
    scanner: str,
    names: list[str],
) -> None:
    """Write pose and planes, with covariances and residuals, as JSON."""
    station = adjust_station(
        planes, base_scanner, base_field,
        position=position, scanner=scanner, names=names, covariance=covariance,
    )  # fmt: skip
    storage.write_json(survey, station.to_json())


if "snakemake" in globals():
    run(main, snakemake)
