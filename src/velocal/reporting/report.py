"""The report: everything a study has found on one page of HTML that needs no network.

Every section is optional: a study without a survey has ledgers and planes found in the data only.
The page holds no time and no path of the machine, so that identical results give identical bytes.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from velocal.evaluation.candidates import IDENTITY
from velocal.evaluation.certificate import Certificate
from velocal.evaluation.residual_map import STEP_DEG, root_mean_square
from velocal.evaluation.statistics import COMPLIES
from velocal.geometry.rigid import RigidTransformation
from velocal.io import provenance
from velocal.paper import agreement
from velocal.paper.figures import figures as paper_figures
from velocal.paper.printed import CONTRADICTIONS, LABELS, READING, TOLERANCES, printed_rows
from velocal.paper.tables import DECIMALS, ROMAN, STATISTICS, build, formatted
from velocal.reporting.captions import caption, outdoor_caption
from velocal.reporting.figures import methods, panels
from velocal.reporting.interactive import Interior, SampleMap, payload
from velocal.reporting.templates import environment, fixed
from velocal.reporting.verdict import laser_note, verdict
from velocal.scanner.parameters import PARAMETERS, UNITS, LaserParameters
from velocal.study import figures
from velocal.survey.checks.findings import Finding

#: What the template of the page includes. A script is run again when a file that its modules name
#: changes, and these are named in a template only.
INCLUDED = ("lasers.html.j2", "report.css", "report.js")
#: Headings of the quantities of the tables.
QUANTITIES = {
    "std_cm": "Std [cm]",
    "within_1sigma_pct": "Within 1σ [%]",
    "within_3sigma_pct": "Within 3σ [%]",
}

#: Columns of the table of lasers.
LASER_HEADINGS = (
    "Laser", "dl [mm]", "U [mm]", "from data [%]", "alpha [deg]", "U [deg]", "from data [%]",
    "v [deg]", "U [deg]", "from data [%]", "Range [m]", "s before [mm]", "s after [mm]",
)  # fmt: skip

#: Unit for people, factor to it and decimals, by unit.
_SHOWN = {"m": ("cm", 100.0, 3), "rad": ("deg", 180.0 / np.pi, 4)}


@dataclass(frozen=True)
class Figure:
    """A figure of the study.

    Attributes
    ----------
    number : str
        As in the file's name.
    selection : figures.Figure
        Entry of the configuration.
    numbers : DataFrame
        What is plotted.
    png : bytes
        Picture.
    """

    number: str
    selection: figures.Figure
    numbers: pd.DataFrame
    png: bytes


@dataclass(frozen=True)
class OutdoorFigure:
    """A figure of the outdoor validation.

    Attributes
    ----------
    number : str
        As in the file's name.
    kind, scanner : str
        Conditions and scanner of its samples.
    numbers : DataFrame
        What is plotted.
    png : bytes
        Picture.
    """

    number: str
    kind: str
    scanner: str
    numbers: pd.DataFrame
    png: bytes


@dataclass(frozen=True)
class UnsurveyedUnit:
    """A calibration without a survey.

    Attributes
    ----------
    name : str
        Scanner and name of the calibration.
    more : DataFrame
        What one more plane would bring.
    png : bytes
        Picture of the corrections and of the planes that were left out.
    """

    name: str
    more: pd.DataFrame
    png: bytes


@dataclass(frozen=True)
class Study:
    """What a study has found; whatever is empty has no section.

    Attributes
    ----------
    title : str
    simulated : bool
        Whether the surveyed recordings are simulated.
    ledgers : mapping of str to mapping
        Ledger and rotations of every recording, by sample.
    tables : mapping of str to figures.Table
        Entries of the configuration, by Arabic number.
    summary, agreement : DataFrame or None
        Statistics of all windows; every printed entry with the reproduced one.
    claims : DataFrame or None
        Claims of the paper with their verdicts.
    unexpected : sequence of str
        What of the agreement is not as it was, a line each.
    figures : sequence of Figure
    surveys : sequence of mapping
        Pose and planes of every position, as `Station.to_json` gives them.
    warnings : sequence of Finding
        What the checks of the survey warn of.
    sets : mapping of str to mapping
        Columns of the parameter sets, by scanner and name.
    factories : mapping of str to LaserParameters
        The factory's parameters, by scanner.
    exports : mapping of (str, str) to DataFrame
        Files for programs and their proof, by scanner and parameter set.
    field_table : DataFrame or None
        Planes of the recordings without a survey.
    field_pictures : mapping of str to bytes
        PNG pictures of these recordings, by sample.
    unsurveyed_units : sequence of UnsurveyedUnit
        Calibrations without a survey.
    unit_drifts : mapping of str to bytes
        PNG pictures of the changes of distances over time, by scanner and name of a calibration.
    certificates : sequence of Certificate
        Of the calibrations of units.
    range_sigma_m : mapping of str to float
        Standard deviation of a distance in the datasheet, by scanner of a certificate.
    maps : sequence of SampleMap
        Residuals of every surveyed sample along the azimuth.
    interior : Interior or None
        Points of the map of an interior.
    methods : DataFrame or None
        Numbers of the comparison of methods.
    methods_png : bytes
        Its picture.
    outdoor : DataFrame or None
        Means of the outdoor validation.
    outdoor_figures : sequence of OutdoorFigure
        Its figures.
    """

    title: str
    simulated: bool
    ledgers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    tables: Mapping[str, figures.Table] = field(default_factory=dict)
    summary: pd.DataFrame | None = None
    agreement: pd.DataFrame | None = None
    claims: pd.DataFrame | None = None
    unexpected: Sequence[str] = ()
    figures: Sequence[Figure] = ()
    surveys: Sequence[Mapping[str, Any]] = ()
    warnings: Sequence[Finding] = ()
    sets: Mapping[str, Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)
    exports: Mapping[tuple[str, str], pd.DataFrame] = field(default_factory=dict)
    factories: Mapping[str, LaserParameters] = field(default_factory=dict)
    field_table: pd.DataFrame | None = None
    field_pictures: Mapping[str, bytes] = field(default_factory=dict)
    unsurveyed_units: Sequence[UnsurveyedUnit] = ()
    unit_drifts: Mapping[str, bytes] = field(default_factory=dict)
    certificates: Sequence[Certificate] = ()
    range_sigma_m: Mapping[str, float] = field(default_factory=dict)
    maps: Sequence[SampleMap] = ()
    interior: Interior | None = None
    methods: pd.DataFrame | None = None
    methods_png: bytes = b""
    outdoor: pd.DataFrame | None = None
    outdoor_figures: Sequence[OutdoorFigure] = ()


def render(study: Study) -> str:
    """Write the page.

    Parameters
    ----------
    study : Study

    Returns
    -------
    str
        HTML.

    Raises
    ------
    VelocalError
        If a table asks for windows that the summary does not have.
    """
    cells = agreement.cells(study.agreement)
    content = {
        **vars(study),
        "overview": _overview(study.summary),
        "verdicts": [verdict(one, study.summary) for one in study.certificates],
        "lasers": [_lasers(one, study) for one in study.certificates],
        "step_deg": STEP_DEG,
        "payload": payload(study.maps, study.interior) if study.maps or study.interior else "",
        "agreement": agreement.counts(cells),
        "unexpected": study.unexpected,
        "statements": agreement.statements_of(cells),
        "claims": [] if study.claims is None else study.claims.to_dict(orient="records"),
        "cells": cells,
        "contradictions": CONTRADICTIONS,
        "tables": _tables(study, cells),
        "figures": [
            {
                "number": figure.number,
                "png": figure.png,
                "caption": caption(figure.selection, figure.numbers),
            }
            for figure in study.figures
        ],
        "outdoor_figures": [
            {
                "number": figure.number,
                "png": figure.png,
                "caption": outdoor_caption(figure.kind, figure.scanner, figure.numbers),
            }
            for figure in study.outdoor_figures
        ],
        "of_paper": paper_figures() if cells else (),
        "surveys": [_survey(survey) for survey in study.surveys],
        "sets": {
            scanner: {
                name: _parameters(columns, study.factories[scanner])
                for name, columns in sets.items()
            }
            for scanner, sets in study.sets.items()
        },
        "exports": {key: table.to_dict("records") for key, table in study.exports.items()},
        "methods": methods.section(study.methods),
        "outdoor": panels.section(study.outdoor),
        "field": _plain(study.field_table),
        "unsurveyed": [
            {"name": unit.name, "more": _plain(unit.more), "png": unit.png}
            for unit in study.unsurveyed_units
        ],
        "versions": provenance.versions(),
        "quantities": QUANTITIES,
        "tests": COMPLIES,
        "tolerances": TOLERANCES,
    }
    return environment().get_template("report.html.j2").render(content)


def _lasers(one: Certificate, study: Study) -> dict[str, Any]:
    """Table of the lasers of a calibration, and the maps of its samples."""
    on = {each.sample for each in one.recordings}
    maps = [each for each in study.maps if each.scanner == one.scanner and each.after == one.name]
    maps.sort(key=lambda each: each.sample not in on)
    n_lasers = len(one.lasers)
    rms = [np.full(n_lasers, np.nan)] * 2
    if maps:
        of = [each.residuals for each in maps]
        laser = np.concatenate([each.laser_id for each in of])
        rms = [
            root_mean_square(np.concatenate(values), laser, n_lasers)
            for values in ([each.before_m for each in of], [each.after_m for each in of])
        ]
    rows = [
        {
            "laser": row.laser,
            "note": laser_note(one, number),
            "cells": [
                fixed(row.dl_mm, 1), fixed(row.dl_expanded_mm, 1), fixed(row.dl_from_data, 0, 100),
                fixed(row.alpha_deg, 3), fixed(row.alpha_expanded_deg, 3),
                fixed(row.alpha_from_data, 0, 100),
                fixed(row.v_deg, 3), fixed(row.v_expanded_deg, 3), fixed(row.v_from_data, 0, 100),
                fixed(row.range_m, 1),
                *(fixed(float(each[number]), 1, 1e3) for each in rms),
            ],
        }
        for number, row in enumerate(one.lasers)
    ]  # fmt: skip
    # Calibrations without a survey have a section of their own, which shows the picture.
    unit = f"{one.scanner}/{one.name}"
    surveyed = unit not in {each.name for each in study.unsurveyed_units}
    factory = study.factories.get(one.scanner)
    order = np.arange(n_lasers) if factory is None else np.argsort(factory.v, kind="stable")
    return {
        "scanner": one.scanner,
        "name": one.name,
        "headings": LASER_HEADINGS,
        "rows": rows,
        "maps": maps,
        "order": order.tolist(),
        "drift": study.unit_drifts.get(unit, b"") if surveyed else b"",
        "limit_mm": 3e3 * study.range_sigma_m[one.scanner],
    }


def _plain(table: pd.DataFrame | None) -> dict[str, Any] | None:
    """Head and rows of any table, as they print."""
    if table is None or table.empty:
        return None
    return {
        "columns": [str(name).replace("_", " ") for name in table],
        "numeric": [bool(pd.api.types.is_numeric_dtype(table[name])) for name in table],
        "rows": [
            ["–" if pd.isna(cell) else f"{cell:.5g}" if isinstance(cell, float) else cell
             for cell in row]
            for row in table.astype(object).to_numpy().tolist()
        ],
    }  # fmt: skip


def _overview(summary: pd.DataFrame | None) -> list[dict[Hashable, Any]]:
    """Means over samples and windows, one row per scanner, data, role and set."""
    if summary is None:
        return []
    keys = ["scanner", "data", *IDENTITY]
    names = [*STATISTICS.values(), *COMPLIES, "lasers"]
    scanners = list(dict.fromkeys(summary["scanner"]))
    summary = summary.sort_values("scanner", key=lambda s: s.map(scanners.index), kind="stable")
    means = summary.groupby(keys, sort=False)[names].mean().reset_index()
    return means.to_dict(orient="records")


def _tables(study: Study, cells: Mapping[str, agreement.Cell]) -> list[dict[str, Any]]:
    """Tables with the paper's numbers beside ours, where there are any."""
    if study.summary is None:
        return []
    printed = {row.key: row for row in printed_rows()} if cells else {}
    result = []
    for number, selection in study.tables.items():
        table = build(number, selection, study.summary, simulated=study.simulated)
        rows = []
        for row in formatted(table.frame).to_dict(orient="records"):
            paper = printed.get(tuple(row[name] for name in LABELS))
            beside: dict[Hashable, Any] = {
                "label": paper.sample if paper and paper.sample != row["sample"] else "",
                "paper": {q: cells[paper.item(q)] for q in DECIMALS} if paper else None,
            }
            rows.append(row | beside)
        result.append(
            {
                **vars(table),
                # Only the study of the paper has tables with the paper's numbers.
                "heading": f"Table {table.number}"
                if cells
                else f"{selection.data.capitalize()} data, {selection.scanner}: "
                f"{', '.join(selection.samples)}",
                "rows": rows,
                "compared": any(row["paper"] for row in rows),
                "relabelled": any(key[0] == table.number for key in READING) and bool(cells),
                "file": f"tables/table_{number}.csv",
            }
        )
    return sorted(result, key=lambda table: list(ROMAN.values()).index(str(table["number"])))


