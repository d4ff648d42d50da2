"""Residuals of a sample along the azimuth, before and after the calibration of its scanner."""

from pathlib import Path

import numpy as np

from velocal.adjustment.observations import joined
from velocal.calibration.files import formats
from velocal.evaluation.candidates import Candidate, Role
from velocal.evaluation.residual_map import residual_map
from velocal.io import schemas, storage
from velocal.io.scripts import for_each, run
from velocal.reporting.figures.residual_map import residual_images
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.survey.station import read_station


@for_each(
    "assigned", "survey", "calibration", "adjusted", "residuals", "svg", "png", "sample", "scanner",
    "after", "is_unit", "sigma_cm",
)  # fmt: skip
def main(
    *,
    assigned: list[Path],
    survey: Path,
    calibration: Path | None,
    adjusted: Path,
    residuals: Path,
    svg: Path,
    png: Path,
    sample: str,
    scanner: str,
    after: str,
    is_unit: bool,
    near_points: bool,
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write mean residuals of all windows per laser, plane and bin of angle, and their picture.

    `adjusted` is the file of the calibration `after`.
    """
    known, station = scanner_named(scanner), read_station(survey)
    windows = [storage.read_table(path, schemas.ASSIGNED)[0] for path in assigned]
    data = joined([station.observations(columns) for columns in windows])
    factory = formats.read_or_nominal(calibration, known)
    before = Candidate(Role.FACTORY, factory, "", near_points)
    role = Role.UNIT if is_unit else Role.SET
    found = residual_map(
        data, before, Candidate(role, formats.read(adjusted, known.n_lasers), after)
    )
    planes = [plane.patch.name for plane in station.planes]
    facts = {"scanner": scanner, "sample": sample, "position": station.position, "after": after}
    storage.write_table(residuals, schemas.RESIDUAL_MAP, vars(found), planes=planes, **facts)
    order = np.argsort(factory.v, kind="stable").tolist()
    title = (
        f"{sample}, {scanner} at {station.position}: s with the factory's values and with {after}"
    )
    figure = residual_images(found, planes, order, title, sigma_cm * 1e-2, simulated=simulated)
    save(figure, svg, png)


if "snakemake" in globals():
    run(main, snakemake)
