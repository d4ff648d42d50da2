"""The command line as a user meets it."""

import json
import os
import subprocess
import sys

import pytest
from closed_loop.chain import study_world

from velocal import schemas, storage
from velocal.simulation import capture


def velocal(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "velocal.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        env={
            "PATH": "",
            "COLUMNS": "100",
            "NO_COLOR": "1",
            "PYTHONPATH": os.environ.get("PYTHONPATH", ""),
        },
    )


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("cli") / "x.bin"
    path.write_bytes(b"".join(capture.records(study_world(), "HDL-32E", "P5", "x", 3)) + b"tail")
    return path


def test_inspect(recording):
    done = velocal("inspect", recording)
    assert done.returncode == 0, done.stderr
    for part in ("HDL-32E", "records of 1248 bytes", "cut short", "calibration in stream"):
        assert part in done.stdout
    facts = json.loads(velocal("inspect", "--json", recording).stdout)
    assert facts["scanner"] == "HDL-32E"
    assert facts["ledger"]["unaccounted_bytes"] == 0
    assert facts["ledger"]["rejected"]["record cut short at the end of the file"]["bytes"] == 4


def test_decode(recording, tmp_path):
    out = tmp_path / "new" / "returns.parquet"
    done = velocal("decode", recording, "-o", out, "--window", "beginning", "--rotations", 1)
    assert done.returncode == 0, done.stderr
    columns, facts = storage.read_table(out, schemas.RETURNS)
    assert facts["scanner"] == "HDL-32E"
    assert set(columns["rotation"]) == {1}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["inspect", "nowhere.bin"], "nowhere.bin: cannot be read"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--scanner", "HDL-65"], "allowed: HDL-64E"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--scanner", "HDL-64E"], "Hint: Correct"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--window", "dusk"], "allowed: all, beginning"),
        (["decode", "{r}", "-o", "{t}/x.parquet", "--window", "end"], "too few"),
    ],
)
def test_wrong_calls(recording, tmp_path, arguments, message):
    done = velocal(*(a.format(r=recording, t=tmp_path) for a in arguments))
    assert done.returncode == 1
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_help_and_version():
    assert "inspect" in velocal("--help").stdout
    assert velocal("--version").stdout.startswith("velocal ")
    assert velocal("inspect").returncode == 2
