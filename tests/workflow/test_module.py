"""The workflow as a module of another one, from a git repository, as snakedeploy writes it."""

import re
import shutil
import subprocess

import pytest
from support.running import copy_project, snakemake

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
