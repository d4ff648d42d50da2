"""Configurations and sample tables: every fault is one message: where, and what is allowed."""

import copy
import os
import time

import pytest
import yaml

from velocal.errors import ConfigError
from velocal.scanner.models import SCANNERS
from velocal.simulation.world import check_world, load, read
from velocal.study.config import StudyConfig
from velocal.study.files import check_files, check_times, given_files
from velocal.study.model import validated
from velocal.study.reading import read_yaml
from velocal.study.samples import OutdoorSample, SurveyedSample, UnsurveyedSample, read_samples
from velocal.study.schema import FILES, keys, outputs
from velocal.study.study import read_study
from velocal.study.template import write_study
from velocal.study.world import WorldFile


@pytest.fixture
def config(root, monkeypatch):
    monkeypatch.chdir(root)
    return yaml.safe_load((root / "config/config.yaml").read_text())


def test_the_study_is_sound(config):
    study = read_study(config, "config")
    assert list(study.surveyed) == ["sa1", "sa2", "sa3", "sa4", "sa5", "sa6"]
    assert study.positions == {"P1": "HDL-64E", "P2": "HDL-64E", "P5": "HDL-32E", "P6": "HDL-32E"}
    assert study.surveyed["sa1"].windows == ("beginning", "middle", "end")
    check_files(study, "config")


def test_files_that_are_given(config):
    """Only the world: all other files of the study are made from it."""
    assert given_files(read_study(config, "config")) == {"config/world.yaml": "simulation.world"}


def test_a_result_with_a_time_in_the_future(tmp_path):
    check_times(tmp_path / "not there yet")
    path = tmp_path / "survey" / "x.csv"
    path.parent.mkdir()
    path.touch()
    check_times(tmp_path)
    os.utime(path, (time.time() + 100,) * 2)
    with pytest.raises(ConfigError, match=r"x.csv: its time is in the future: \d{4}-") as caught:
        check_times(tmp_path)
    assert f"find {tmp_path} -newermt now -delete" in str(caught.value.hint)


def test_every_scanner_is_calibrated(config):
    del config["parameter_sets"]["HDL-32E"]
    read_study(config, "config")
    del config["calibrations"]["HDL-32E"]
    with pytest.raises(ConfigError, match="neither calibrations nor parameter_sets has 'HDL-32E'"):
        read_study(config, "config")


def test_recordings_of_five_minutes_differ_in_the_time_and_the_folder_only(root, config):
    over = read_yaml(root / "config/five_minutes.yaml")
    assert over.keys() == {"study", "results", "simulation"}
    longer = config | over | {"simulation": config["simulation"] | over["simulation"]}
    study = read_study(longer, "config")
    check_files(study, "config")
    folder = study.config.folder
    assert folder != read_study(config, "config").config.folder
    assert study.observations.points == f"{folder}/simulation/survey/points.csv"
    assert study.surveyed["sa1"].recording == f"{folder}/simulation/recordings/sa1.bin"
    assert study.outdoor["ideal1"].calibration == f"{folder}/simulation/factory/HDL-64E.xml"
    unit = load(read_yaml(root / "config/world.yaml"))
    rate = unit.scanner("HDL-64E").rotation_rate_hz
    assert study.config.simulation.rotations / rate == unit.warmth.duration_s


def test_a_scanner_may_be_chosen_in_a_sample_table(root, config, tmp_path):
    rows = (root / config["samples"]).read_text().splitlines()
    heading, *samples = [row for row in rows if row and not row.startswith("#")]
    samples = [f"{row}\t\t" for row in samples]
    samples[0] = samples[0].rstrip("\t") + "\t2369\t192.168.1.202"
    samples[1] = samples[1].rstrip("\t") + "\t\t/left/velodyne_packets"
    sheet = tmp_path / "samples.tsv"
    sheet.write_text("\n".join([f"{heading}\tport\taddress", *samples]) + "\n")
    surveyed = read_study(config | {"samples": str(sheet)}, "config").surveyed
    chosen = [(sample.port, sample.address) for sample in surveyed.values()]
    assert chosen[:2] == [(2369, "192.168.1.202"), (None, "/left/velodyne_packets")]
    assert set(chosen[2:]) == {(None, None)}
    sheet.write_text(sheet.read_text().replace("2369", "x"))
    with pytest.raises(ConfigError, match="row 2: port"):
        read_study(config | {"samples": str(sheet)}, "config")


