"""Pose of a scanner from the targets of its base, and the planes in its frame."""

from pathlib import Path

from velocal.io import storage
from velocal.io.scripts import run
from velocal.survey.station import Station
from velocal.survey.targets import SurveyCovariances, read_targets


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
    base_site = read_targets(base_field, "position").of(position, where=str(base_field))
    known = None
    if covariance:
        known = SurveyCovariances.from_json(storage.read_json(covariance))
        base_site = known.of_base(base_site, position, where=str(covariance))
    station = Station.adjust(
        read_targets(planes, "plane"),
        read_targets(base_scanner, "scanner").of(scanner, where=str(base_scanner)),
        base_site,
        names,
        covariances=known.planes if known else None,
        where=str(planes),
    )
    storage.write_json(survey, station.to_json())


if "snakemake" in globals():
    run(main, snakemake)
