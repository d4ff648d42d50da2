"""A real run refuses what the catalogue says that it refuses, with the same message."""

import pytest
from catalogue import configuration, tables
from catalogue.case import run
from support.running import snakemake

pytestmark = pytest.mark.workflow

CASES = {case.wrong: case for case in (*configuration.CASES, *tables.CASES)}


@pytest.mark.parametrize(
    "wrong", ["aliases of keys that multiply", "`results: a/../..`", "survey: 1e308 m"]
)
def test_refused(wrong, tmp_path):
    for name in ("alone", "run"):
        (tmp_path / name).mkdir()
    expected = run(CASES[wrong], tmp_path / "alone")
    CASES[wrong].make(tmp_path / "run")
    done = snakemake(tmp_path / "run", "--dry-run", "--cores", "1")
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert expected.message in said
    assert expected.hint in said
    assert "Traceback" not in said
    assert not (tmp_path / "run/results").exists()
