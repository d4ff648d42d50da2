"""Everything that the study has found on one page of HTML."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from velocal.errors import reported
from velocal.io import storage
from velocal.reporting import report


def main(
    files: Mapping[str, list[Path]],
    output: Path,
    *,
    title: str,
    simulated: bool,
    tables: Mapping[str, Any],
    figures: Mapping[str, Any],
    factories: Mapping[str, str],
) -> None:
    """Write the report; the files are the rule's inputs by name, and any may be missing."""
    study = report.read(
        files,
        title=title,
        simulated=simulated,
        tables=tables,
        figures=figures,
        factories=factories,
    )
    storage.write_text(output, report.render(study))


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            {
                # One file alone comes as itself, not in a list.
                name: [Path(path) for path in ([found] if isinstance(found, str) else found)]
                for name, found in snakemake.input.items()
            },
            Path(snakemake.output.report),
            title=snakemake.params.study,
            simulated=snakemake.params.simulated,
            tables=snakemake.params.tables,
            figures=snakemake.params.figures,
            factories=snakemake.params.factories,
        )
