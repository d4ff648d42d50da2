"""Fit planes to the panels of an outdoor recording, with every calibration."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np

from velocal.calibration.files import formats
from velocal.evaluation.candidates import with_sets
from velocal.evaluation.panels import Panels, fit_panels, panel_rows
from velocal.evaluation.planes_in_data import Cloud, PlaneLimits
from velocal.io import storage
from velocal.io.scripts import for_each, run
from velocal.recording.recording import open_recording
from velocal.scanner.models import scanner_named
from velocal.study.planes import Panel, PanelFit
from velocal.study.samples import OutdoorSample

#: All samples of a scanner have the same factory calibration, and are compared with the same sets.
_factory, _read = cache(formats.read_or_nominal), cache(formats.read)


@for_each("recording", "calibration", "sets", "ledger", "panels", "sample", "candidates", "units")
def main(
    *,
    recording: Path,
    calibration: Path | None,
    sets: list[Path],
    ledger: Path,
    panels: Path,
    sample: OutdoorSample,
    candidates: list[str],
    units: list[str],
    boxes: Mapping[str, Panel],
    fit: PanelFit,
    near_points: bool,
) -> None:
    """Write the ledger as JSON and the root mean squares of s as CSV.

    Sets are the files of `candidates` in order.
    """
    known = scanner_named(sample.scanner)
    opened = open_recording(recording, known)
    factory = _factory(calibration, known)
    parameters = [_read(path, known.n_lasers) for path in sets]
    sets_by_name = dict(zip(candidates, parameters, strict=True))
    compared = with_sets(factory, sets_by_name, units, near_points=near_points)
    place = Panels(sample.distance_m, float(np.deg2rad(sample.azimuth_deg)), boxes, fit.depth_m)
    beams = place.possible(opened.returns("all").beams(), factory)
    cloud = Cloud.from_beams(beams, factory)
    planes = fit_panels(cloud, place, PlaneLimits.from_fit(fit), f"sample {sample.name!r}")
    heading = {"kind": sample.kind, "scanner": sample.scanner, "sample": sample.name}
    rows = [heading | row for row in panel_rows(cloud, planes, compared)]
    # Not a table of pandas, whose import takes as long as several samples.
    storage.write_csv(panels, {name: [row[name] for row in rows] for name in rows[0]})
    facts = {"file": recording.name, "scanner": known.name, **opened.scan().as_dict()}
    storage.write_json(ledger, facts | {"remarks": opened.remarks})


if "snakemake" in globals():
    run(main, snakemake)
