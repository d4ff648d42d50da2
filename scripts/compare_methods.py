"""Methods of adjustment side by side, on calibration data, another position and the truth."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal.adjustment import settings
from velocal.calibration.files import formats
from velocal.errors import reported
from velocal.evaluation import methods
from velocal.io import schemas, storage
from velocal.reporting.figures import methods as comparison
from velocal.reporting.style import save
from velocal.scanner.models import scanner_named
from velocal.survey.station import read_station


def main(
    assigned: list[Path],
    surveys: list[Path],
    calibration: Path | None,
    truth: Path | None,
    outputs: Mapping[str, Path],
    *,
    windows: list[str],
    samples: Mapping[str, Mapping[str, str]],
    scanner: str,
    adjustment: Mapping[str, Any],
    sigma_cm: float,
    simulated: bool,
) -> None:
    """Write the comparison.

    `windows` has the sample of every file of medians, and `samples` the positions of the samples
    to calibrate on and of others.
    """
    stations = {station.position: station for station in map(read_station, surveys)}
    of_sample: dict[str, list[Path]] = {}
    for sample, path in zip(windows, assigned, strict=True):
        of_sample.setdefault(sample, []).append(path)

    def data(sample: str, position: str) -> methods.SampleData:
        tables = [storage.read_table(path, schemas.ASSIGNED)[0] for path in of_sample[sample]]
        own = stations[position]
        return methods.SampleData(position, [own.observations(rows) for rows in tables])

    both = [[data(*item) for item in samples[kind].items()] for kind in ("calibration", "other")]
    factory = formats.read_or_nominal(calibration, scanner_named(scanner))
    true = formats.read(truth, len(factory)) if truth else None
    stochastic = settings.stochastic(adjustment)
    numbers = pd.DataFrame(methods.compare(*both, factory, stochastic, sigma_cm * 1e-2, true))
    storage.write_csv(outputs["csv"], numbers, digits=5)
    text = comparison.markdown(numbers, scanner, simulated=simulated)
    storage.write_text(outputs["md"], text)
    figure = comparison.draw(numbers, scanner, simulated=simulated)
    save(figure, outputs["svg"], outputs["png"])


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        found = snakemake.input
        main(
            *([Path(path) for path in files] for files in (found.assigned, found.surveys)),
            *(Path(path) if path else None for path in (found.calibration, found.truth)),
            {name: Path(path) for name, path in snakemake.output.items()},
            **{k: v for k, v in snakemake.params.items() if k != "library"},
        )
