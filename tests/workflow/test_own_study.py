"""A user's own study, as docs/how-to.md walks through it, on files handed over from outside.

The files are simulated, but nothing that runs knows: they lie in a folder of their own, named in
the sheet, and the configuration has no simulated world.
"""

import sys

import numpy as np
import pytest
from support.capture import pcap_head, pcap_packet
from support.chain import study_world
from support.running import ROOT, snakemake

from velocal.calibration.files import formats
from velocal.recording.scan import inspect
from velocal.simulation import capture, survey, truth
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.targets import write_targets

pytestmark = pytest.mark.workflow

SCANNER, POSITION, ROTATIONS = "HDL-32E", "P5", 12


def velocal_init(folder, *arguments):
    import subprocess

    command = [sys.executable, "-m", "velocal.cli", "init", str(folder), "--checkout", str(ROOT)]
    done = subprocess.run([*command, *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def hand_over(folder):
    """What a user brings: a capture, the factory's file, and what the surveyor measured."""
    world = study_world()
    stream = b"".join(capture.records(world, SCANNER, POSITION, "user", ROTATIONS))
    frames = [stream[at : at + 1248] for at in range(0, len(stream), 1248)]
    packets = [pcap_packet(frame, number) for number, frame in enumerate(frames)]
    (folder / "captures/monday.pcap").write_bytes(pcap_head() + b"".join(packets))
    formats.write(folder / "factory.xml", truth.factory_parameters(world, SCANNER))
    surveyed = adjust_field_book(survey.field_book(world))
    for name, group, targets in (
        ("planes", "plane", surveyed.planes),
        ("base_scanner", "scanner", surveyed.base_scanner[SCANNER].targets),
        ("base_field", "position", surveyed.base_site[POSITION]),
    ):
        write_targets(folder / f"survey/{name}.csv", group, [targets])


def fill_in(path, *changes):
    text = path.read_text()
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("user") / "my scanner"
    said = velocal_init(folder, "--scanner", SCANNER, "--positions", "1")
    assert "snakemake --cores 2" in said
    hand_over(folder)
    fill_in(
        folder / "samples.tsv",
        ("sample1\t", "monday\t"),
        ("\tP1\t", f"\t{POSITION}\t"),
        ("captures/sample1.pcap\tnominal", "captures/monday.pcap\tfactory.xml"),
    )
    fill_in(
        folder / "config.yaml",
        ("all: [sample1]", "all: [monday]"),
        ("planes: [wall1, wall2, floor]", "planes: [short_wall, long_wall, floor]"),
        ("rotations: 100", "rotations: 4"),
        ("min_count: 5", "min_count: 1"),
    )
    config = (folder / "config.yaml").read_text()
    (folder / "config.yaml").write_text(config.replace("samples: [sample1]", "samples: [monday]"))
    done = snakemake(folder, "--cores", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_refined_file_is_nearer_to_the_truth(finished):
    world = study_world()
    true = truth.unit_truth(world, SCANNER).parameters.dl
    factory = formats.read(finished / "factory.xml", len(true)).dl
    for suffix in ("xml", "yaml", "csv"):
        path = finished / f"results/parameter_sets/{SCANNER}/all.{suffix}"
        refined = formats.read(path, len(true)).dl
        before, after = (np.sqrt(np.mean((dl - true) ** 2)) for dl in (factory, refined))
        assert after < 0.2 * before  # measured 0.13 against 2.6 cm: this scanner's errors are in dl


def test_report_tables_and_figures(finished):
    results = finished / "results"
    report = (results / "report.html").read_text()
    assert f"Calibration of an {SCANNER}" in report
    assert "monday" in report
    assert "simulated" not in report.lower()
    for name in (
        "tables/table_2.md", "figures/figure_01.png", "figures/figure_04.png",
        "statistics/lasers.csv",
    ):  # fmt: skip
        assert (results / name).stat().st_size > 0


def test_points_with_the_refined_file(finished, tmp_path):
    from typer.testing import CliRunner

    from velocal.cli import app

    refined = finished / f"results/parameter_sets/{SCANNER}/all.xml"
    done = CliRunner().invoke(
        app,
        ["points", str(finished / "captures/monday.pcap"), "-o", str(tmp_path / "p.ply"),
         "-c", str(refined), "--before", str(finished / "factory.xml")],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert f"of {len(inspect(finished / 'captures/monday.pcap').index)} rotations" in done.output


def test_a_second_run_from_elsewhere_is_idle(finished, tmp_path):
    done = snakemake(
        tmp_path, "--cores", "2", "--snakefile", str(finished / "Snakefile"),
        "--directory", str(finished),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Nothing to be done" in done.stdout + done.stderr


def test_the_only_position_is_warned_of(finished):
    warned = (finished / "results/survey/checks.csv").read_text()
    assert "independent check" in warned
    report = (finished / "results/report.html").read_text()
    assert "The checks of the survey warn of this" in report[: report.index("<nav")]


def test_a_wrong_survey_stops_the_run(finished):
    sheet = finished / "survey/base_scanner.csv"
    calibration = finished / f"results/parameter_sets/{SCANNER}/all.xml"
    right, before = sheet.read_text(), calibration.read_bytes()
    head, *rows = right.splitlines()
    cells = [row.split(",") for row in rows]
    exchanged = [",".join([*row[:2], row[3], row[2], *row[4:]]) for row in cells]
    sheet.write_text("\n".join([head, *exchanged, ""]))
    done = snakemake(finished, "--cores", "2")
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert "nothing is exported" in said
    assert "It looks as if X and Y of the base are exchanged" in said
    assert "Traceback" not in said
    assert calibration.read_bytes() == before
    sheet.write_text(right)
    done = snakemake(finished, "--cores", "2")
    assert done.returncode == 0, done.stderr
    assert "Warning: scanner HDL-32E: there is one position only" in done.stdout + done.stderr


def test_untouched_templates_say_what_is_missing(tmp_path):
    velocal_init(tmp_path / "study")
    done = snakemake(tmp_path / "study", "--cores", "2")
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert "recording of sample 'sample1': no file 'captures/sample1.pcap'" in said
    assert "Hint: Put it there, or name another" in said
    assert "Traceback" not in said
    assert not (tmp_path / "study/results").exists()
