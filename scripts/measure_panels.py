"""Fit planes to the panels of an outdoor recording, with every calibration."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from velocal import outdoor, storage
from velocal.calibration_files import formats
from velocal.errors import reported
from velocal.field import Cloud
from velocal.recording.identify import check_scanner
from velocal.recording.rotations import inspect
from velocal.recording.windows import window_rotations
from velocal.returns import read_returns
from velocal.scans import first_rotations
from velocal.sensors import scanner_named


def main(
    recording: Path,
    calibration: Path | None,
    sets: list[Path],
    ledger: Path,
    panels: Path,
    *,
    sample: Mapping[str, Any],
    boxes: Mapping[str, Any],
    fit: Mapping[str, float],
) -> None:
    """Write the ledger as JSON and the standard deviations of s as CSV."""
    known = scanner_named(sample["scanner"])
    found = inspect(recording)
    said = {"scanner": known.name, "remarks": check_scanner(found, known, str(recording))}
    rotations = window_rotations(found.index, "all", None, str(recording))
    factory = formats.read_or_nominal(calibration, known)
    columns = read_returns(recording, found.index, rotations, known)
    shots = first_rotations(columns, len(rotations))
    cloud = Cloud.of_medians(shots, known, found.index.rate_hz(rotations), factory)
    others = {path.stem: formats.read(path, known.n_lasers) for path in sets}
    place = outdoor.Panels.from_config(sample["distance_m"], sample["azimuth_deg"], boxes, fit)
    planes = outdoor.fit_panels(cloud, place, outdoor.search(fit), f"sample {sample['name']!r}")
    heading = {key: sample[key] for key in ("kind", "scanner")} | {"sample": sample["name"]}
    rows = [
        heading | row
        for row in outdoor.panel_rows(cloud, planes, {outdoor.BEFORE: factory} | others)
    ]
    storage.write_csv(panels, pd.DataFrame(rows))
    storage.write_json(ledger, {"file": recording.name, **said, **found.as_dict()})


if "snakemake" in globals():
    with reported(snakemake.log[0]):
        main(
            Path(snakemake.input.recording),
            Path(c) if (c := snakemake.input.calibration) else None,
            [Path(path) for path in snakemake.input.sets],
            Path(snakemake.output.ledger),
            Path(snakemake.output.panels),
            sample=snakemake.params.sample,
            boxes=snakemake.params.panels,
            fit=snakemake.params.fit,
        )
