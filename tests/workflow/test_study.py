"""A tiny study really runs; a second run is idle; what changed, and only that, runs again."""

import hashlib
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from support.running import completed, copy_project, snakemake
from support.tiny import NEW_ROW, SECOND_POSITION, make_tiny

from velocal.calibration.files import formats
from velocal.simulation.truth import factory_parameters
from velocal.simulation.world import load

pytestmark = pytest.mark.workflow


@pytest.fixture
def finished(tiny_study) -> Path:
    return tiny_study


def planned(folder: Path, *arguments: str) -> list[tuple[str, str]]:
    """Rule and wildcards of every job of a dry run."""
    return jobs_of(folder, "--dry-run", *arguments)


def jobs_of(folder: Path, *arguments: str) -> list[tuple[str, str]]:
    """Rule and wildcards of every job of a run."""
    done = snakemake(folder, "--cores", "2", *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    jobs = re.findall(
        r"^(?:local)?(?:rule|checkpoint) (\w+):\n(?:    (?!wildcards).*\n)*"
        r"(?:    wildcards: (.*)\n)?",
        done.stdout + done.stderr,
        flags=re.MULTILINE,
    )
    return sorted(set(jobs) - {("default", ""), ("all", "")})


def digests(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((folder / "results").rglob("*"))
        if path.is_file() and not {"logs", "benchmarks", ".snakemake"} & set(path.parts)
    }


@pytest.fixture
def edited(finished):
    """The finished project, with every file that a test writes to put back afterwards."""
    kept: dict[Path, bytes] = {}

    def append(name: str, text: str) -> Path:
        path = finished / name
        kept.setdefault(path, path.read_bytes())
        with path.open("a") as file:
            file.write(text)
        return finished

    yield append
    for path, content in kept.items():
        path.write_bytes(content)


def test_results_are_there(finished):
    results = finished / "results"
    for name in (
        "report.html",
        "tables/table_2.tex",
        "tables/table_5.md",
        "figures/figure_11.png",
        "figures/figure_13.svg",
        "figures/figure_24.png",
        "figures/figure_18.csv",
        "parameter_sets/HDL-64E/set1.xml",
        "parameter_sets/HDL-32E/set1.yaml",
        "simulation/truth/HDL-64E.csv",
        "survey/network.png",
    ):
        assert (results / name).stat().st_size > 0
    accuracy = pd.read_csv(results / "survey/network.csv")
    assert list(accuracy["item"]) == ["control_points", "targets", "base_field", "base_scanner"]
    summary = pd.read_csv(results / "statistics/summary.csv")
    # Two samples, three windows, both data, before and after; and the calibration of the HDL-32E.
    assert len(summary) == 2 * 3 * 4 + 3
    assert summary["rms_cm"].notna().all()
    pair = summary.query("data == 'calibration' and sample == 'sa3'").groupby("role")
    assert pair["rms_cm"].mean()["window"] < 0.6 * pair["rms_cm"].mean()["factory"]


def test_where_time_went_is_summed_up(finished):
    """Written when the run ends, from what Snakemake measured."""
    folder = finished / "results/benchmarks"
    rules = pd.read_csv(folder / "summary.csv", index_col="rule")
    assert rules.loc[["adjust_lasers", "make_table"], "jobs"].tolist() == [2, 1]
    assert (rules["wall_s"] > 0).all()
    assert rules.loc["adjust_unit", "memory_mb"] > 50
    assert "| adjust_lasers | 2 |" in (folder / "summary.md").read_text()


def test_second_run_is_idle(finished):
    done = snakemake(finished, "--cores", "2")
    assert done.returncode == 0
    assert "Nothing to be done" in done.stdout + done.stderr


def test_an_edited_module_reruns_only_rules_that_import_it(finished, edited):
    edited("src/velocal/reporting/style.py", "\nEDITED = 1\n")
    drawn = {"draw_lasers", "draw_histogram", "draw_network", "draw_plan", "draw_panels"}
    drawn |= {"draw_corrections", "draw_diagram", "map_residuals", "measure_unit_drift"}
    # The judgement comes after the report.
    assert {rule for rule, _ in planned(finished)} == drawn | {"write_report", "judge_calibrations"}


def test_an_edited_module_in_the_middle(finished, edited):
    edited("src/velocal/adjustment/average.py", "\nEDITED = 1\n")
    rules = {rule for rule, _ in planned(finished)}
    assert "average_set" in rules
    assert "residuals_validation" in rules
    assert not rules & {"decode_returns", "reduce_medians", "adjust_lasers", "simulate_recording"}


def test_a_comment_or_a_docstring_reruns_nothing(finished, edited):
    """Every script imports this module."""
    edited("src/velocal/errors.py", '\n# A comment.\n"""And a text that nothing reads."""\n')
    assert planned(finished) == []


def test_a_new_row_plans_its_sample_and_what_depends_on_it(finished, tmp_path):
    """Which adjustments must run again is known when the checks of the survey are done."""
    folder = tmp_path / "project"
    shutil.copytree(finished, folder)
    with (folder / "config/samples.tsv").open("a") as sheet:
        sheet.write(NEW_ROW)
    jobs = [*jobs_of(folder, "results/survey/checks.csv"), *planned(folder)]
    assert {re.search(r"sample=(\w+)", w)[1] for _, w in jobs if "sample=" in w} == {"sa6"}
    assert {w for rule, w in jobs if rule == "adjust_survey"} == {"position=P6"}
    of_all = {rule for rule, w in jobs if "sample=" not in w and rule != "adjust_survey"}
    # Summaries, and what is made of them: the new sample belongs to no set.
    assert of_all <= {
        "check_survey", "summarise_statistics", "make_table", "draw_lasers", "draw_diagram",
        "map_residuals", "write_report", "judge_calibrations",
    }  # fmt: skip


def test_one_process_gives_the_same_bytes(finished, tmp_path, root, monkeypatch):
    """Neither the order of the jobs counts nor what an earlier one left in the memory."""
    folder = copy_project(tmp_path / "project")
    make_tiny(folder)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, (root / "tests", root / "scripts"))))
    here = digests(finished)
    done = completed(folder, "support.in_process", *here)
    assert done.returncode == 0, done.stdout + done.stderr
    there = digests(folder)
    assert set(here) == set(there)
    assert [name for name in here if here[name] != there[name]] == []


