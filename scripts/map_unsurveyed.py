"""Residuals of a sample without a survey along the azimuth, before and after its calibration."""

from pathlib import Path

import numpy as np

from velocal.calibration.files import formats
from velocal.chain import points_of
from velocal.evaluation.holdout import JudgedCalibration
from velocal.evaluation.residual_map import map_without_survey
from velocal.evaluation.unsurveyed import Seen
from velocal.io import schemas, storage
from velocal.io.plain import from_plain
from velocal.io.scripts import for_each, run
from velocal.reporting.figures.residual_map import residual_images
from velocal.reporting.style import save
from velocal.scanner.beam import Beams
from velocal.study.scanner_file import scanner_of


@for_each(
    "medians", "members", "calibration", "description", "judged", "residuals", "svg", "png",
    "sample", "scanner", "after", "sigma_cm",
)  # fmt: skip
def main(
    *,
    medians: Path,
    members: Path,
    calibration: Path | None,
    description: Path | None,
    judged: Path,
    residuals: Path,
    svg: Path,
    png: Path,
    sample: str,
    scanner: str,
    after: str,
    near_points: bool,
    sigma_cm: float,
) -> None:
    """Write mean residuals per laser, plane and bin of angle, and their picture.

    `judged` is the calibration `after`. Planes on which nothing was adjusted are named so.
    """
    known = scanner_of(description or scanner)
    factory = formats.read_or_nominal(calibration, known)
    columns, facts = storage.read_table(medians, schemas.MEDIANS)
    cloud = points_of(
        Beams.from_ticks(columns, known, facts["rotation_rate_hz"]), factory, near_points
    )
    on_planes, names = storage.read_table(members, schemas.MEMBERS)
    seen = Seen.of_members(sample, cloud, on_planes["row"], on_planes["plane"], names["planes"])
    unit = from_plain(JudgedCalibration, storage.read_json(judged), str(judged)).unit
    used = {(each.name, plane.name) for each in unit.stations for plane in each.planes}
    planes = [name if (sample, name) in used else f"{name} (judged)" for _, name in seen.keys]
    found = map_without_survey(seen, unit.calibration.adjusted)
    said = {"scanner": scanner, "sample": sample, "position": "", "after": after}
    storage.write_table(residuals, schemas.RESIDUAL_MAP, vars(found), planes=planes, **said)
    order = np.argsort(factory.v, kind="stable").tolist()
    title = f"{sample}, {scanner}: s with the factory's values and with {after}"
    figure = residual_images(found, planes, order, title, sigma_cm * 1e-2, simulated=False)
    save(figure, svg, png)


if "snakemake" in globals():
    run(main, snakemake)