def changed(config, path, value):
    config = copy.deepcopy(config)
    place = config
    for key in path[:-1]:
        place = place[key]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return config


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("windws",), {}, "unknown key 'windws'"),
        (
            ("windows", "rotation"),
            3,
            r"unknown key 'windows.rotation' \(allowed: rotations, max_missing\)",
        ),
        (("windows", "rotations"), 0, "windows.rotations"),
        (("windows", "rotations"), "ten", "windows.rotations"),
        (("adjustment", "method"), "magic", r"'magic' \(allowed: prior, paper"),
        (("adjustment", "parameters"), ["dl", "beta"], "beta"),
        (("results",), "../elsewhere", "results"),
        (
            ("parameter_sets", "HDL-64E", "set1"),
            ["sa5"],
            "'sa5' is of 'HDL-32E', not of .*allowed: sa1",
        ),
        (("calibrations", "HDL-64E", "set1"), ["sa1"], "set1: a parameter set has this name"),
        (("calibrations", "HDL-64E", "unit"), ["sa5"], "'sa5' is of 'HDL-32E', not of"),
        (("tables", "2", "samples"), ["sa9"], "no sample 'sa9'"),
        (
            ("methods", "other"),
            ["sa5"],
            "methods.other: sample 'sa5' is of 'HDL-32E'",
        ),
        (("methods", "other"), ["sa4"], "of a position that is calibrated on"),
        (
            ("adjustment", "prior", "v_deg"),
            None,
            "prior: 'v' is adjusted, but .* no 'v_deg'",
        ),
        (("tables", "7"), {}, "unknown key 'tables.7'"),
        (("figures", "13", "samples"), ["sa9"], "figures.13: no sample 'sa9'"),
        (("figures", "13", "data"), None, "key 'figures.13.data' is missing"),
        (("figures", "11", "samples"), None, "key 'figures.11.samples' is missing"),
        (("figures", "28", "sections"), None, "key 'figures.28.sections' is missing"),
        (
            ("figures", "30", "sets"),
            ["set9"],
            "figures.30: no parameter set or calibration 'set9'.*set1, set2",
        ),
        (("figures", "30", "scanner"), "VLP-16", "figures.30: 'VLP-16' has no parameter set.*HDL"),
        (
            ("figures", "28", "set"),
            "set9",
            "no parameter set or calibration 'set9' of 'HDL-64E'.*set1, set2",
        ),
        (("simulation",), None, "figures.28: one map of the simulated world's building"),
        (("survey",), None, "'survey' is missing"),
        (("samples",), "nowhere.tsv", "nowhere.tsv: cannot be read"),
    ],
)
def test_faults_of_the_configuration(config, path, value, message):
    with pytest.raises(ConfigError, match=message):
        read_study(changed(config, path, value), "config")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("adjustment", "by_scanner"), {"HDL64E": {"noise_cm": 1.0}}, "'HDL64E'.*HDL-64E"),
        (("adjustment", "by_scanner"), {"VLP-16": {"noise_cm": 1.0}}, "no sample.*VLP-16"),
        (("reduction", "azimuth_bin_deg"), {"HDL-64": 0.09}, "'HDL-64'.*HDL-64E"),
        (("reduction", "azimuth_bin_deg", "HDL-64E"), 0.07, "0.07.*divides 360"),
        (("reduction", "azimuth_bin_deg", "HDL-64E"), 0.095, "0.095.*divides 360"),
        (("figures", "13", "scanner"), "HDL-65E", "figures.13.*'HDL-65E'.*HDL-64E"),
        (("figures", "13", "scanner"), "HDL-32E", "figures.13: sample 'sa3' is of 'HDL-64E'"),
        (("tables", "2", "scanner"), "HDL-32E", "tables.2: sample 'sa3' is of 'HDL-64E'"),
        (("adjustment", "parameters"), ["dl", "alpha", "v", "voff"], "'voff_cm'"),
        (("adjustment", "parameters"), ["dl", "hoff"], "'hoff_cm'"),
        (("adjustment", "prior", "dl_cm"), None, "'dl_cm'"),
        (("figures", "28"), None, "compare_with_paper.*map"),
        (("outdoor",), None, "compare_with_paper.*outdoor"),
        (("tables", "3"), None, "compare_with_paper.*tables.3"),
        (("outdoor", "rotations"), None, "outdoor.rotations"),
        (("reduction", "min_count"), True, "reduction.min_count: True"),
        (("adjustment", "noise_cm"), float("nan"), "adjustment.noise_cm.*finite"),
        (("adjustment", "block_deg"), float("inf"), "adjustment.block_deg.*finite"),
        (("tables", 2), {}, "tables: the key 2 is not text.*\n.*quotes"),
        (("figures", "18", "laser"), None, "figures.18.laser"),
        (("figures", "18", "laser"), 65, "figures.18.laser: 65.*64"),
    ],
)
def test_faults_that_would_only_show_in_a_job(config, path, value, message):
    with pytest.raises(ConfigError, match=message):
        read_study(changed(config, path, value), "config")


