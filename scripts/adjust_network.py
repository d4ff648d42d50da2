"""Adjust the observations of a survey to coordinates with their accuracy."""

from pathlib import Path

from velocal.io import storage
from velocal.io.scripts import run
from velocal.survey.network.field_book import read_field_book
from velocal.survey.network.survey import accuracy as accuracy_table
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.targets import write_targets


def main(
    *,
    points: Path,
    network: Path,
    images: Path | None,
    base_sights: Path,
    base_readings: Path,
    control: Path,
    planes: Path,
    base_field: Path,
    base_scanner: Path,
    covariance: Path,
    quality: Path,
    accuracy: Path,
) -> None:
    """Write survey files, and how good every adjustment is."""
    observations = {"points": points, "network": network}
    observations |= {"base_sights": base_sights, "base_readings": base_readings}
    observations |= {"images": images} if images else {}
    adjusted = adjust_field_book(read_field_book(observations), where=str(points))
    write_targets(control, "frame", [adjusted.control_points])
    write_targets(planes, "plane", [adjusted.planes])
    write_targets(base_field, "position", list(adjusted.base_site.values()))
    write_targets(
        base_scanner, "scanner", [each.targets for each in adjusted.base_scanner.values()]
    )
    storage.write_json(covariance, adjusted.covariances().to_json())
    storage.write_json(quality, adjusted.to_json())
    storage.write_csv(accuracy, accuracy_table(adjusted), digits=4)


if "snakemake" in globals():
    run(main, snakemake)
