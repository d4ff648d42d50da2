"""Calibrations of real scanners without a survey, judged on planes that were left out.

Usage: python benchmarks/real_captures.py [--seeds N] [--write]

Every plane of the captures in config/unsurveyed.yaml is left out once: the unit is adjusted on the
other planes, and the plane is fitted again to its corrected points. The captures are read from
the folder `recordings` in VELOCAL_SHARED. With `--seeds`, planes are searched with N seeds, to see
what the choice of planes matters. `--write` writes the tables into docs/field.md.
"""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from velocal.evaluation.plane_search import find_planes
from velocal.evaluation.planes_in_data import Cloud, FieldPlane, Search, fit_patches
from velocal.evaluation.unsurveyed import LeftOut, Spread, leave_one_plane_out, unsurveyed_settings
from velocal.io.markup import inserted, markdown_table
from velocal.recording.recording import open_recording
from velocal.scanner.models import scanner_named
from velocal.scanner.parameters import nominal
from velocal.study.config import StudyConfig, Unsurveyed
from velocal.study.model import read_yaml, validated
from velocal.study.planes import PlaneSearch
from velocal.study.samples import UnsurveyedSample, read_samples

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "config/unsurveyed.yaml"
DOC = ROOT / "docs/field.md"


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
    return leave_one_plane_out(cloud, planes, settings)


def row(spread: Spread) -> list[str]:
    """Before, after, gain and its interval, centimetres."""
    return [
        *(f"{x * 100:.2f}" for x in (spread.before_m, spread.after_m, spread.gain_m)),
        f"{spread.low_m * 100:.2f} to {spread.high_m * 100:.2f}",
    ]


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


def main() -> None:
    """Print, or write, the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=0)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    folder = Path(os.environ.get("VELOCAL_SHARED", ROOT.parent / "shared")) / "recordings"
    table, by_seed = [], []
    for name, sample in samples().items():
        cloud = cloud_of(sample, folder)
        table += rows(name, left_out(sample, cloud, planes_of(name, cloud)))
        if name in configured()[1].patches:
            continue
        for seed in range(1, given.seeds + 1):
            search = configured()[1].search.model_copy(update={"seed": seed})
            planes = planes_of(name, cloud, search)
            mean = left_out(sample, cloud, planes).mean
            by_seed.append([f"`{name}`", str(seed), str(len(planes)), *row(mean)])
    change = ["before, cm", "after, cm", "gain, cm", "95 %, cm"]
    headings = ["sample", "plane left out", "range, m", "incidence, deg", "lasers", *change]
    text = "\n".join(markdown_table(headings, table, [False] * 2 + [True] * 7))
    print(text)
    if by_seed:
        headings = ["sample", "seed", "planes", *change]
        print("\n" + "\n".join(markdown_table(headings, by_seed, [False] + [True] * 6)))
    if given.write:
        DOC.write_text(inserted(DOC.read_text("utf-8"), "real_captures", text), "utf-8")


if __name__ == "__main__":
    main()