def test_a_simulated_recording_that_no_rule_makes(root, config, tmp_path):
    sheet = tmp_path / "samples.tsv"
    text = (root / config["samples"]).read_text()
    sheet.write_text(text.replace("recordings/sa6.bin", "recordings/sa7.bin"))
    study = read_study(config | {"samples": str(sheet)}, "config")
    with pytest.raises(ConfigError, match=r"recording of sample 'sa6'.*sa7.bin"):
        check_files(study, "config")


@pytest.fixture
def own(root, tmp_path, monkeypatch):
    """A study as `velocal init` leaves it, with the capture and the factory's file in place."""
    write_study(tmp_path, SCANNERS["HDL-64E"], 1)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "captures/sample1.pcap").touch()
    (tmp_path / "factory.xml").touch()
    return yaml.safe_load((tmp_path / "config.yaml").read_text())


TARGETS = {
    "planes": "a,{},0,0,0,1,1,1\n",
    "base_scanner": "b,HDL-64E,0,0,0,1,1,1\n",
    "base_site": "b,P1,0,0,0,1,1,1\n",
}


def sheet(folder, key):
    """File of the template that a key of `survey` names."""
    return folder / "survey" / f"{'base_field' if key == 'base_site' else key}.csv"


@pytest.mark.parametrize("untouched", TARGETS)
def test_untouched_templates_of_the_survey(own, tmp_path, untouched):
    for name, row in TARGETS.items():
        if name != untouched:
            rows = [row.format(plane) for plane in ("wall1", "wall2", "floor")][
                : row.count("{") * 3
            ]
            with sheet(tmp_path, name).open("a") as file:
                file.writelines(rows or [row])
    with pytest.raises(ConfigError, match=rf"survey.{untouched}: .*no target"):
        check_files(read_study(own, "config"), "config")


@pytest.mark.parametrize(
    ("name", "wrong", "message"),
    [
        ("planes", ("floor", "ground"), "no target of plane 'floor'.*wall1, wall2, ground"),
        ("base_scanner", ("HDL-64E", "HDL-32E"), "no target of scanner 'HDL-64E'.*HDL-32E"),
        ("base_site", ("P1", "P2"), "no target of position 'P1'.*P2"),
    ],
)
def test_survey_files_of_something_else(own, tmp_path, name, wrong, message):
    for each, row in TARGETS.items():
        rows = [row.format(plane) for plane in ("wall1", "wall2", "floor")][: row.count("{") * 3]
        text = "".join(rows or [row])
        with sheet(tmp_path, each).open("a") as file:
            file.write(text.replace(*wrong) if each == name else text)
    with pytest.raises(ConfigError, match=message):
        check_files(read_study(own, "config"), "config")


def without_the_paper(config):
    """Leave out what names samples of the paper, and what is said of the HDL-32E."""
    for key in ("tables", "figures", "methods", "outdoor", "compare_with_paper", "calibrations"):
        del config[key]
    del config["adjustment"]["by_scanner"], config["reduction"]["azimuth_bin_deg"]
    return config


COLUMNS = "sample\tscanner\tposition\trecording\tcalibration\n"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("../../evil\tHDL-64E\tP1\tx.bin\tnominal\n", "row 2.*is not a name"),
        ("ok; touch x #\tHDL-64E\tP1\tx.bin\tnominal\n", "row 2: the row has 1 values"),
        (
            "a\tHDL-64E\tP1\tx.bin\tnominal\na\tHDL-64E\tP1\ty.bin\tnominal\n",
            "row 3.*occurs twice.*\n.*Row 2 has",
        ),
        ("a\tHDL-63E\tP1\tx.bin\tnominal\n", "'HDL-63E'.*allowed: HDL-64E"),
        ("a\tHDL-64E\tP1\t\tnominal\n", "recording"),
    ],
)
def test_faults_of_the_sample_table(tmp_path, rows, message):
    sheet = tmp_path / "samples.tsv"
    sheet.write_text(COLUMNS + rows)
    with pytest.raises(ConfigError, match=message):
        read_samples(sheet, SurveyedSample)


def test_a_missing_recording_is_an_error_even_with_results(config, tmp_path):
    sheet = tmp_path / "samples.tsv"
    sheet.write_text(COLUMNS + "sa1\tHDL-64E\tP1\tgone.bin\tnominal\n")
    small = changed(config, ("samples",), str(sheet))
    small["parameter_sets"] = {"HDL-64E": {"set1": ["sa1"]}}
    without_the_paper(small)
    with pytest.raises(ConfigError, match=r"recording of sample 'sa1': no file 'gone.bin'"):
        check_files(read_study(small, "config"), "config")


