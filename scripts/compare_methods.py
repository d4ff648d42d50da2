"""Methods of adjustment side by side, on calibration data, another position and the truth."""

from pathlib import Path

import pandas as pd

from velocal.adjustment.observations import Observations
from velocal.adjustment.unit.settings import UnitSettings
from velocal.calibration.files import formats
from velocal.evaluation import methods
from velocal.io import schemas, storage
from velocal.io.scripts import run
from velocal.reporting.figures import methods as comparison
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.scanner.parameters import nominal
from velocal.study.adjustment import Adjustment
from velocal.survey.station import read_station


def main(
    *,
    assigned: list[Path],
    surveys: list[Path],
    calibration: Path | None,
    truth: Path | None,
    csv: Path,
    md: Path,
    svg: Path,
    png: Path,
    samples: list[str],
    positions: list[str],
    calibrate_on: list[str],
    check_on: list[str],
    scanner: str,
    adjustment: Adjustment,
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the comparison of what is calibrated on some samples and checked on others.

    `samples` and `positions` are those of every file of assigned medians.
    """
    stations = {station.position: station for station in map(read_station, surveys)}
    stood = dict(zip(samples, positions, strict=True))
    windows: dict[str, list[Observations]] = {sample: [] for sample in samples}
    for path, sample in zip(assigned, samples, strict=True):
        columns, _ = storage.read_table(path, schemas.ASSIGNED)
        windows[sample].append(stations[stood[sample]].observations(columns))
    known, other = (
        [
            methods.SampleData(
                stood[name],
                windows[name],
                stations[stood[name]].of_unit(windows[name][0]),
            )
            for name in names
        ]
        for names in (calibrate_on, check_on)
    )
    known_scanner = scanner_named(scanner)
    factory = formats.read_or_nominal(calibration, known_scanner)
    true = formats.read(truth, len(factory)) if truth else None
    stochastic, sigma_m = adjustment.stochastic(), sigma_cm * 1e-2
    rows = methods.compare(
        known,
        other,
        factory,
        stochastic,
        sigma_m,
        true,
        nominal(known_scanner),
        UnitSettings.recommended(known_scanner, factory=factory),
    )
    numbers = pd.DataFrame(rows)
    storage.write_csv(csv, numbers, digits=5)
    text = comparison.markdown(numbers, scanner, simulated=simulated)
    storage.write_text(md, text)
    figure = comparison.draw(numbers, scanner, simulated=simulated)
    save(figure, svg, png)


if "snakemake" in globals():
    run(main, snakemake)
