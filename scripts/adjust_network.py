"""Adjust the observations of a survey to coordinates with their accuracy."""

from pathlib import Path

from velocal.errors import reported
from velocal.io import storage
from velocal.survey.network.field_book import FILES, read_field_book
from velocal.survey.network.survey import accuracy, adjust_field_book
from velocal.survey.targets import write_targets


def main(observations: dict[str, Path], out: dict[str, Path]) -> None:
    """Write survey files, and how good every adjustment is."""
    survey = adjust_field_book(read_field_book(observations), where=str(observations["points"]))
    write_targets(out["control"], "frame", [survey.control_points])
    write_targets(out["planes"], "plane", [survey.planes])
    write_targets(out["base_field"], "position", list(survey.base_site.values()))
    write_targets(
        out["base_scanner"], "scanner", [found.targets for found in survey.base_scanner.values()]
    )
    storage.write_json(out["covariance"], survey.covariances().to_json())
    storage.write_json(out["quality"], survey.to_json())
    storage.write_csv(out["accuracy"], accuracy(survey), digits=4)


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        given = snakemake.input
        main(
            {name: Path(given[name]) for name in FILES if given.get(name)},
            {name: Path(path) for name, path in snakemake.output.items()},
        )
