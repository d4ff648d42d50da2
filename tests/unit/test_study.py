"""Configurations and sheets: every fault is one message that says where and what is allowed."""

import copy

import pytest
import yaml

from velocal.errors import ConfigError
from velocal.scanner.models import SCANNERS
from velocal.study.config import check_files, read_study
from velocal.study.sheets import check, read_sheet, read_yaml
from velocal.study.template import write_study


@pytest.fixture
def schemas(root):
    return root / "workflow/schemas"


@pytest.fixture
def config(root, monkeypatch):
    monkeypatch.chdir(root)
    return yaml.safe_load((root / "config/config.yaml").read_text())


def test_the_study_is_sound(config, schemas):
    study = read_study(config, schemas, "config")
    assert list(study.surveyed) == ["sa1", "sa2", "sa3", "sa4", "sa5", "sa6"]
    assert study.positions == {"P1": "HDL-64E", "P2": "HDL-64E", "P5": "HDL-32E", "P6": "HDL-32E"}
    assert study.surveyed["sa1"].windows == ("beginning", "middle", "end")
    check_files(study, "results/simulation", "config")


def test_a_scanner_may_be_chosen_in_a_sheet(config, schemas, tmp_path):
    rows = (schemas.parents[1] / config["samples"]).read_text().splitlines()
    heading, *samples = [row for row in rows if row and not row.startswith("#")]
    samples = [f"{row}\t\t" for row in samples]
    samples[0] = samples[0].rstrip("\t") + "\t2369\t192.168.1.202"
    samples[1] = samples[1].rstrip("\t") + "\t\t/left/velodyne_packets"
    sheet = tmp_path / "samples.tsv"
    sheet.write_text("\n".join([f"{heading}\tport\taddress", *samples]) + "\n")
    surveyed = read_study(config | {"samples": str(sheet)}, schemas, "config").surveyed
    chosen = [(sample.port, sample.address) for sample in surveyed.values()]
    assert chosen[:2] == [(2369, "192.168.1.202"), (None, "/left/velodyne_packets")]
    assert set(chosen[2:]) == {(None, None)}
    sheet.write_text(sheet.read_text().replace("2369", "x"))
    with pytest.raises(ConfigError, match="row 1: port"):
        read_study(config | {"samples": str(sheet)}, schemas, "config")


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
        (("windows", "rotation"), 3, r"unknown key 'windows.rotation' \(allowed: rotations\)"),
        (("windows", "rotations"), 0, "windows.rotations"),
        (("windows", "rotations"), "ten", "windows.rotations"),
        (("adjustment", "method"), "magic", r"'magic' \(allowed: prior, paper"),
        (("adjustment", "parameters"), ["dl", "beta"], "beta"),
        (("results",), "../elsewhere", "results"),
        (("parameter_sets", "HDL-64E", "set1"), ["sa5"], "no sample 'sa5' of that scanner"),
        (("parameter_sets", "HDL-32E"), None, "no 'HDL-32E'"),
        (("tables", "2", "samples"), ["sa9"], "no sample 'sa9'"),
        (("methods", "other"), ["sa5"], "methods.other: no sample 'sa5' of 'HDL-64E'"),
        (("methods", "other"), ["sa4"], "of a position that is calibrated on"),
        (("adjustment", "prior", "v_deg"), None, "adjustment.prior has no 'v_deg'"),
        (("tables", "7"), {}, "unknown key 'tables.7'"),
        (("figures", "13", "samples"), ["sa9"], "figures.13: no sample 'sa9'"),
        (("figures", "13", "data"), None, "'data' is a required property"),
        (("figures", "11", "samples"), None, "'samples' is a required property"),
        (("figures", "28", "sections"), None, "'sections' is a required property"),
        (("figures", "28", "set"), "set9", "no parameter set 'set9' of 'HDL-64E'.*set1, set2"),
        (("simulation",), None, "figures.28: one map of the simulated world's building"),
        (("survey",), None, "'survey' is missing"),
        (("samples",), "nowhere.tsv", "nowhere.tsv: cannot be read"),
    ],
)
def test_faults_of_the_configuration(config, schemas, path, value, message):
    with pytest.raises(ConfigError, match=message):
        read_study(changed(config, path, value), schemas, "config")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("adjustment", "by_scanner"), {"HDL64E": {"noise_cm": 1.0}}, "'HDL64E'.*HDL-64E"),
        (("adjustment", "by_scanner"), {"VLP-16": {"noise_cm": 1.0}}, "no sample.*VLP-16"),
        (("reduction", "cell_deg"), {"HDL-64": 0.09}, "'HDL-64'.*HDL-64E"),
        (("reduction", "cell_deg", "HDL-64E"), 0.07, "0.07.*divides 360"),
        (("reduction", "cell_deg", "HDL-64E"), 0.095, "0.095.*divides 360"),
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
        (("tables", 2), {}, r"tables: the key 2 .*quotes"),
        (("figures", "18", "laser"), None, "figures.18.laser"),
        (("figures", "18", "laser"), 65, "figures.18.laser: 65.*64"),
    ],
)
def test_faults_that_would_only_show_in_a_job(config, schemas, path, value, message):
    with pytest.raises(ConfigError, match=message):
        read_study(changed(config, path, value), schemas, "config")


