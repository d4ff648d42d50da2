"""Fit planes to patches of a recording without a survey, given or found."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from velocal.calibration.files.formats import read_or_nominal
from velocal.chain import points_of
from velocal.evaluation.plane_search import find_planes
from velocal.evaluation.planes_in_data import Search, fit_patches, tabulate
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.reporting.figures.unsurveyed import field_planes
from velocal.reporting.style import save
from velocal.scanner.beam import Beams
from velocal.study.planes import Box, PlaneSearch
from velocal.study.scanner_file import scanner_of


def main(
    *,
    medians: Path,
    calibration: Path | None,
    description: Path | None,
    planes: Path,
    members: Path,
    lasers: Path,
    svg: Path,
    png: Path,
    sample: str,
    scanner: str,
    patches: Mapping[str, Box] | None,
    search: PlaneSearch,
    sigma_cm: float,
    near_points: bool,
) -> None:
    """Write planes, the medians on them, statistics of s per plane and laser, and a picture."""
    known = scanner_of(description or scanner)
    columns, facts = storage.read_table(medians, schemas.MEDIANS)
    parameters = read_or_nominal(calibration, known)
    beams = Beams.from_ticks(columns, known, facts["rotation_rate_hz"])
    cloud = points_of(beams, parameters, near_points)
    how = Search.from_config(search)
    found, findings = fit_patches(cloud, patches, how) if patches else find_planes(cloud, how)
    heading = {"sample": sample, "scanner": scanner}
    rows, statistics = tabulate(found, cloud, columns, heading, sigma_cm * 1e-2)
    facts |= {**heading, "calibration": calibration.name if calibration else "nominal"}
    facts |= {"medians": len(cloud.xyz), "sigma_cm": sigma_cm}
    storage.write_json(planes, {**facts, "findings": findings, "planes": rows})
    storage.write_csv(lasers, statistics)
    numbered = [np.full(len(plane.rows), number) for number, plane in enumerate(found)]
    on_planes = {
        "row": np.concatenate([np.empty(0), *(plane.rows for plane in found)]),
        "plane": np.concatenate([np.empty(0), *numbered]),
    }
    on_planes = {name: column.astype(np.int64) for name, column in on_planes.items()}
    names = [plane.name for plane in found]
    storage.write_table(members, schemas.MEMBERS, on_planes, planes=names)
    rows_of = {plane.name: plane.rows for plane in found}
    figure = field_planes(
        cloud.xyz, rows_of, pd.DataFrame(statistics), facts, findings, known.n_lasers
    )
    save(figure, svg, png)


if "snakemake" in globals():
    run(main, snakemake)
