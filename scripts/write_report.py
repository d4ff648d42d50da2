"""Everything that the study has found on one page of HTML."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import TypeAdapter

from velocal.calibration.files.formats import read_or_nominal
from velocal.evaluation.certificate import Certificate
from velocal.evaluation.interior_map import clouds
from velocal.evaluation.residual_map import ResidualMap
from velocal.evaluation.statistics import KEYS
from velocal.io import schemas, storage
from velocal.io.plain import from_plain
from velocal.io.scripts import run
from velocal.paper.agreement import unexpected
from velocal.paper.printed import known_misses
from velocal.reporting import report
from velocal.reporting.interactive import Interior, SampleMap
from velocal.reporting.style import for_page
from velocal.scanner.models import scanner_named
from velocal.study.figures import Figure, Table
from velocal.survey.checks.findings import read_findings

FIGURE: TypeAdapter[Figure] = TypeAdapter(Figure)


def _frame(path: Path) -> pd.DataFrame:
    return pd.DataFrame(storage.read_csv(path, text=(*KEYS, "kind", "shown", "within")))


def _optional(path: Path | None) -> pd.DataFrame | None:
    return None if path is None else _frame(path)


def _map(table: Path, png: Path, surveys: Mapping[str, Any]) -> SampleMap:
    """Residuals of a sample; only a surveyed one has a position, and planes with corners."""
    columns, facts = storage.read_table(table, schemas.RESIDUAL_MAP)
    survey = surveys.get(facts["position"], {"planes": []})
    corners = {plane["name"]: np.array(plane["corners_m"]) for plane in survey["planes"]}
    return SampleMap(
        **{name: facts[name] for name in ("sample", "scanner", "position", "after", "planes")},
        corners_m=[corners.get(name, np.zeros((0, 3))) for name in facts["planes"]],
        residuals=ResidualMap(**columns),
        png=for_page(png),
    )


def _interior(path: Path) -> Interior:
    """Points of the map of the interior."""
    columns, facts = storage.read_table(path, schemas.MAP)
    return Interior(columns["position"], facts["positions"], facts["scanners_m"], clouds(columns))


def main(
    *,
    ledgers: list[Path],
    agreement: Path | None,
    claims: Path | None,
    listed_misses: Path | None,
    summary: Path | None,
    surveys: list[Path],
    checks: Path | None,
    maps: list[Path],
    map_pictures: list[Path],
    interior: Path | None,
    sets: list[Path],
    exports: list[Path],
    pictures: list[Path],
    numbers: list[Path],
    certificate: Path | None,
    methods_csv: Path | None,
    methods_png: Path | None,
    field_table: Path | None,
    field_pictures: list[Path],
    unit_pictures: list[Path],
    unit_tables: list[Path],
    drift_pictures: list[Path],
    outdoor: Path | None,
    outdoor_pictures: list[Path],
    outdoor_numbers: list[Path],
    report_html: Path,
    title: str,
    simulated: bool,
    rotations: int | None,
    tables: Mapping[str, Table],
    figures: Mapping[str, Any],
    factories: list[Path],
    factory_scanners: list[str],
    scanners: list[str],
    range_sigma_m: dict[str, float],
    samples: list[str],
    set_scanners: list[str],
    set_names: list[str],
    field_samples: list[str],
    unsurveyed_units: list[str],
    timed_units: list[str],
    outdoor_figures: Mapping[str, list[str]],
) -> None:
    """Write the report; whatever is missing or empty has no section.

    Files of a kind are in the order of what they are of: `ledgers` of `samples`, `pictures` and
    `numbers` of `figures`, `map_pictures` of `maps`, `sets` and `exports` of `set_scanners` and
    `set_names`, `factories` of `factory_scanners` (another of `scanners` has nominal values),
    `field_pictures` of `field_samples`, `unit_pictures` and `unit_tables` of `unsurveyed_units`,
    `drift_pictures` of `timed_units`, `outdoor_pictures` and `outdoor_numbers` of
    `outdoor_figures`.
    """
    known = dict(zip(factory_scanners, factories, strict=True))
    columns: dict[str, dict[str, Any]] = {}
    for scanner, name, path in zip(set_scanners, set_names, sets, strict=True):
        columns.setdefault(scanner, {})[name] = storage.read_csv(path)
    of_sets = zip(set_scanners, set_names, exports, strict=True)
    compared = _optional(agreement)
    drawn = zip(figures.items(), pictures, numbers, strict=True)
    surveyed = {each["position"]: each for each in map(storage.read_json, surveys)}
    study = report.Study(
        title=title,
        simulated=simulated,
        ledgers=dict(zip(samples, map(storage.read_json, ledgers), strict=True)),
        tables=tables,
        summary=_optional(summary),
        agreement=compared,
        claims=_optional(claims),
        unexpected=(
            []
            if compared is None or listed_misses is None
            else unexpected(compared, known_misses(listed_misses, rotations))
        ),
        figures=[
            report.Figure(number, FIGURE.validate_python(selection), _frame(csv), for_page(png))
            for (number, selection), png, csv in drawn
        ],
        surveys=list(surveyed.values()),
        warnings=read_findings(checks) if checks else (),
        sets=columns,
        exports={(scanner, name): _frame(path) for scanner, name, path in of_sets},
        factories={
            name: read_or_nominal(known.get(name), scanner_named(name)) for name in scanners
        },
        maps=[_map(table, png, surveyed) for table, png in zip(maps, map_pictures, strict=True)],
        range_sigma_m=range_sigma_m,
        interior=_interior(interior) if interior else None,
        certificates=[
            from_plain(Certificate, each, str(certificate))
            for each in storage.read_json(certificate)["certificates"]
        ]
        if certificate
        else [],
        methods=_optional(methods_csv),
        methods_png=for_page(methods_png) if methods_png else b"",
        field_table=_optional(field_table),
        field_pictures={
            sample: for_page(png) for sample, png in zip(field_samples, field_pictures, strict=True)
        },
        unsurveyed_units=[
            report.UnsurveyedUnit(name, _frame(csv), for_page(png))
            for name, csv, png in zip(unsurveyed_units, unit_tables, unit_pictures, strict=True)
        ],
        unit_drifts=dict(zip(timed_units, map(for_page, drift_pictures), strict=True)),
        outdoor=_optional(outdoor),
        outdoor_figures=[
            report.OutdoorFigure(number, kind, on, _frame(csv), for_page(png))
            for (number, (kind, on)), png, csv in zip(
                outdoor_figures.items(), outdoor_pictures, outdoor_numbers, strict=True
            )
        ],
    )
    storage.write_text(report_html, report.render(study))


if "snakemake" in globals():
    run(main, snakemake)
