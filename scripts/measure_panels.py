"""Fit planes to the panels of an outdoor recording, with every calibration."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal.calibration.files import formats
from velocal.evaluation.candidates import with_sets
from velocal.evaluation.panels import Panels, fit_panels, panel_rows
from velocal.evaluation.planes_in_data import Cloud, PlaneLimits
from velocal.io import storage
from velocal.io.scripts import run
from velocal.recording.returns import read_short
from velocal.scanner.beam import Beams
from velocal.scanner.models import scanner_named


def main(
    *,
    recording: Path,
    calibration: Path | None,
    sets: list[Path],
    ledger: Path,
    panels: Path,
    sample: Mapping[str, Any],
    parameter_sets: list[str],
    boxes: Mapping[str, Any],
    fit: Mapping[str, float],
) -> None:
    """Write the ledger as JSON and the root mean squares of s as CSV.

    Sets are the files of `parameter_sets` in order.
    """
    known = scanner_named(sample["scanner"])
    found, remarks, returns = read_short(recording, known)
    factory = formats.read_or_nominal(calibration, known)
    cloud = Cloud.from_beams(Beams.from_ticks(returns, known, found.index.rate_hz()), factory)
    parameters = [formats.read(path, known.n_lasers) for path in sets]
    candidates = with_sets(factory, dict(zip(parameter_sets, parameters, strict=True)))
    place = Panels.from_config(sample["distance_m"], sample["azimuth_deg"], boxes, fit)
    limits = PlaneLimits.from_config(fit)
    planes = fit_panels(cloud, place, limits, f"sample {sample['name']!r}")
    heading = {key: sample[key] for key in ("kind", "scanner")} | {"sample": sample["name"]}
    rows = [heading | row for row in panel_rows(cloud, planes, candidates)]
    storage.write_csv(panels, pd.DataFrame(rows))
    facts = {"file": recording.name, "scanner": known.name, **found.as_dict(), "remarks": remarks}
    storage.write_json(ledger, facts)


if "snakemake" in globals():
    run(main, snakemake)
