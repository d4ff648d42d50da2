"""`velocal calibration` as a user meets it."""

import json
import re
import sys

import numpy as np
import pandas as pd
import pytest
import yaml
from typer.testing import CliRunner
from unit.test_lint import unit

from velocal.calibration.convert import max_point_distance
from velocal.calibration.dialects import DIALECTS, PAPER
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.cli import app, calibration, main
from velocal.errors import VelocalError
from velocal.scanner.models import SCANNERS


@pytest.fixture
def files(tmp_path):
    """One unit: as the factory ships it, without near points, and with deviations."""
    whole = unit()
    plain = CalibrationFile(
        parameters=type(whole)(*(getattr(whole, k) for k in ("dl", "alpha", "v", "voff", "hoff"))),
        dialect="paper",
        std={"dl": np.full(64, 0.001)},
        provenance={"study": "x"},
    )
    formats.write(tmp_path / "db.xml", whole)
    formats.write(tmp_path / "set.json", plain)
    formats.write(tmp_path / "vlp.yaml", unit("VLP-16"))
    return tmp_path


def run(*arguments):
    """In this process, for speed."""
    done = CliRunner().invoke(app, ["calibration", *map(str, arguments)], env={"COLUMNS": "200"})
    if isinstance(done.exception, VelocalError):
        raise done.exception
    return done


@pytest.mark.parametrize("command", ["", "show", "lint", "convert", "diff"])
def test_help(command):
    done = run(*([command] if command else []), "--help")
    assert done.exit_code == 0
    text = " ".join(re.sub(r"[│╭╮╰╯─]", " ", done.stdout).split())
    for part in {
        "": ["show", "lint", "convert", "diff", "db.xml"],
        "show": ["degrees and centimetres", "--json"],
        "lint": ["missing or doubled", "exit code is 1"],
        "convert": ["velodyne_decoder", "--inexact", "--rate-hz", "Chosen by suffix if left out"],
        "diff": ["--ranges", "--figure", "--first", "what the choice of the program costs"],
    }[command]:
        assert part in text


def test_show(files):
    done = run("show", files / "set.json")
    for part in ("HDL-64E", "paper", "2 mm", "dl_std_cm", "study"):
        assert part in done.stdout
    facts = json.loads(run("show", files / "db.xml", "--json").stdout)
    assert facts["dialect"] == "manual (the file does not say)"
    np.testing.assert_allclose(facts["columns"]["dl_cm"], 100.0 * unit().dl)
    np.testing.assert_allclose(facts["columns"]["v_deg"], np.rad2deg(unit().v))


def test_lint(files):
    done = run("lint", files / "db.xml", files / "vlp.yaml")
    assert done.exit_code == 0
    assert done.stdout.count("no problems found") == 2
    (files / "page.xml").write_text("<!DOCTYPE html><html>")
    done = run("lint", files / "db.xml", files / "page.xml")
    assert done.exit_code == 1
    assert "page.xml: unreadable: is a web page" in done.stdout


def test_convert_gives_the_reader_the_same_points(files):
    before = formats.read_calibration(files / "set.json").parameters
    # VeloView turns the lasers on within a firing, and rounds: 7 mm at 80 m.
    cases = (("a.xml", "veloview", ("--rate-hz", 10), 0.0075), ("a.yaml", "ros", (), 1e-12))
    for name, dialect, rate, allowed in cases:
        done = run("convert", files / "set.json", files / name, *rate)
        assert f"64 lasers, paper to {dialect}" in done.stdout
        found = formats.read_calibration(files / name)
        assert found.dialect == dialect
        pair = (PAPER, before), (DIALECTS[dialect], found.parameters)
        assert max_point_distance(*pair, scanner=SCANNERS["HDL-64E"], rate_hz=10.0).max() < allowed
    # The numbers are others: a reader with the other formula would be off by centimetres.
    assert max_point_distance((PAPER, before), (PAPER, found.parameters)).max() > 0.02
    back = run("convert", files / "a.yaml", files / "back.csv")
    assert "ros to paper" in back.stdout
    np.testing.assert_allclose(formats.read(files / "back.csv", 64).dl, before.dl, atol=1e-15)