def test_methods_need_their_priors(config):
    small = changed(config, ("adjustment", "parameters"), ["dl"])
    with pytest.raises(ConfigError, match=r"methods: adjustment.prior has no 'v_deg'"):
        read_study(changed(small, ("adjustment", "prior", "v_deg"), None), "config")


EMBEDDED = "a\tHDL-64E\tP1\tx.bin\tembedded\nb\tHDL-64E\tP2\ty.bin\t{}\n"


def embedding(config, tmp_path, rows):
    sheet = tmp_path / "samples.tsv"
    sheet.write_text(COLUMNS + rows)
    small = changed(config, ("samples",), str(sheet))
    small["parameter_sets"] = {"HDL-64E": {"set1": ["a", "b"]}}
    return without_the_paper(small)


def test_the_embedded_calibration(config, tmp_path):
    """The samples of a scanner share what the first of them holds; no rule's file is missed."""
    small = embedding(config, tmp_path, EMBEDDED.format("embedded"))
    study = read_study(small, "config")
    expected = "results/recordings/a/calibration.xml"
    assert [sample.calibration for sample in study.surveyed.values()] == [expected] * 2
    assert study.factories == {"HDL-64E": expected}
    with pytest.raises(ConfigError, match=r"recording of sample 'a': no file"):
        check_files(study, "config")


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (EMBEDDED.format("nominal"), "name different calibration files"),
        (
            EMBEDDED.format("embedded").replace("64E", "32E"),
            "32E sends no calibration.*'embedded'",
        ),
        (EMBEDDED.format("embedded").replace("64E", "64E-S1"), "64E-S1 sends no calibration"),
    ],
)
def test_faults_of_the_embedded_calibration(config, tmp_path, rows, message):
    with pytest.raises(ConfigError, match=message):
        read_study(embedding(config, tmp_path, rows), "config")


def test_two_scanners_at_one_position(config, tmp_path):
    sheet = tmp_path / "samples.tsv"
    sheet.write_text(
        COLUMNS + "a\tHDL-64E\tP1\tx.bin\tnominal\n" + "b\tHDL-32E\tP1\ty.bin\tnominal\n"
    )
    with pytest.raises(ConfigError, match="used by two scanners"):
        read_study(changed(config, ("samples",), str(sheet)), "config")


def test_every_key_is_described():
    for model in (*FILES.values(), SurveyedSample, UnsurveyedSample, OutdoorSample):
        for key, field in keys(model):
            assert field.description, key


def test_made_files_are_up_to_date(root):
    """`python -m velocal.study.schema` writes what is compared here."""
    for path, text in outputs(root / "config").items():
        assert path.read_text(encoding="utf-8") == text, path


@pytest.mark.parametrize("name", ["config.yaml", "unsurveyed.yaml", "world.yaml"])
def test_editors_find_the_schema(root, name):
    first = (root / "config" / name).read_text().splitlines()[0]
    path = first.removeprefix("# yaml-language-server: $schema=")
    assert path in ("schema/config.json", "schema/world.json")
    assert (root / "config" / path).is_file()


def test_a_configuration_survives_its_plain_form(config):
    settings = validated(StudyConfig, config, "config")
    assert StudyConfig.model_validate(settings.plain()) == settings


def test_the_world_is_valid(root):
    world = read_yaml(root / "config/world.yaml")
    validated(WorldFile, world, "world")
    world["scanners"]["HDL-64E"]["errors"]["dl_mm"] = 3
    with pytest.raises(
        ConfigError, match=r"unknown key 'scanners\.HDL-64E\.errors\.dl_mm'.*\n.*mean 'dl_cm'"
    ):
        validated(WorldFile, world, "world")


@pytest.mark.parametrize(
    ("part", "name", "message"),
    [
        ("positions", "P2", r"sample 'sa3': no HDL-64E stands at position 'P2'.*P1 \(HDL-64E\)"),
        ("scanners", "HDL-32E", "sample 'sa5': the simulated world has no scanner 'HDL-32E'"),
        ("kinds", "ideal", "sample 'ideal1': the simulated world has no scene 'ideal1'.*real15"),
        ("building", None, "no building to map"),
    ],
)
def test_what_a_study_needs_of_the_world(root, config, part, name, message):
    study, world = read_study(config, "config"), read(root / "config/world.yaml")
    check_world(study, world, "world")
    content = world.plain()
    place = content["outdoor"] if part == "kinds" else content
    if name is None:
        place[part] = None
    else:
        del place[part][name]
    content["tuned"] = []
    with pytest.raises(ConfigError, match=message):
        check_world(study, load(content), "world")
