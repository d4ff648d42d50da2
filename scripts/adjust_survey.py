"""Pose of a scanner from the targets of its base, and the planes in its frame."""

from pathlib import Path

import numpy as np

from velocal.io import storage
from velocal.io.scripts import run
from velocal.survey.station import adjust_station, as_dict
from velocal.survey.targets import read_targets, with_covariance


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
    field = read_targets(base_field, "position").of(position, where=str(base_field))
    known = storage.read_json(covariance) if covariance else {}
    if known:
        field = with_covariance(field, known["base_field"][position], where=str(covariance))
    station = adjust_station(
        read_targets(planes, "plane"),
        read_targets(base_scanner, "scanner").of(scanner, where=str(base_scanner)),
        field,
        names,
        covariances={name: np.array(found) for name, found in known.get("planes", {}).items()},
        where=str(planes),
    )
    storage.write_json(survey, {"position": position, "scanner": scanner, **as_dict(station)})


if "snakemake" in globals():
    run(main, snakemake)