def test_convert_keeps_what_is_known(files):
    run("convert", files / "set.json", files / "b.json")
    found = formats.read_calibration(files / "b.json")
    np.testing.assert_array_equal(found.std["dl"], np.full(64, 0.001))
    assert found.scanner == "HDL-64E"
    assert found.provenance["source"] == "set.json"
    assert found.provenance["before"] == {"study": "x"}
    done = run("convert", files / "set.json", files / "c.json", "--to", "ros")
    assert "Standard deviations belong to the other dialect" in done.stdout
    assert formats.read_calibration(files / "c.json").std == {}


def test_convert_refuses_or_quantifies(files):
    with pytest.raises(VelocalError, match=r"near-point.* 80 m(.|\n)*Hint: .*--inexact"):
        run("convert", files / "db.xml", files / "a.csv")
    assert not (files / "a.csv").exists()
    done = run("convert", files / "db.xml", files / "a.csv", "--inexact")
    assert re.search(r"points differ by up to [1-9]\.\d cm at 3 m .* 0\.0 cm at 80 m", done.stdout)
    to = files / "d.yml", "--to", "velodyne_decoder"
    with pytest.raises(VelocalError, match=r"interpolate azimuths differently(.|\n)*--rate-hz"):
        run("convert", files / "set.json", *to)
    assert run("convert", files / "set.json", *to, "--rate-hz", 10).exit_code == 0
    same = run("convert", files / "db.xml", files / "same.yaml", "--to", "manual")
    assert same.exit_code == 0
    np.testing.assert_array_equal(
        formats.read_calibration(files / "same.yaml").parameters.dl, unit().dl
    )


def test_a_list_filled_up_to_64_has_the_lasers_that_it_has(files):
    """As the YAML of a 32-laser scanner made from a db.xml: 32 entries of zeros follow."""
    formats.write(files / "p.yaml", unit("HDL-32E"))
    document = yaml.safe_load((files / "p.yaml").read_text())
    empty = dict.fromkeys(document["lasers"][0], 0.0) | {"max_intensity": 255}
    document["lasers"] += [empty | {"laser_id": laser} for laser in range(32, 64)]
    document["num_lasers"] = 64
    (files / "p.yaml").write_text(yaml.safe_dump(document))
    facts = json.loads(run("show", files / "p.yaml", "--json").stdout)
    assert (facts["lasers"], facts["scanner"]) == (32, "HDL-32E")
    assert run("lint", files / "p.yaml").exit_code == 0


def test_lasers_that_are_turned_off_are_named(files):
    text = (files / "db.xml").read_text()
    for _ in range(32):  # as a file of which only the upper block is used
        head, tail = text.split("</enabled_>")
        before, after = head.rsplit("<item>1", 1)
        text = f"{before}<item>0{after}</enabled_>{tail}"
    (files / "off.xml").write_text(text)
    done = run("lint", files / "off.xml")
    assert re.search("disabled: laser 32, 33, .*: turned off by enabled_", done.stdout)
    done = run("convert", files / "off.xml", files / "off.yaml", "--to", "manual")
    assert "32 lasers" in done.stdout
    assert re.search(r"Left out, as off.xml turns them off: laser 32, 33, .*, 63\n", done.stdout)
    assert re.search(r"turned off +laser 32, 33", run("show", files / "off.xml").stdout)
    with pytest.raises(VelocalError, match="set enabled_ to 1 to use them"):
        formats.read_or_nominal(files / "off.xml", SCANNERS["HDL-64E"])


@pytest.mark.parametrize("name", SCANNERS)
def test_files_are_called_what_they_are(files, name):
    """A file of 32 lasers was an HDL-32E, one of 128 nothing."""
    formats.write(files / "a.yaml", unit("HDL-64E" if "HDL-64E" in name else name))
    shown = json.loads(run("show", files / "a.yaml", "--json").stdout)["scanner"]
    assert shown == ("HDL-64E" if "HDL-64E" in name else name)


