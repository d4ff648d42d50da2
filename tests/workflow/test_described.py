"""A study of a scanner that a YAML file describes: what its rules read, make and record.

Jobs run in this process, as `support.in_process` tells.
"""

import copy
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from support import clouds
from support.in_process import Rules
from support.kitti import street_scan
from support.running import copy_project
from typer.testing import CliRunner

from velocal.calibration.files import formats
from velocal.chain import points_of
from velocal.cli import app
from velocal.errors import CalibrationFileError
from velocal.evaluation.unsurveyed import Seen, adjust_unsurveyed, unsurveyed_settings
from velocal.io import storage
from velocal.io.schemas import MEDIANS, MEMBERS, RESIDUAL_MAP
from velocal.scanner.beam import Beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.study.scanner_file import read_scanner

pytestmark = pytest.mark.workflow

KNOWN = SCANNERS["VLP-16"]
#: The same scanner under another name; its lasers have no firing times.
DESCRIPTION = {
    "name": "COPY-16",
    "lasers": 16,
    "vertical_deg": np.rad2deg(KNOWN.vertical_rad).tolist(),
    "vertical_offset_m": KNOWN.vertical_offset_m.tolist(),
    "azimuth_bin_deg": 4.0,
    "range_sigma_m": KNOWN.range_sigma_m,
    "max_range_m": KNOWN.max_range_m,
}
NAMES = ("copy", "known")
#: Fronts of houses on the right and behind, and the road.
BOXES = {
    "right": {"x_m": [4, 9], "y_m": [-6, 11], "z_m": [-1.2, 5]},
    "back": {"x_m": [-2, 5], "y_m": [-11.5, -10.5], "z_m": [-1.2, 5]},
    "road": {"x_m": [-8, 8], "y_m": [-8, 11], "z_m": [-2.2, -1.4]},
}
HEADING = "sample\tscanner\trecording\tcalibration\tdialect\tframe\n"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Rules of one cloud, whose scanner is named by a file in one row and by name in the other."""
    folder = copy_project(tmp_path_factory.mktemp("described") / "project")
    used = nominal(KNOWN)
    dl = np.random.default_rng(4).normal(0.0, 0.02, len(used))
    # The turn of all lasers puts their shots into the middle of azimuth bins of 4 degrees.
    true = replace(used, dl=dl, alpha=used.alpha + np.deg2rad(2.0))
    scan, laser = street_scan(true, used, sigma_m=0.01, columns=90)
    columns = dict(zip(("x", "y", "z", "intensity"), scan.T, strict=True))
    (folder / "cloud.pcd").write_bytes(clouds.pcd(columns | {"channel": laser.astype("u1")}))
    (folder / "copy.yaml").write_text(yaml.safe_dump(DESCRIPTION))
    rows = (f"{name}\t{scanner}\tcloud.pcd\tnominal\tpaper\tros\n"
            for name, scanner in (("copy", "copy.yaml"), ("known", "VLP-16")))  # fmt: skip
    (folder / "samples.tsv").write_text(HEADING + "".join(rows))
    config = {
        "study": "A copy", "results": "results",
        "reduction": {"min_count": 1, "azimuth_bin_deg": {"VLP-16": 4.0}},
        "unsurveyed": {
            "samples": "samples.tsv", "recordings": ".",
            "calibrations": {"COPY-16": {"copy": ["copy"]}},
            "patches": dict.fromkeys(NAMES, BOXES),
            "judged": {"names": ["copy/back"]},
            "search": {"planes": 3, "distance_cm": 8, "extent_m": 40, "min_points": 20,
                       "incidence_deg": 84, "seed": 1},
        },
    }  # fmt: skip
    here = Path.cwd()
    os.chdir(folder)
    yield folder, config, Rules(folder, copy.deepcopy(config)), dl
    os.chdir(here)


def test_a_copy_of_a_known_scanner_gives_its_numbers(study):
    """The azimuths of the known one are those of its firing times, in ticks of their own."""
    folder, _, rules, dl = study
    rules.make("results/calibrations/COPY-16/copy.csv")
    copied = pd.read_csv("results/calibrations/COPY-16/copy.csv")
    for kind in ("medians/known/all.parquet", "field/known/planes.parquet"):
        rules.make(f"results/{kind}")
    columns, facts = storage.read_table(folder / "results/medians/known/all.parquet", MEDIANS)
    own, said = storage.read_table(folder / "results/field/known/planes.parquet", MEMBERS)
    cloud = points_of(Beams.from_ticks(columns, KNOWN, facts["rotation_rate_hz"]), nominal(KNOWN))
    seen = Seen.of_members("known", cloud, own["row"], own["plane"], said["planes"])
    settings = unsurveyed_settings(KNOWN, nominal(KNOWN))
    known = adjust_unsurveyed([seen.without([("known", "back")])], settings).calibration
    lasers = known.observed
    moved = (copied["dl_correction_m"] - known.corrections[:, 0])[lasers]
    assert lasers.sum() >= 10
    # A small part of what either is known to, relative to the mean that nobody sees.
    assert np.std(moved) < 0.3 * copied["dl_relative_std"].median()
    left = (dl - copied["dl_correction_m"])[lasers]
    assert np.std(left) < 0.5 * np.std(dl[lasers])


def test_its_calibration_file_can_be_read(study):
    folder, _, rules, _ = study
    path = "results/parameter_sets/COPY-16/copy.json"
    rules.make(path)
    assert formats.read_for(Path(path), read_scanner(folder / "copy.yaml")).scanner == "COPY-16"
    for command in (["show"], ["lint"]):
        done = CliRunner().invoke(app, ["calibration", *command, path, "--scanner", "copy.yaml"])
        assert done.exit_code == 0, done.output
    done = CliRunner().invoke(app, ["calibration", "show", path])
    assert isinstance(done.exception, CalibrationFileError)
    assert "unknown scanner 'COPY-16'" in str(done.exception)
    assert "name that file as the scanner" in str(done.exception)


def test_the_file_is_an_input_whose_content_counts(study):
    folder, config, rules, _ = study
    jobs = [rules.job(rule, sample="copy") for rule in ("read_cloud", "fit_field_planes")]
    jobs.append(rules.job("adjust_unsurveyed", scanner="COPY-16", unit="copy"))
    jobs.append(rules.job("write_certificate"))
    text = (folder / "copy.yaml").read_text()
    (folder / "copy.yaml").write_text(text.replace("max_range_m: 100.0", "max_range_m: 90.0"))
    after = Rules(folder, copy.deepcopy(config))
    for job in jobs:
        assert "copy.yaml" in [str(path) for path in job.input]
        again = after.job(job.rule, **dict(job.wildcards.items()))
        assert job.given()["given"] != again.given()["given"]
    (folder / "copy.yaml").write_text(text)


def test_residuals_are_mapped_on_planes_used_and_judged(study):
    """About planes that are fitted to the points of each calibration, as hold-out does."""
    rules = study[2]
    rules.make("results/residual_maps/copy.parquet")
    columns, facts = storage.read_table(Path("results/residual_maps/copy.parquet"), RESIDUAL_MAP)
    assert facts["planes"] == ["right", "back (judged)", "road"]
    assert facts["after"] == "copy"
    # One median a bin.
    assert set(columns["count"]) == {1}
    judged = columns["plane"] == 1
    held_out = pd.read_csv("results/calibrations/COPY-16/copy.hold_out.csv")
    for when in ("before", "after"):
        found = np.std(columns[f"{when}_m"][judged]) * 100.0
        assert found == pytest.approx(held_out[f"total_{when}_cm"][0], rel=1e-3)
        for plane in range(3):
            own = columns[f"{when}_m"][columns["plane"] == plane]
            assert abs(own.mean()) < 2e-3


def test_report_and_certificate(study):
    rules = study[2]
    rules.make("results/report.html")
    files = {
        each["scanner"]: [file["name"] for file in each["files"]]
        for each in json.loads(Path("results/certificate.json").read_text())["certificates"]
    }
    assert files == {"COPY-16": ["cloud.pcd", "copy.yaml"]}
    report = Path("results/report.html").read_text()
    assert "COPY-16/copy" in report
    assert 'class="map" data-sample="copy"' in report
