"""Scanners that a YAML file describes: what is read, and one clear message for every fault."""

import os
from pathlib import Path

import numpy as np
import pytest
from support.example import DESCRIBED
from typer.testing import CliRunner

from velocal.cli import app
from velocal.errors import ConfigError
from velocal.scanner.models import SCANNERS, Family
from velocal.study.files import check_files, given_files
from velocal.study.reading import read_yaml
from velocal.study.samples import SurveyedSample, read_samples
from velocal.study.scanner_file import read_scanner, scanner_of
from velocal.study.study import read_study


def described(folder, *changes):
    text = DESCRIBED
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "scanner.yaml"
    path.write_text(text)
    return path


def test_it_is_a_scanner(tmp_path):
    found = scanner_of(str(described(tmp_path)))
    assert (found.name, found.n_lasers, found.lasers_per_firing) == ("ACME-4", 4, 4)
    assert (found.family, found.flags, found.sends_status) == (Family.DESCRIBED, (), False)
    np.testing.assert_allclose(np.rad2deg(found.vertical_rad), [-9, -3, 3, 9])
    assert not found.horizontal_offset_m.any()
    assert found.azimuth_bin(None) == 20
    assert scanner_of("VLP-16") is SCANNERS["VLP-16"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("lasers: 4", "lasers: 5", "vertical_deg: 4 values (allowed: 5, one a laser)"),
        ("lasers: 4", "lasers: 1000", "lasers: 1000"),
        ("name: ACME-4", "name: VLP-16", "'VLP-16' is known already"),
        ("name: ACME-4", "name: ../x", "is not a name"),
        ("-9,", "-91,", "vertical_deg.0: -91"),
        ("azimuth_bin_deg: 0.2", "azimuth_bin_deg: 0.7", "0.7 does not divide the turn"),
        ("azimuth_bin_deg: 0.2", "azimuth_bin_deg: 0.001", "0.001 does not divide the turn"),
        ("azimuth_bin_deg: 0.2\n", "", "key 'azimuth_bin_deg' is missing"),
        ("max_range_m: 100", "max_range_m: 200", "200 m in ticks of 0.002 m"),
        ("max_range_m: 100", "maximal_range_m: 100", "Did you mean 'max_range_m'?"),
        ("range_sigma_m: 0.02", "range_sigma_m: -1", "range_sigma_m: -1"),
        ("name: ACME-4", "name: [", "is not YAML"),
    ],
)
def test_a_fault_is_one_message(old, new, message, tmp_path):
    path = described(tmp_path, (old, new))
    with pytest.raises(ConfigError) as caught:
        read_scanner(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        scanner_of(str(tmp_path / "gone.yaml"))


HEADING = "sample\tscanner\trecording\tcalibration\tdialect\n"
WITHOUT_SURVEY = {
    "study": "Clouds", "results": "results", "reduction": {"min_count": 1},
    "unsurveyed": {
        "samples": "samples.tsv", "recordings": "clouds",
        "calibrations": {"ACME-4": {"all": ["a"]}},
        "search": {"planes": 3, "distance_cm": 6, "extent_m": 4, "min_points": 100,
                   "incidence_deg": 70, "seed": 1},
    },
}  # fmt: skip
ROW = "a\tacme.yaml\ta.pcd\tnominal\tpaper\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Folder of a study of a cloud, whose scanner a file describes."""
    (tmp_path / "acme.yaml").write_text(DESCRIBED)
    (tmp_path / "samples.tsv").write_text(HEADING + ROW)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_study_resolves_it_once(folder):
    study = read_study(WITHOUT_SURVEY | {"serials": {"ACME-4": "7"}}, "config")
    assert study.unsurveyed["a"].scanner == "ACME-4"
    assert study.scanner("ACME-4").n_lasers == 4
    assert study.scanner("VLP-16") is SCANNERS["VLP-16"]
    assert study.unsurveyed_sigma_cm("a") == pytest.approx(2.0)
    assert given_files(study)["acme.yaml"] == "description of scanner 'ACME-4'"


@pytest.mark.parametrize(
    ("rows", "parts"),
    [
        (ROW.replace("acme", "gone"), ["samples.tsv", "no file 'gone.yaml'", "VLP-16", "Hint: "]),
        (ROW.replace("acme", "wrong"), ["wrong.yaml", "4 values (allowed: 5", "Hint: "]),
        (ROW.replace("acme.yaml", "ACME-4"), ["unknown scanner 'ACME-4'", "a YAML file"]),
        (ROW + ROW.replace("a\tacme", "b\tother"), ["'other.yaml' and 'acme.yaml'", "Hint: "]),
        (ROW.replace("paper", ""), ["row 2", "packets are not read", "allowed: HDL-64E", "Hint: "]),
        (ROW.replace("acme.yaml", "VLP-16"), ["calibrations: no sample is of 'ACME-4'", "Hint: "]),
    ],
)  # fmt: skip
def test_a_fault_in_a_study_is_one_message(rows, parts, folder):
    (folder / "wrong.yaml").write_text(DESCRIBED.replace("lasers: 4", "lasers: 5"))
    (folder / "other.yaml").write_text(DESCRIBED)
    (folder / "samples.tsv").write_text(HEADING + rows)
    with pytest.raises(ConfigError) as caught:
        read_study(WITHOUT_SURVEY, "config")
    assert [part for part in parts if part not in str(caught.value)] == []


def test_a_survey_is_of_packets(folder):
    (folder / "surveyed.tsv").write_text(
        "sample\tscanner\trecording\tcalibration\tposition\na\tacme.yaml\ta.pcap\tnominal\tP1\n"
    )
    with pytest.raises(ConfigError, match=r"scanner: 'acme.yaml' describes .*\n*Hint: Only clouds"):
        read_samples(folder / "surveyed.tsv", SurveyedSample)


def test_init_writes_such_a_study(folder):
    (folder / "a.pcd").touch()
    given = ["init", "new", "--scanner", "acme.yaml", "--recording", "a.pcd"]
    refused = CliRunner().invoke(app, given)
    assert isinstance(refused.exception, ConfigError)
    assert "packets are not read" in str(refused.exception)
    done = CliRunner().invoke(app, [*given, "--dialect", "paper"])
    assert done.exit_code == 0, done.output
    os.chdir("new")
    study = read_study(read_yaml(Path("config.yaml")), "config")
    assert study.calibration_names == [("ACME-4", "all")]
    check_files(study, "config")
