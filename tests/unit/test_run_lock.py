"""One run at a time in a folder of results; what a killed run leaves stops nobody."""

import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from velocal.cli import app, run
from velocal.errors import ConfigError, RunError
from velocal.io import run_lock
from velocal.io.run_lock import BEGIN, VARIABLE, begin, join, remove_snakemake_locks


@pytest.fixture
def process(tmp_path, monkeypatch):
    """Makes this process a new one, in an empty folder, as far as locks are concerned."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(VARIABLE, raising=False)
    (tmp_path / "results").mkdir()
    held = []

    def anew():
        monkeypatch.setattr(run_lock, "_held", [])
        held.append(run_lock._held)

    anew()
    yield anew
    for descriptors in held:
        for descriptor in descriptors:
            os.close(descriptor)


def silent(_):
    raise AssertionError("nothing is to be told")


def other(code, **environment):
    """Another process that does something with locks, says so, and lives until it is killed."""
    code = f"from velocal.io.run_lock import *\n{code}\nprint('ready', flush=True)\ninput()"
    started = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | environment,
    )
    assert started.stdout.readline() == b"ready\n"
    return started


def killed(process):
    process.kill()
    process.communicate()


def test_two_runs_at_once(process):
    first = other("begin('results', print)")
    with pytest.raises(RunError, match=rf"results: another run .* \(process {first.pid}\)") as e:
        begin("results", silent)
    assert "Hint: Wait until it has ended" in str(e.value)
    begin("other/results", silent)
    killed(first)


def test_a_killed_run_holds_nothing(process):
    killed(other("begin('results', print)"))
    begin("results", silent)
    assert os.environ[VARIABLE] != BEGIN
    begin("results", silent)  # the second call does nothing


def test_jobs_of_a_killed_run_are_waited_for(process):
    begin("results", silent)
    job = other("join()")
    os.close(run_lock._held.pop())  # as a kill does
    process()
    told = []

    def tell(text):
        told.append(text)
        killed(job)

    begin("results", tell)
    assert len(told) == 1
    assert "Waiting for the end of jobs" in told[0]


def test_a_job_that_comes_after_the_next_run_has_begun(process, monkeypatch):
    begin("results", silent)
    late = os.environ[VARIABLE]
    os.close(run_lock._held.pop())
    process()
    begin("results", silent)
    process()
    monkeypatch.setenv(VARIABLE, late)
    with pytest.raises(RunError, match="was killed, and another one has begun"):
        join()


def test_a_script_outside_of_a_run(process, monkeypatch):
    join()
    monkeypatch.setenv(VARIABLE, BEGIN)
    join()
    assert run_lock._held == []


def test_unfinished_files_are_removed(process, tmp_path):
    results = tmp_path / "results/medians"
    results.mkdir()
    kept = ["middle.parquet", ".hidden", "notes.part", ".x.part"]
    for name in (*kept, ".middle.parquet.0123456789abcdef.part"):
        (results / name).touch()
    begin("results", silent)
    assert sorted(path.name for path in results.iterdir()) == sorted(kept)


def test_locks_of_snakemake(process, tmp_path):
    """Only those that name results of this study: another workflow may run in the same folder."""
    locks = tmp_path / ".snakemake/locks"
    locks.mkdir(parents=True)
    (locks / "0.input.lock").write_text("survey/planes.csv\nresults/report.html\n")
    (locks / "1.output.lock").write_text("results_of_others/x\nsurvey/planes.csv\n")
    remove_snakemake_locks("results")
    assert [path.name for path in locks.iterdir()] == ["1.output.lock"]


def test_no_locks_on_this_file_system(process, monkeypatch):
    def fail(*_):
        raise OSError(run_lock.errno.ENOLCK, "No locks available")

    monkeypatch.setattr(run_lock.fcntl, "flock", fail)
    begin("results", silent)
    assert VARIABLE in os.environ


# ---------------------------------------------------------------------------------- velocal run


@pytest.fixture
def called(process, tmp_path, monkeypatch):
    """Calls `velocal run`, and gives what it would become, and whether it begins a run."""

    def execute(program, command, environment):
        raise SystemExit((command, environment.get(VARIABLE)))

    monkeypatch.setattr(run.os, "execve", execute)

    def call(*arguments):
        done = CliRunner().invoke(app, ["run", *arguments])
        if not isinstance(done.exception, SystemExit):
            raise done.exception
        return done.exception.code

    return call


@pytest.mark.parametrize(
    ("arguments", "expected", "begins"),
    [
        ((), [], True),
        (("report.html",), ["report.html"], True),
        (("--dry-run",), ["--dry-run"], False),
        (("-n", "all"), ["-n", "all"], False),
        (("--configfile", "a.yaml", "b.yaml"), ["--configfile", "a.yaml", "b.yaml"], True),
    ],
)
def test_it_becomes_snakemake(called, tmp_path, arguments, expected, begins):
    (tmp_path / "Snakefile").touch()
    command, value = called("--cores", "2", *arguments)
    assert command[:5] == [sys.executable, "-m", "snakemake", "--cores", "2"]
    assert "--rerun-incomplete" in command
    assert command[len(command) - len(expected) :] == expected
    assert value == (BEGIN if begins else None)
    assert ("--quiet" in command) == begins  # a dry run shows everything


def test_how_much_snakemake_tells_can_be_chosen(called, tmp_path):
    (tmp_path / "Snakefile").touch()
    command, _ = called("--cores", "2", "--verbose")
    assert "--quiet" not in command


def test_without_snakemake_it_says_what_to_install(called, tmp_path, monkeypatch):
    (tmp_path / "Snakefile").touch()
    monkeypatch.setattr(run, "find_spec", lambda name: None)
    with pytest.raises(RunError, match=r"snakemake, which is not installed\nHint: .* pip install"):
        called("--cores", "2")


def test_it_runs_in_the_folder_of_the_study(called, tmp_path):
    (tmp_path / "study").mkdir()
    (tmp_path / "study/Snakefile").touch()
    called("--cores", "1", "--directory", str(tmp_path / "study"))
    assert os.getcwd() == str(tmp_path / "study")  # noqa: PTH109 - a text, like the other


def test_a_folder_without_a_study(called):
    with pytest.raises(ConfigError, match=r"there is no Snakefile .*\n?Hint: Change to the folder"):
        called("--cores", "1")