def test_a_simulated_recording_that_no_rule_makes(config, schemas, tmp_path):
    sheet = tmp_path / "samples.tsv"
    text = (schemas.parents[1] / config["samples"]).read_text()
    sheet.write_text(text.replace("recordings/sa6.bin", "recordings/sa7.bin"))
    study = read_study(config | {"samples": str(sheet)}, schemas, "config")
    with pytest.raises(ConfigError, match=r"recording of sample 'sa6'.*sa7.bin"):
        check_files(study, "results/simulation", "config")


@pytest.fixture
def own(root, tmp_path, monkeypatch):
    """A study as `velocal init` leaves it, with the capture and the factory's file in place."""
    write_study(tmp_path, SCANNERS["HDL-64E"], 1, root / "workflow/Snakefile")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "captures/sample1.pcap").touch()
    (tmp_path / "factory.xml").touch()
    return yaml.safe_load((tmp_path / "config.yaml").read_text())


TARGETS = {
    "planes": "a,{},0,0,0,1,1,1\n",
    "base_scanner": "b,HDL-64E,0,0,0,1,1,1\n",
    "base_field": "b,P1,0,0,0,1,1,1\n",
}


@pytest.mark.parametrize("untouched", TARGETS)
def test_untouched_templates_of_the_survey(own, schemas, tmp_path, untouched):
    for name, row in TARGETS.items():
        if name != untouched:
            rows = [row.format(plane) for plane in ("wall1", "wall2", "floor")][
                : row.count("{") * 3
            ]
            with (tmp_path / f"survey/{name}.csv").open("a") as file:
                file.writelines(rows or [row])
    with pytest.raises(ConfigError, match=rf"survey.{untouched}: .*no target"):
        check_files(read_study(own, schemas, "config"), None, "config")


@pytest.mark.parametrize(
    ("name", "wrong", "message"),
    [
        ("planes", ("floor", "ground"), "no target of plane 'floor'.*wall1, wall2, ground"),
        ("base_scanner", ("HDL-64E", "HDL-32E"), "no target of scanner 'HDL-64E'.*HDL-32E"),
        ("base_field", ("P1", "P2"), "no target of position 'P1'.*P2"),
    ],
)
def test_survey_files_of_something_else(own, schemas, tmp_path, name, wrong, message):
    for each, row in TARGETS.items():
        rows = [row.format(plane) for plane in ("wall1", "wall2", "floor")][: row.count("{") * 3]
        text = "".join(rows or [row])
        with (tmp_path / f"survey/{each}.csv").open("a") as file:
            file.write(text.replace(*wrong) if each == name else text)
    with pytest.raises(ConfigError, match=message):
        check_files(read_study(own, schemas, "config"), None, "config")


