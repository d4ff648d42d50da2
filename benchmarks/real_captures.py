"""Calibrations of real scanners without a survey, judged on planes that were left out.

Usage: python benchmarks/real_captures.py [--write]

Every plane of the captures in config/unsurveyed.yaml is left out once: the unit is adjusted on the
other planes, and the plane is fitted again to its corrected points. The captures are read from
the folder `recordings` in VELOCAL_SHARED. Where planes are searched, several seeds show what the
choice of the planes matters. `--write` writes the tables into docs/field.md.
"""

import argparse
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from velocal.evaluation.plane_search import find_planes
from velocal.evaluation.planes_in_data import Cloud, FieldPlane, Search, fit_patches
from velocal.evaluation.unsurveyed import (
    LeftOut,
    Seen,
    Spread,
    divisions,
    leave_out,
    unsurveyed_settings,
)
from velocal.geometry.planes import fit_plane
from velocal.io.markup import inserted, markdown_table
from velocal.recording.recording import open_recording
from velocal.scanner.models import scanner_named
from velocal.scanner.parameters import nominal
from velocal.study.config import StudyConfig, Unsurveyed
from velocal.study.model import validated
from velocal.study.planes import PlaneSearch
from velocal.study.reading import read_yaml
from velocal.study.samples import UnsurveyedSample, read_samples

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "config/unsurveyed.yaml"
DOC = ROOT / "docs/field.md"
#: Seeds of the search for planes; the first is the configured one.
SEEDS = (1, 2, 3, 4)


def configured() -> tuple[StudyConfig, Unsurveyed]:
    """The configuration of the captures, and its section on them."""
    config = validated(StudyConfig, read_yaml(CONFIG), str(CONFIG))
    assert config.unsurveyed is not None
    return config, config.unsurveyed


def samples() -> dict[str, UnsurveyedSample]:
    """The captures by name, all with nominal values."""
    return read_samples(ROOT / configured()[1].samples, UnsurveyedSample)


def cloud_of(sample: UnsurveyedSample, folder: Path) -> Cloud:
    """Medians of a whole capture as points with nominal values."""
    reduction = configured()[0].reduction
    recording = open_recording(folder / sample.recording, sample.scanner)
    medians = recording.medians(
        "all",
        azimuth_bin_deg=reduction.azimuth_bin_deg.get(sample.scanner),
        min_count=reduction.min_count,
    )
    return Cloud.from_beams(medians, nominal(recording.scanner))


def planes_of(name: str, cloud: Cloud, search: PlaneSearch | None = None) -> list[FieldPlane]:
    """Planes of a capture: in its boxes, or found with the configured or another search."""
    unsurveyed = configured()[1]
    limits = Search.from_config(search or unsurveyed.search)
    if name in unsurveyed.patches:
        return fit_patches(cloud, unsurveyed.patches[name], limits)[0]
    return find_planes(cloud, limits)[0]


def left_out(sample: UnsurveyedSample, cloud: Cloud, planes: Sequence[FieldPlane]) -> LeftOut:
    """Leave out every plane of a capture once."""
    settings = unsurveyed_settings(scanner_named(sample.scanner), cloud.parameters)
    seen = Seen("recording", cloud, tuple(planes))
    return leave_out([seen], divisions([seen]), settings)


def row(spread: Spread) -> list[str]:
    """Before, after, within the lasers, gain and its interval, centimetres."""
    numbers = (spread.before_m, spread.after_m, spread.within_m, spread.gain_m)
    interval = f"{spread.low_m * 100:.2f} to {spread.high_m * 100:.2f}"
    return [*(f"{number * 100:.2f}" for number in numbers), interval]


def scaled_spread(cloud: Cloud, found: LeftOut) -> list[tuple[float, ...]]:
    """Share of the scale from data, and std of every plane with the scale held and applied, cm."""
    result: list[tuple[float, ...]] = []
    for one in found.planes:
        unit, row = one.unit, one.plane.rows
        if unit.range_scale is None:
            continue
        length = cloud.distance_m + unit.calibration.adjusted.dl[cloud.laser_id]
        more = unit.range_scale.change(length, cloud.laser_id, unit.mean_range_m)
        stds = []
        for change in (0.0, more):
            beams = replace(cloud, distance_m=cloud.distance_m + change)
            after = Cloud.from_beams(beams, unit.calibration.adjusted)
            stds.append(float(np.std(after.s(row, fit_plane(after.xyz[row]).plane))) * 1e2)
        seen = unit.calibration.observed
        result.append((float(np.median(unit.range_scale.determined[seen])) * 1e2, *stds))
    return result


def scale_row(name: str, cloud: Cloud, found: LeftOut) -> list[str]:
    """What the range scale would bring on the planes of a capture that were left out."""
    share, held, applied = np.array(scaled_spread(cloud, found)).T
    gains = ", ".join(f"{gain:.2f}" for gain in held - applied)
    means = (f"{each.mean():.2f}" for each in (held, applied))
    return [f"`{name}`", f"{share.min():.0f} to {share.max():.0f}", *means, gains]


def rows(name: str, found: LeftOut) -> list[list[str]]:
    """One row per plane, and one for their mean."""
    table = [
        [
            f"`{name}`",
            each.plane.name,
            f"{each.plane.range_m:.1f}",
            f"{np.rad2deg(each.plane.incidence_rad):.0f}",
            str(each.lasers),
            *row(each.spread),
        ]
        for each in found.planes
    ]
    return [*table, [f"`{name}`", "mean", "", "", "", *row(found.mean)]]


def tables(folder: Path) -> dict[str, str]:
    """Markdown of both tables, by the name of their marks."""
    by_plane, by_seed, by_scale = [], [], []
    for name, sample in samples().items():
        cloud = cloud_of(sample, folder)
        found = left_out(sample, cloud, planes_of(name, cloud))
        by_plane += rows(name, found)
        by_scale.append(scale_row(name, cloud, found))
        print(
            *(" | ".join(each) for each in [*rows(name, found), by_scale[-1]]), sep="\n", flush=True
        )
        if name in configured()[1].patches:
            continue
        for seed in SEEDS:
            search = configured()[1].search.model_copy(update={"seed": seed})
            if seed != configured()[1].search.seed:
                found = left_out(sample, cloud, planes_of(name, cloud, search))
            by_seed.append([f"`{name}`", str(seed), str(len(found.planes)), *row(found.mean)])
    change = ["before, cm", "after, cm", "within lasers, cm", "gain, cm", "95 %, cm"]
    plane = ["sample", "plane left out", "range, m", "incidence, deg", "lasers", *change]
    scale = [
        "sample",
        "share from data, %",
        "scale held, cm",
        "scale applied, cm",
        "gain by plane, cm",
    ]
    seeds = ["sample", "seed", "planes", *change]
    return {
        "real_captures": "\n".join(markdown_table(plane, by_plane, [False] * 2 + [True] * 8)),
        "real_captures_scale": "\n".join(markdown_table(scale, by_scale, [False] + [True] * 4)),
        "real_captures_seeds": "\n".join(markdown_table(seeds, by_seed, [False] + [True] * 7)),
    }


def main() -> None:
    """Print the tables, and write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    write = parser.parse_args().write
    folder = Path(os.environ.get("VELOCAL_SHARED") or ROOT.parent / "shared") / "recordings"
    text = DOC.read_text("utf-8")
    for name, table in tables(folder).items():
        print(table, end="\n\n")
        text = inserted(text, name, table)
    if write:
        DOC.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
