"""The workflow in other surroundings: as a module of another one, and with a storage plugin.

The module comes from a git repository, as snakedeploy writes it.
"""

import json
import os
import re
import shutil
import subprocess

import pytest
from support.running import ROOT, copy_project, snakemake

from velocal.simulation.example import write_example

pytestmark = [
    pytest.mark.workflow,
    pytest.mark.skipif(shutil.which("git") is None, reason="there is no git"),
]

SNAKEFILE = """\
configfile: "config.yaml"


module velocal:
    snakefile: "git+file://{repository}/workflow/Snakefile@{commit}"
    config: config


use rule * from velocal
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The example, whose Snakefile names a commit of a repository."""
    folder = tmp_path_factory.mktemp("module")
    repository = copy_project(folder / "repository")
    git = ["git", "-C", str(repository), "-c", "user.name=a", "-c", "user.email=a@example.org"]
    for command in (["init", "-q"], ["add", "-A", "-f"], ["commit", "-qm", "All"]):
        subprocess.run([*git, *command], check=True)
    told = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
    write_example(folder / "study")
    (folder / "study/Snakefile").write_text(
        SNAKEFILE.format(repository=repository, commit=told.stdout.strip())
    )
    return folder / "study"


def test_it_plans(study):
    done = snakemake(study, "--cores", "2", "--dry-run", "all")
    assert done.returncode == 0, done.stdout + done.stderr
    rules = set(re.findall(r"^(?:local)?rule (\w+):", done.stdout + done.stderr, re.MULTILINE))
    assert {"index_recording", "adjust_survey", "adjust_unit", "write_report"} <= rules


def test_it_runs(study):
    """A job whose script comes out of the repository."""
    done = snakemake(study, "--cores", "1", "results/survey/P5.json")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (study / "results/survey/P5.json").stat().st_size > 0


def test_environments_by_conda_are_refused(study):
    done = snakemake(study, "--cores", "1", "--dry-run", "--software-deployment-method", "conda")
    assert done.returncode == 1
    said = done.stdout + done.stderr
    assert "Hint: Make the environment yourself, as environment.yml says" in said


def test_a_recording_behind_a_storage_plugin(tmp_path, monkeypatch):
    """Its address stands in the sample table; it is fetched for the jobs that read it."""
    study = tmp_path / "study"
    write_example(study)
    shutil.move(study / "captures", tmp_path / "box")
    table = study / "samples.tsv"
    table.write_text(table.read_text().replace("captures/", "box://"))
    monkeypatch.setenv("BOX", str(tmp_path / "box"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "src"), prepend=os.pathsep)
    ledger = "results/recordings/monday/ledger.json"
    refused = snakemake(study, "--cores", "1", ledger)
    assert "No storage provider found for query box://monday.pcap.gz" in refused.stderr
    plugin = str(ROOT / "tests/support/storage")
    monkeypatch.setenv("PYTHONPATH", plugin, prepend=os.pathsep)
    done = snakemake(study, "--cores", "1", ledger)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads((study / ledger).read_text())["file"] == "monday.pcap.gz"