def _survey(survey: Mapping[str, Any]) -> dict[str, Any]:
    """Pose and planes of a position with standard deviations, along the axes of the scanner."""
    names = ("rotation", "translation_m", "covariance_rad_m")
    pose = RigidTransformation(*(np.array(survey["pose"][name], dtype=float) for name in names))
    rotation = np.sqrt(np.diag(pose.covariance)[:3])
    return {
        **survey,
        "rotation_std_rad": rotation.tolist(),
        "origin_std_m": pose.origin_std_m().tolist(),
    }


def _parameters(columns: Mapping[str, Any], factory: LaserParameters) -> dict[str, Any]:
    """Corrections of a parameter set against the factory's, with standard deviations."""
    adjusted = [name for name in PARAMETERS if f"{name}_std_{UNITS[name]}" in columns]
    heads, values = [], []
    for name in adjusted:
        unit, factor, decimals = _SHOWN[UNITS[name]]
        heads.append({"name": name, "unit": unit})
        correction = np.asarray(columns[f"{name}_{UNITS[name]}"]) - getattr(factory, name)
        std = np.asarray(columns[f"{name}_std_{UNITS[name]}"], dtype=float)
        values.append(
            [
                (fixed(float(c), decimals, factor), fixed(float(s), decimals, factor))
                for c, s in zip(correction, std, strict=True)
            ]
        )
    lasers = [int(laser_id) + 1 for laser_id in columns["laser_id"]]
    return {"heads": heads, "rows": list(zip(lasers, zip(*values, strict=True), strict=True))}
