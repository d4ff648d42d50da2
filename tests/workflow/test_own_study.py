"""A user's own study, as docs/how-to.md walks through it, on files handed over from outside.

The files are simulated, but nothing that runs knows: they lie in a folder of their own, named in
the sheet, and the configuration has no simulated world.
"""

import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.capture import pcap_head, pcap_packet
from support.chain import study_world
from support.running import completed, environment, snakemake, velocal_run

from velocal.calibration.files import formats
from velocal.recording.scan import inspect
from velocal.simulation import capture, survey, truth
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.targets import write_targets

pytestmark = pytest.mark.workflow

#: A time before that of every result, as `cp -p` or `rsync -t` may give it to a file.
OLD_S = 1e9
SCANNER, POSITION, ROTATIONS = "HDL-32E", "P5", 12


def velocal_init(folder, *arguments):
    command = [sys.executable, "-m", "velocal.cli", "init", str(folder)]
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


def filled_in(folder):
    """The folder of a study, ready to run."""
    said = velocal_init(folder, "--scanner", SCANNER, "--positions", "1")
    assert "velocal run --cores 2" in said
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
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = filled_in(tmp_path_factory.mktemp("user") / "my scanner")
    done = velocal_run(folder, "--cores", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture
def copied(finished, tmp_path):
    """A copy of the finished study, for tests that leave it unfinished."""
    return Path(shutil.copytree(finished, tmp_path / "my scanner", symlinks=True))


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
    drift = pd.read_csv(results / f"calibrations/{SCANNER}/all.drift.csv")
    assert set(drift["compared"]) == {POSITION}
    assert list(drift["window"].unique()) == ["beginning", "middle", "end"]
    assert f"Changes of the distances of {SCANNER}/all over time" in report


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


def test_a_wrong_survey_stops_the_run(copied):
    sheet = copied / "survey/base_scanner.csv"
    exported = f"results/parameter_sets/{SCANNER}/all.xml"
    right, before = sheet.read_text(), (copied / exported).read_bytes()
    head, *rows = right.splitlines()
    cells = [row.split(",") for row in rows]
    exchanged = [",".join([*row[:2], row[3], row[2], *row[4:]]) for row in cells]
    sheet.write_text("\n".join([head, *exchanged, ""]))
    os.utime(sheet, (OLD_S, OLD_S))
    # The second run must not take what was made before the change for up to date.
    for _ in range(2):
        done = snakemake(copied, "--cores", "2")
        said = done.stdout + done.stderr
        assert done.returncode == 1
        assert "nothing is exported" in said
        assert "It looks as if X and Y of the base are exchanged" in said
        assert "Traceback" not in said
        assert (copied / exported).read_bytes() == before
    sheet.write_text(right)
    os.utime(sheet, (OLD_S, OLD_S))
    done = snakemake(copied, "--cores", "2", exported)
    assert done.returncode == 0, done.stderr
    assert "Warning: scanner HDL-32E: there is one position only" in done.stdout + done.stderr
    assert (copied / exported).read_bytes() == before


def test_untouched_templates_say_what_is_missing(tmp_path):
    velocal_init(tmp_path / "study")
    done = snakemake(tmp_path / "study", "--cores", "2")
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert "recording of sample 'sample1': no file 'captures/sample1.pcap'" in said
    assert "Hint: Put it there, or name another" in said
    assert "Traceback" not in said
    assert not (tmp_path / "study/results").exists()


def planned(folder, *arguments):
    """Rules of the jobs of a dry run."""
    done = velocal_run(folder, "--cores", "2", "--dry-run", *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    return set(re.findall(r"^(?:local)?rule (\w+):", done.stdout + done.stderr, flags=re.MULTILINE))


#: Files that people change, how, and the first rule that must run again.
GIVEN = {
    "survey/base_field.csv": (lambda content: content + b"\n", "adjust_survey"),
    "factory.xml": (lambda content: content.replace(b"</boost", b"\n</boost"), "adjust_unit"),
    "captures/monday.pcap": (lambda content: content[: len(content) // 2], "index_recording"),
}


def test_files_with_an_older_time(finished):
    """Times alone would say that there is nothing to be done."""
    kept = {finished / name: (finished / name).read_bytes() for name in GIVEN}
    try:
        for (path, content), (change, _) in zip(kept.items(), GIVEN.values(), strict=True):
            assert change(content) != content
            path.write_bytes(change(content))
            os.utime(path, (OLD_S, OLD_S))
        assert {rule for _, rule in GIVEN.values()} <= planned(finished)
    finally:
        for path, content in kept.items():
            path.write_bytes(content)


def test_a_time_in_the_future(finished):
    """Before, a run failed in the middle, and the next one said that nothing was to be done."""
    path = finished / "survey/planes.csv"
    os.utime(path, (time.time() + 9999,) * 2)
    done = velocal_run(finished, "--cores", "2")
    os.utime(path, (OLD_S, OLD_S))
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert "survey.planes: survey/planes.csv: its time is in the future" in said
    assert "Hint: Set it to now: touch survey/planes.csv" in said
    assert "Traceback" not in said


def test_a_missing_result_is_made_again(finished):
    """Also in the middle, where a job that failed has left none."""
    missing = finished / f"results/survey/{POSITION}.json"
    content = missing.read_bytes()
    missing.unlink()
    rules = planned(finished)
    missing.write_bytes(content)
    assert {"adjust_survey", "assign_medians", "write_report"} <= rules


def test_a_setting_of_checks_and_adjustment(copied):
    """Before, the checks ran again and hid that the adjustment had to run too: exit code 0."""
    calibration = f"results/calibrations/{SCANNER}/all.json"
    before, config = (copied / calibration).read_bytes(), (copied / "config.yaml").read_text()
    fill_in(copied / "config.yaml", ("edge_cm: 5 ", "edge_cm: 9 "))
    for expected in (False, True):
        done = velocal_run(copied, "--cores", "2", calibration)
        assert done.returncode == 0, done.stdout + done.stderr
        assert ((copied / calibration).read_bytes() == before) is expected
        (copied / "config.yaml").write_text(config)


def digests(folder):
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((folder / "results").rglob("*"))
        if path.is_file() and not {"logs", "benchmarks"} & set(path.parts)
    }


def begun(folder):
    """A run in a process group of its own, and in the middle of a job."""
    for name in ("statistics/validation", "tables"):
        for path in (folder / "results" / name).rglob("*.*"):
            path.unlink()
    command = [sys.executable, "-m", "velocal.cli", "run", "--cores", "1"]
    process = subprocess.Popen(
        command, cwd=folder, env=environment(folder), start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while not any((folder / ".snakemake/incomplete").iterdir()):
        assert process.poll() is None
        time.sleep(0.05)
    return process


def test_a_killed_run_is_continued(finished):
    """Without --unlock or --rerun-incomplete; the jobs that live on are waited for.

    `benchmarks/kills.py` kills in other ways too, at random times.
    """
    before = digests(finished)
    process = begun(finished)
    process.kill()
    process.wait()
    assert len(digests(finished)) < len(before)
    done = velocal_run(finished, "--cores", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    assert digests(finished) == before


def test_two_runs_at_once(finished):
    """The second is told, and changes nothing; a dry run is allowed."""
    before = digests(finished)
    process = begun(finished)
    process.send_signal(signal.SIGSTOP)
    second, dry = velocal_run(finished, "--cores", "2"), planned(finished)
    process.send_signal(signal.SIGCONT)
    assert process.wait() == 0
    assert second.returncode == 1
    assert f"another run is at work there (process {process.pid})" in second.stdout + second.stderr
    assert "write_report" in dry
    assert digests(finished) == before


def test_no_room_in_the_middle_of_a_run(copied):
    """The table of returns is larger than what fits: a message, and all is well with more room."""
    before = digests(copied)
    target = "results/returns/monday/beginning.parquet"
    (copied / target).unlink()
    run = ("velocal.cli", "run", "--cores", "1", target)
    done = completed(copied, *run, max_file_bytes=250_000)
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert "beginning.parquet: cannot be written: File too large" in said
    assert "Hint: The limit of the size of a file is reached" in said
    assert "Traceback" not in said
    assert not list((copied / "results").rglob("*.part"))
    done = completed(copied, *run)
    assert done.returncode == 0, done.stdout + done.stderr
    assert digests(copied) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everything")
def test_results_that_are_read_only(finished):
    folder = finished / "results/returns/monday"
    (folder / "middle.parquet").unlink()
    folder.chmod(0o500)
    done = velocal_run(finished, "--cores", "1")
    folder.chmod(0o700)
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert "is write-protected" in said
    assert "Traceback" not in said
    assert velocal_run(finished, "--cores", "2").returncode == 0