COLUMNS = "sample\tscanner\tposition\trecording\tcalibration\n"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("../../evil\tHDL-64E\tP1\tx.bin\tnominal\n", "row 1.*is not a name"),
        ("ok; touch x #\tHDL-64E\tP1\tx.bin\tnominal\n", "row 1"),
        ("a\tHDL-64E\tP1\tx.bin\tnominal\na\tHDL-64E\tP1\ty.bin\tnominal\n", "row 2.*occurs twice"),
        ("a\tHDL-63E\tP1\tx.bin\tnominal\n", "'HDL-63E'.*allowed: HDL-64E"),
        ("a\tHDL-64E\tP1\t\tnominal\n", "recording"),
    ],
)
def test_faults_of_the_sheet(tmp_path, schemas, rows, message):
    sheet = tmp_path / "samples.tsv"
    sheet.write_text(COLUMNS + rows)
    with pytest.raises(ConfigError, match=message):
        read_sheet(sheet, read_yaml(schemas / "samples.schema.yaml"))


def test_a_missing_recording_is_an_error_even_with_results(config, schemas, tmp_path):
    sheet = tmp_path / "samples.tsv"
    sheet.write_text(COLUMNS + "sa1\tHDL-64E\tP1\tgone.bin\tnominal\n")
    small = changed(config, ("samples",), str(sheet))
    small["parameter_sets"] = {"HDL-64E": {"set1": ["sa1"]}}
    del small["tables"], small["figures"], small["methods"], small["outdoor"]
    with pytest.raises(ConfigError, match=r"recording of sample 'sa1': no file 'gone.bin'"):
        check_files(read_study(small, schemas, "config"), "results/simulation", "config")


STREAMED = "a\tHDL-64E\tP1\tx.bin\tstream\nb\tHDL-64E\tP2\ty.bin\t{}\n"


def streamed(config, tmp_path, rows):
    sheet = tmp_path / "samples.tsv"
    sheet.write_text(COLUMNS + rows)
    small = changed(config, ("samples",), str(sheet))
    small["parameter_sets"] = {"HDL-64E": {"set1": ["a", "b"]}}
    del small["tables"], small["figures"], small["methods"], small["outdoor"]
    return small


def test_the_calibration_of_the_stream(config, schemas, tmp_path):
    """The samples of a scanner share what the first of them holds; no rule's file is missed."""
    small = streamed(config, tmp_path, STREAMED.format("stream"))
    study = read_study(small, schemas, "config")
    expected = "results/recordings/a/calibration.xml"
    assert [sample.calibration for sample in study.surveyed.values()] == [expected] * 2
    assert study.factories == {"HDL-64E": expected}
    with pytest.raises(ConfigError, match=r"recording of sample 'a': no file"):
        check_files(study, "results/simulation", "config")


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (STREAMED.format("nominal"), "name different calibration files"),
        (STREAMED.format("stream").replace("64E", "32E"), "HDL-32E sends no calibration.*'stream'"),
    ],
)
def test_faults_of_the_calibration_of_the_stream(config, schemas, tmp_path, rows, message):
    with pytest.raises(ConfigError, match=message):
        read_study(streamed(config, tmp_path, rows), schemas, "config")


def test_two_scanners_at_one_position(config, schemas, tmp_path):
    sheet = tmp_path / "samples.tsv"
    sheet.write_text(
        COLUMNS + "a\tHDL-64E\tP1\tx.bin\tnominal\n" + "b\tHDL-32E\tP1\ty.bin\tnominal\n"
    )
    with pytest.raises(ConfigError, match="used by two scanners"):
        read_study(changed(config, ("samples",), str(sheet)), schemas, "config")


def test_every_key_is_described(schemas):
    """Schemas are the reference of the configuration: no key without a word on it."""
    schema = read_yaml(schemas / "config.schema.yaml")

    def walk(node, place):
        for key, value in node.get("properties", {}).items():
            described = "description" in value or place.startswith(("prior", "2-5", "0-9", "patch"))
            inside = any(part in place for part in ("prior", "pattern", "patches"))
            assert described or inside, f"{place}.{key}"
            walk(value, f"{place}.{key}")

    walk(schema, "config")
    for name in ("samples", "field_samples"):
        for column in read_yaml(schemas / f"{name}.schema.yaml")["properties"].values():
            assert column["description"]


def test_the_world_is_sound(root, schemas):
    world = read_yaml(root / "config/world.yaml")
    schema = read_yaml(schemas / "world.schema.yaml")
    check(world, schema, "world")
    world["scanners"]["HDL-64E"]["errors"]["dl_mm"] = 3
    with pytest.raises(ConfigError, match=r"unknown key 'scanners.HDL-64E.errors.dl_mm'"):
        check(world, schema, "world")