def test_root_and_workflow_plan_the_same(tmp_path):
    folder = copy_project(tmp_path / "project")
    make_tiny(folder)
    jobs = planned(folder)
    assert jobs == planned(folder, "--snakefile", "workflow/Snakefile")
    assert len(jobs) > 35


def test_number_of_jobs(tmp_path):
    """The start of a job takes longer than most of them: what belongs together is one job."""
    jobs = planned(copy_project(tmp_path / "project"))
    assert len(jobs) < 85
    of_a_sample = [job for job in jobs if "sample=sa1" in job[1]]
    of_no_sample = [job for job in jobs if "sample=" not in job[1]]
    # A study of 300 samples, each at a position of its own.
    assert len(of_no_sample) + 300 * (len(of_a_sample) + 1) <= 2500


def test_nothing_downstream_sees_the_truth(tmp_path):
    folder = copy_project(tmp_path / "project")
    make_tiny(folder)
    with (folder / "config/samples.tsv").open("a") as sheet:
        sheet.write(SECOND_POSITION)
    with (folder / "config/config.yaml").open("a") as config:
        config.write("methods: {scanner: HDL-64E, calibration: [sa3], other: [sa1]}\n")
    done = snakemake(folder, "--dry-run", "--cores", "2")
    text = done.stdout + done.stderr
    blocks = re.findall(r"^(?:local)?rule (\w+):\n    input: (.*)$", text, flags=re.MULTILINE)
    # The comparison of methods tells errors against the truth; nothing is adjusted with them.
    readers = {rule for rule, inputs in blocks if "/truth/" in inputs}
    assert readers - {"all", "default"} == {"compare_methods"}
    used = {rule for rule, inputs in blocks if "/methods/" in inputs}
    assert used <= {"all", "default", "write_report"}
    seen = {rule for rule, inputs in blocks if "world.yaml" in inputs}
    makers = {"simulate_recording", "simulate_outdoor", "simulate_factory", "simulate_survey"}
    assert seen == makers
    assert planned(folder, "coverage") == [("coverage", "")]


