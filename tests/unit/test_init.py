"""The folder that `velocal init` writes."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from velocal.cli import app
from velocal.errors import ConfigError
from velocal.recording.recording import open_recording
from velocal.reduction.assignment import Limits
from velocal.scanner.models import SCANNERS
from velocal.study import shipped as shipped_files
from velocal.study.adjustment import Adjustment
from velocal.study.config import StudyConfig
from velocal.study.files import check_files
from velocal.study.reading import read_yaml
from velocal.study.schema import keys
from velocal.study.study import read_study
from velocal.survey.files import check_survey
from velocal.survey.targets import read_targets

GROUPS = {"planes": "plane", "base_scanner": "scanner", "base_field": "position"}
#: Keys that a study of one's own has no use for.
NOT_WRITTEN = {"simulation", "runs", "compare_with_paper", "unsurveyed", "by_scanner", "outdoor"}
#: A surveyor who hands over observations finds them in config/README.md.
NOT_WRITTEN |= {"observations"}
#: The adjustment of single windows, as in the paper.
NOT_WRITTEN |= {"adjustment"}
#: Parameters and priors besides those that are adjusted at first, and choices of figures.
OPTIONAL = {"voff_cm", "hoff_cm", "scale_cm_per_m", "laser"}
#: Keys of the map.
OPTIONAL |= {"set", "sections", "x_m", "y_m", "z_m"}


def init(folder, *arguments):
    return CliRunner().invoke(app, ["init", str(folder), *map(str, arguments)])


@pytest.mark.parametrize("positions", [1, 2, 5])
@pytest.mark.parametrize("scanner", SCANNERS)
def test_untouched_it_is_a_valid_study(scanner, positions, tmp_path, monkeypatch):
    done = init(tmp_path / "new/study", "--scanner", scanner, "--positions", positions)
    assert done.exit_code == 0, done.output
    monkeypatch.chdir(tmp_path / "new/study")
    config = read_yaml(tmp_path / "new/study/config.yaml")
    study = read_study(config, "config")
    assert study.scanners == [scanner]
    assert len(study.surveyed) == len(study.positions) == positions
    # What `velocal.calibrate` takes where it is given no settings.
    assert study.adjustment(scanner) == Adjustment.recommended(SCANNERS[scanner])
    assert study.assignment.limits.metric() == Limits()


@pytest.mark.parametrize("scanner", SCANNERS)
def test_untouched_it_is_a_valid_study_without_a_survey(scanner, tmp_path, monkeypatch):
    capture = tmp_path / "walls.pcap"
    capture.write_bytes(b"")
    for name, arguments in (("a", ["--no-survey"]), ("b", ["--recording", capture])):
        done = init(tmp_path / name, "--scanner", scanner, *arguments)
        assert done.exit_code == 0, done.output
        assert "velocal run --cores 2" in done.output
        monkeypatch.chdir(tmp_path / name)
        study = read_study(read_yaml(tmp_path / name / "config.yaml"), "config")
        assert study.calibration_names == [(scanner, "all")]
        assert not study.surveyed
    assert [sample.recording for sample in study.unsurveyed.values()] == [str(capture)]


def test_a_missing_capture_is_told(tmp_path):
    done = init(tmp_path / "s", "--recording", tmp_path / "none.pcap")
    assert "none.pcap: there is no such file" in str(done.exception)
    assert not (tmp_path / "s").exists()


def test_next_steps_are_told(tmp_path):
    done = init(tmp_path / "s", "--scanner", "HDL-64E")
    for part in ("1. ", "2. ", "3. ", "velocal run --cores", "factory.xml", "report.html"):
        assert part in done.output


def test_every_key_is_there_with_a_comment(tmp_path):
    init(tmp_path / "s", "--positions", "2")
    text = (tmp_path / "s/config.yaml").read_text()
    for key, _ in keys(StudyConfig):
        names = [name for name in key.split(".") if not re.match(r'[{"]', name)]
        if not set(names) & NOT_WRITTEN and names[-1] not in OPTIONAL:
            assert re.search(rf"\b{names[-1]}\b.*", text), key
    for line in text.splitlines():
        assert (
            "#" in line
            or line.endswith(":")
            or not line.strip()
            or " samples: [" in line
            or "all: [" in line
        ), line
        assert len(line) <= 110


@pytest.mark.parametrize("name", GROUPS)
def test_survey_templates_hold_examples_in_comments(name, tmp_path):
    init(tmp_path / "s", "--scanner", "HDL-32E")
    path = tmp_path / f"s/survey/{name}.csv"
    assert len(read_targets(path, GROUPS[name]).name) == 0
    text = path.read_text()
    examples = re.findall(r"^# (\S+,\S+,.*)$", text, flags=re.MULTILINE)
    path.write_text(text + "\n".join(examples) + "\n")
    assert len(read_targets(path, GROUPS[name]).name) == len(examples) >= 3


def base_examples(scanner, tmp_path):
    init(tmp_path / scanner, "--scanner", scanner)
    text = (tmp_path / scanner / "survey/base_scanner.csv").read_text()
    return text, re.findall(r"^# (B\d,.*)$", text, flags=re.MULTILINE)


@pytest.mark.parametrize("scanner", SCANNERS)
def test_the_sheet_says_where_the_origin_is(scanner, tmp_path):
    text, examples = base_examples(scanner, tmp_path)
    height = SCANNERS[scanner].origin_height_m
    assert (f"{height * 1000:g} mm ABOVE the bottom" in text) == (height > 0.0)
    assert float(examples[0].split(",")[4]) == pytest.approx(-height, abs=6e-4)  # rounded to 1 mm


def test_the_examples_are_one_base(tmp_path):
    """The same distances between the targets in both frames, to a few millimetres."""
    _, of_scanner = base_examples("HDL-32E", tmp_path)
    text = (tmp_path / "HDL-32E/survey/base_field.csv").read_text()
    of_site = re.findall(r"^# (B\d,.*)$", text, flags=re.MULTILINE)
    sizes = []
    for rows in (of_scanner, of_site):
        xyz = np.array([[float(cell) for cell in row.split(",")[2:5]] for row in rows])
        sizes.append(np.linalg.norm(xyz - np.roll(xyz, 1, axis=0), axis=1))
    assert np.abs(sizes[0] - sizes[1]).max() < 0.003


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "samples.tsv").write_text("mine")
    done = init(tmp_path)
    assert done.exit_code == 1
    assert "samples.tsv: exists already" in str(done.exception)
    assert "Hint:" in str(done.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["samples.tsv"]
    assert (tmp_path / "samples.tsv").read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--scanner", "HDL-65"], "allowed: HDL-64E"),
        (["--example", "--scanner", "HDL-64E"], "a scanner, captures and a survey of its own"),
    ],
)
def test_wrong_calls(arguments, message, tmp_path):
    done = init(tmp_path / "s", *arguments)
    assert message in str(done.exception)
    assert not (tmp_path / "s").exists()


def test_the_example_is_a_valid_study(tmp_path, monkeypatch):
    done = init(tmp_path / "e", "--example")
    assert done.exit_code == 0, done.output
    assert "SIMULATED" in done.output
    monkeypatch.chdir(tmp_path / "e")
    study = read_study(read_yaml(tmp_path / "e/config.yaml"), "config")
    check_files(study, "config")
    check_survey(study)
    assert "simulated" in study.config.study
    assert len(study.positions) == 2
    files = [path for path in (tmp_path / "e").rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 5e6
    for sample in study.surveyed.values():
        found = open_recording(sample.recording, sample.scanner).scan()
        assert found.ledger.unaccounted_bytes == 0
        assert not found.ledger.rejected


def test_a_file_that_was_not_installed(monkeypatch):
    monkeypatch.setattr(shipped_files, "PLACES", ())
    with pytest.raises(ConfigError, match="Hint: The installation is not complete"):
        shipped_files.shipped("workflow/Snakefile")
