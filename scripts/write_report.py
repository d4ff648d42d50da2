"""Everything that the study has found on one page of HTML."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from velocal.errors import reported
from velocal.io import storage
from velocal.reporting import report


def main(
    ledgers: list[Path],
    pictures: list[Path],
    numbers: list[Path],
    summary: Path | None,
    agreement: Path | None,
    surveys: list[Path],
    sets: list[Path],
    methods: list[Path],
    field_table: Path | None,
    field_pictures: list[Path],
    outdoor: Path | None,
    outdoor_pictures: list[Path],
    output: Path,
    *,
    title: str,
    simulated: bool,
    tables: Mapping[str, Any],
    figures: Mapping[str, Any],
    factories: Mapping[str, str],
    samples: list[str],
    parameter_sets: list[tuple[str, str]],
    field_samples: list[str],
    outdoor_figures: list[str],
) -> None:
    """Write the report.

    Files of a kind are in the order of what they are of: `samples`, `figures`, `parameter_sets`
    (scanner and name), `field_samples`, `outdoor_figures`. `methods` is a picture and its numbers.
    """
    drawn = zip(pictures, numbers, strict=True)
    files = report.Files(
        ledgers=dict(zip(samples, ledgers, strict=True)),
        figures=dict(zip(figures, drawn, strict=True)),
        summary=summary,
        agreement=agreement,
        surveys=surveys,
        sets=dict(zip(parameter_sets, sets, strict=True)),
        factories={
            name: None if path == "nominal" else Path(path) for name, path in factories.items()
        },
        methods=(methods[0], methods[1]) if methods else None,
        field_table=field_table,
        field_pictures=dict(zip(field_samples, field_pictures, strict=True)),
        outdoor=outdoor,
        outdoor_pictures=dict(zip(outdoor_figures, outdoor_pictures, strict=True)),
    )
    study = report.read(files, title=title, simulated=simulated, tables=tables, figures=figures)
    storage.write_text(output, report.render(study))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        found = snakemake.input
        main(
            *(
                [Path(path) for path in kind]
                for kind in (found.ledgers, found.pictures, found.numbers)
            ),
            *(Path(path) if path else None for path in (found.summary, found.agreement)),
            *([Path(path) for path in kind] for kind in (found.surveys, found.sets, found.methods)),
            Path(path) if (path := found.field_table) else None,
            [Path(path) for path in found.field_pictures],
            Path(path) if (path := found.outdoor) else None,
            [Path(path) for path in found.outdoor_pictures],
            Path(snakemake.output.report),
            title=snakemake.params.study,
            simulated=snakemake.params.simulated,
            tables=snakemake.params.tables,
            figures=snakemake.params.figures,
            factories=snakemake.params.factories,
            samples=snakemake.params.samples,
            parameter_sets=[tuple(each) for each in snakemake.params.parameter_sets],
            field_samples=snakemake.params.field_samples,
            outdoor_figures=snakemake.params.outdoor_figures,
        )