def test_a_tick_of_7_mm_is_shown_and_converted(files):
    whole = CalibrationFile(unit("VLS-128"), tick_m=0.007)
    formats.write(files / "a.xml", whole)
    assert re.search(r"distance tick +7 mm", run("show", files / "a.xml").stdout)
    run("convert", files / "a.xml", files / "a.json")
    assert formats.read_calibration(files / "a.json").tick_m == 0.007
    assert "tick is 0.007 m" in run("lint", files / "a.xml").stdout


def test_the_ros_driver_ignores_distances_and_offsets_of_a_vls128(files):
    formats.write(files / "a.json", CalibrationFile(unit("VLS-128"), "paper", "VLS-128", 0.004))
    with pytest.raises(VelocalError, match=r"ignores distance corrections.*VLS-128: .*2\.\d cm"):
        run("convert", files / "a.json", files / "a.yaml")


def test_the_calibration_of_another_model_is_refused(files):
    """A Hi-Res has 16 lasers like a VLP-16; a JSON names its scanner."""
    formats.write(files / "hires.yaml", unit("VLP-16-Hi-Res"))
    with pytest.raises(VelocalError, match=r"angles of a VLP-16-Hi-Res(.|\n)*Hint: .*--scanner"):
        formats.read_or_nominal(files / "hires.yaml", SCANNERS["VLP-16"])
    with pytest.raises(VelocalError, match="angles of a VLP-16-Hi-Res"):
        run("show", files / "hires.yaml", "--scanner", "VLP-16")
    assert "VLP-16-Hi-Res" in run("show", files / "hires.yaml").stdout
    formats.write(files / "32.yaml", unit("HDL-32E"))
    with pytest.raises(VelocalError, match="angles of a HDL-32E"):
        formats.read_or_nominal(files / "32.yaml", SCANNERS["VLP-32C"])
    named = CalibrationFile(unit("HDL-32E"), "paper", "VLP-32C")
    formats.write(files / "named.json", named)
    with pytest.raises(VelocalError, match="is the calibration of a VLP-32C, not of a HDL-32E"):
        formats.read_or_nominal(files / "named.json", SCANNERS["HDL-32E"])
    # All series of the HDL-64E have the same lasers.
    found = formats.read_or_nominal(files / "set.json", SCANNERS["HDL-64E-S3"])
    assert len(found) == 64


def test_a_factory_file_for_ros_is_written_and_what_differs_is_said(files):
    """The manual and the ROS driver read the same two points; beyond 25 m ROS extrapolates them."""
    done = run("convert", files / "db.xml", files / "a.yaml")
    assert done.exit_code == 0
    assert "beyond 25 m ros extrapolates near-point corrections" in done.stdout
    far = re.search(r"0\.0 cm at 3 m.* ([1-9]\d*\.\d) cm at 80 m \(laser (\d+)\)", done.stdout)
    found = formats.read_calibration(files / "a.yaml")
    assert found.dialect == "ros"
    pair = (DIALECTS["manual"], unit()), (DIALECTS["ros"], found.parameters)
    apart = max_point_distance(*pair, scanner=SCANNERS["HDL-64E"])
    assert apart[:3].max() < 0.002
    assert float(far[1]) == pytest.approx(100.0 * apart[3].max(), abs=0.05)
    assert int(far[2]) == apart[3].argmax()
    # With the program of the S2 manual it is exact, and nothing is said.
    done = run("convert", files / "db.xml", files / "b.yaml", "--from", "manual_s2")
    assert "differ" not in done.stdout


def test_diff(files):
    picture, table = files / "x.png", files / "x.csv"
    arguments = [files / "db.xml"] * 2 + ["--first", "manual", "--second", "ros"]
    done = run("diff", *arguments, "--ranges", "5,50", "--figure", picture, "--csv", table)
    assert done.exit_code == 0
    assert re.search(r"5 m .* cm .*\n.*50 m", done.stdout)
    written = pd.read_csv(table)
    wanted = max_point_distance(
        (DIALECTS["manual"], unit()),
        (DIALECTS["ros"], unit()),
        (5.0, 50.0),
        scanner=SCANNERS["HDL-64E"],
    )
    np.testing.assert_allclose(written["apart_50m_cm"], 100 * wanted[1], atol=1e-4)
    assert picture.stat().st_size > 10_000
    assert picture.with_suffix(".svg").exists()
    same = run("diff", files / "db.xml", files / "db.xml")
    assert "0.00 cm" in same.stdout


