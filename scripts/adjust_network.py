"""Adjust the observations of a survey to coordinates with their accuracy."""

from pathlib import Path

from velocal.io import storage
from velocal.io.scripts import run
from velocal.survey.network.observations import read_field_book
from velocal.survey.network.survey import accuracy as accuracy_table
from velocal.survey.network.survey import adjust_field_book, as_dict, covariances
from velocal.survey.station import plane_covariances
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
    survey = adjust_field_book(read_field_book(observations), where=str(points))
    write_targets(control, "frame", [survey.control_points])
    write_targets(planes, "plane", [survey.planes])
    write_targets(base_field, "position", list(survey.base_field.values()))
    write_targets(base_scanner, "scanner", [found.targets for found in survey.readings.values()])
    known = {"base_field": covariances(survey.base_field)}
    known["planes"] = plane_covariances(survey.planes)
    storage.write_json(covariance, known)
    storage.write_json(quality, as_dict(survey))
    storage.write_csv(accuracy, accuracy_table(survey), digits=4)


if "snakemake" in globals():
    run(main, snakemake)
