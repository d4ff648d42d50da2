"""Everything that the study has found on one page of HTML."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from velocal.io import storage
from velocal.io.scripts import run
from velocal.reporting import report


def main(
    *,
    ledgers: list[Path],
    agreement: Path | None,
    summary: Path | None,
    surveys: list[Path],
    sets: list[Path],
    factories: list[Path],
    pictures: list[Path],
    numbers: list[Path],
    methods_csv: Path | None,
    methods_png: Path | None,
    field_table: Path | None,
    field_pictures: list[Path],
    outdoor: Path | None,
    outdoor_pictures: list[Path],
    report_html: Path,
    title: str,
    simulated: bool,
    tables: Mapping[str, Any],
    figures: Mapping[str, Any],
    scanners: list[str],
    factory_scanners: list[str],
) -> None:
    """Write the report; whatever is missing or empty has no section.

    `figures` are the entries of the configuration, in the order of the files of figures;
    `factory_scanners` are those of the factory's files. Another of `scanners` has nominal values.
    """
    files = {
        "ledgers": ledgers,
        "agreement": [agreement] if agreement else [],
        "summary": [summary] if summary else [],
        "surveys": surveys,
        "sets": sets,
        "figures": [*pictures, *numbers],
        "methods": [path for path in (methods_csv, methods_png) if path],
        "field": [*([field_table] if field_table else []), *field_pictures],
        "outdoor": [*([outdoor] if outdoor else []), *outdoor_pictures],
    }
    known = dict(zip(factory_scanners, map(str, factories), strict=True))
    study = report.read(
        files,
        title=title,
        simulated=simulated,
        tables=tables,
        figures=figures,
        factories={name: known.get(name, "nominal") for name in scanners},
    )
    storage.write_text(report_html, report.render(study))


if "snakemake" in globals():
    run(main, snakemake)
