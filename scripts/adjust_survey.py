"""Pose of a scanner from the targets of its base, and the planes in its frame."""

from pathlib import Path

import numpy as np

from velocal.errors import reported
from velocal.io import storage
from velocal.survey.station import adjust_station, as_dict
from velocal.survey.targets import read_targets, with_covariance


def main(
    planes: Path,
    base_scanner: Path,
    base_field: Path,
    survey: Path,
    *,
    covariance: Path | None = None,
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
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.planes),
            Path(snakemake.input.base_scanner),
            Path(snakemake.input.base_field),
            Path(snakemake.output.survey),
            covariance=Path(snakemake.input.covariance) if snakemake.input.covariance else None,
            position=snakemake.wildcards.position,
            scanner=snakemake.params.scanner,
            names=snakemake.params.planes,
        )
