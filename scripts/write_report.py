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
    factories: list[Path],
    factory_scanners: list[str],
    scanners: list[str],
    samples: list[str],
    set_scanners: list[str],
    set_names: list[str],
    field_samples: list[str],
    outdoor_figures: list[str],
) -> None:
    """Write the report; whatever is missing or empty has no section.

    Files of a kind are in the order of what they are of: `ledgers` of `samples`, `pictures` and
    `numbers` of `figures`, `sets` of `set_scanners` and `set_names`, `factories` of
    `factory_scanners` (another of `scanners` has nominal values), `field_pictures` of
    `field_samples`, `outdoor_pictures` of `outdoor_figures`.
    """
    drawn = zip(pictures, numbers, strict=True)
    known = dict(zip(factory_scanners, factories, strict=True))
    files = report.Files(
        ledgers=dict(zip(samples, ledgers, strict=True)),
        figures=dict(zip(figures, drawn, strict=True)),
        summary=summary,
        agreement=agreement,
        surveys=surveys,
        sets=dict(zip(zip(set_scanners, set_names, strict=True), sets, strict=True)),
        factories={name: known.get(name) for name in scanners},
        methods=(methods_png, methods_csv) if methods_png and methods_csv else None,
        field_table=field_table,
        field_pictures=dict(zip(field_samples, field_pictures, strict=True)),
        outdoor=outdoor,
        outdoor_pictures=dict(zip(outdoor_figures, outdoor_pictures, strict=True)),
    )
    study = report.read(files, title=title, simulated=simulated, tables=tables, figures=figures)
    storage.write_text(report_html, report.render(study))


if "snakemake" in globals():
    run(main, snakemake)