def test_diff_is_the_same_for_another_name_of_the_same_hardware(files):
    """An S3 fires as an S2 does: 22 cm at 80 m for programs that interpolate its azimuths."""
    arguments = [files / "set.json"] * 2 + ["--first", "paper", "--second", "velodyne_decoder"]
    s2, s3 = (
        run("diff", *arguments, "--scanner", name).stdout for name in ("HDL-64E", "HDL-64E-S3")
    )
    assert re.search(r"80 m .* 22\.\d\d cm", s2)
    assert s3.replace("HDL-64E-S3", "HDL-64E") == s2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["convert", "{}/db.xml", "{}/a.txt"], "unknown suffix '.txt'.*\nHint: XML is"),
        (
            ["convert", "{}/db.xml", "{}/a.csv", "--to", "ros"],
            "cannot hold.*\nHint: Write",
        ),
        (
            ["convert", "{}/db.xml", "{}/a.xml", "--to", "rviz"],
            "dialect 'rviz'.*\nHint: Name",
        ),
        (["convert", "{}/no.xml", "{}/a.xml"], "cannot be read"),
        (["diff", "{}/db.xml", "{}/vlp.yaml"], "64 and 16 lasers cannot be compared\nHint: "),
        (
            ["diff", "{}/db.xml", "{}/db.xml", "--ranges", "5;6"],
            "are '5;6'.*\nHint: 3,10,25",
        ),
        (["show", "{}/db.xml", "--scanner", "HDL-65"], "unknown scanner 'HDL-65'.*\nHint: "),
        (["show", "{}/db.xml", "--scanner", "VLP-16"], "holds 64 lasers.*\nHint: Is this the file"),
        (["lint", "{}/db.xml", "--scanner", "x"], "unknown scanner 'x'"),
    ],
)
def test_wrong_calls_give_one_line_and_a_hint(files, arguments, message):
    with pytest.raises(VelocalError, match=message):
        run(*(each.format(files) for each in arguments))


def test_wrong_calls_without_a_traceback(files, monkeypatch, capsys):
    for arguments, code in ((["show", str(files / "no.xml")], 1), (["convert"], 2)):
        monkeypatch.setattr(sys, "argv", ["velocal", "calibration", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == code
    text = capsys.readouterr().err
    assert text.startswith("Error: ")
    assert "Traceback" not in text


def test_names_are_complete():
    assert calibration.NAMES.split(", ") == list(DIALECTS)


def test_lint_for_programs(files):
    (files / "bad.yaml").write_text("lasers: []\n")
    done = run("lint", files / "bad.yaml", files / "db.xml", "--json")
    told = json.loads(done.stdout)
    assert done.exit_code == 1
    assert list(told) == [str(files / "bad.yaml"), str(files / "db.xml")]
    assert told[str(files / "db.xml")] == []
    assert all(finding.keys() == {"code", "text"} for finding in told[str(files / "bad.yaml")])
    assert told[str(files / "bad.yaml")]


def test_diff_for_programs(files):
    told = json.loads(
        run("diff", files / "db.xml", files / "set.json", "--ranges", "3,10", "--json").stdout
    )
    assert told["first"] == "db.xml (manual)"
    assert told["scanner"] == "HDL-64E"
    one, other = (formats.read_calibration(files / name) for name in ("db.xml", "set.json"))
    apart = max_point_distance(
        (DIALECTS["manual"], one.parameters), (PAPER, other.parameters), (3.0, 10.0),
        scanner=SCANNERS["HDL-64E"], rate_hz=10.0,
    )  # fmt: skip
    assert [row["range_m"] for row in told["ranges"]] == [3.0, 10.0]
    np.testing.assert_allclose([row["distance_cm"] for row in told["ranges"]], 100.0 * apart)