def test_a_study_starts_from_its_own_recording(tmp_path):
    """`embedded` in the sample table: no calibration file is handed over, and none is made."""
    folder = copy_project(tmp_path / "project")
    make_tiny(folder)
    config = folder / "config/config.yaml"
    for sheet in (folder / "config").glob("*.tsv"):
        text = sheet.read_text().replace("results/simulation/factory/HDL-64E.xml", "embedded")
        sheet.write_text(text)
    # The table takes 4160 packets from where it begins: 24 rotations hold it for sure.
    config.write_text(config.read_text().replace("rotations: 12", "rotations: 24"))
    asked = "results/adjustment/sa3/beginning.csv"
    jobs = planned(folder, asked)
    # The calibration comes out of the one scan; the other scanner takes part in the checks only.
    assert [where for rule, where in jobs if rule == "index_recording_with_calibration"] == [
        "sample=sa3"
    ]
    assert [where for rule, where in jobs if rule == "index_recording"] == ["sample=sa5"]
    assert [where for rule, where in jobs if rule == "simulate_factory"] == ["scanner=HDL-32E"]
    done = snakemake(folder, "--cores", "2", asked)
    assert done.returncode == 0, done.stdout + done.stderr
    assert pd.read_csv(folder / asked)["dl_std_m"].notna().all()
    factory = formats.read(folder / "results/recordings/sa3/calibration.xml", 64)
    world = load(yaml.safe_load((folder / "config/world.yaml").read_text()))
    stated = factory_parameters(world, "HDL-64E")
    assert np.abs(factory.dl - stated.dl).max() <= 0.5e-3 * (1 + 1e-9)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("config/config.yaml", "colour: red\n", "unknown key 'colour'"),
        ("config/samples.tsv", NEW_ROW.replace("sa6", "../../evil"), "is not a name"),
        ("config/samples.tsv", NEW_ROW.replace("sa6", "sa5"), "occurs twice"),
        (
            "config/samples.tsv",
            NEW_ROW.replace("results/simulation/recordings/sa6.bin", "gone.pcap"),
            "no file 'gone.pcap'",
        ),
        ("config/world.yaml", "gravity: 9.81\n", "unknown key 'gravity'"),
    ],
)
def test_faults_end_in_one_message(finished, edited, file, text, message):
    edited(file, text)
    before = digests(finished)
    done = snakemake(finished, "--cores", "2")
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert message in said
    assert "Hint:" in said or "allowed:" in said
    assert "Traceback" not in said
    assert digests(finished) == before


def test_a_scanner_that_is_not_what_is_said(finished, edited):
    """The fault shows inside a job: its message, no traceback, and nothing half-written."""
    row = NEW_ROW.replace("results/simulation/recordings/sa6.bin", "captures/vlp.bin")
    (finished / "captures").mkdir(exist_ok=True)
    source = finished / "results/simulation/recordings/sa3.bin"
    (finished / "captures/vlp.bin").write_bytes(source.read_bytes()[: 1248 * 2000])
    edited("config/samples.tsv", row)
    done = snakemake(finished, "--cores", "1", "results/recordings/sa6/ledger.json")
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert "is said to come from HDL-32E" in said
    assert "Hint: Correct the scanner" in said
    assert "Traceback" not in said
    assert not (finished / "results/recordings/sa6/ledger.json").exists()
