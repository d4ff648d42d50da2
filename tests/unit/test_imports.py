"""What is imported at the start: a job of the workflow often takes less time than pandas."""

import subprocess
import sys

import pytest
from support.running import ROOT

from velocal.calibration import convert
from velocal.calibration.dialects import DIALECTS
from velocal.cli import names
from velocal.points.files import FORMATS
from velocal.scanner.models import SCANNERS

HEAVY = ("jinja2", "matplotlib", "pandas", "pyarrow", "pydantic", "scipy", "yaml")


def imported(module: str) -> set[str]:
    code = f"import sys, {module}; print(*sys.modules)"
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, cwd=ROOT / "scripts", capture_output=True, text=True, check=True, timeout=60
    )
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("module", "without"),
    [
        ("velocal", (*HEAVY, "numpy")),
        ("velocal.cli", (*HEAVY, "numpy")),
        ("index_recording", ("matplotlib", "pandas", "pydantic", "scipy")),
        ("reduce_recording", ("matplotlib", "pandas", "pydantic", "scipy")),
        ("simulate_recording", ("matplotlib", "pandas", "scipy")),
        ("assign_medians", ("matplotlib", "pandas", "scipy")),
        ("adjust_survey", ("matplotlib", "pandas", "scipy")),
        ("adjust_lasers", ("matplotlib", "pandas", "scipy")),
        ("residuals_validation", ("matplotlib", "pandas", "scipy")),
        ("average_set", ("matplotlib", "pandas", "scipy")),
        ("simulate_survey", ("matplotlib", "pandas", "scipy")),
        ("measure_panels", ("matplotlib", "pandas", "scipy")),
        ("judge_claims", ("matplotlib", "scipy.linalg")),
        ("map_residuals", ("pandas", "scipy")),
        ("draw_histogram", ("pandas", "scipy")),
        ("draw_map", ("pandas", "scipy")),
        ("make_table", ("matplotlib", "scipy.optimize")),
    ],
)
def test_only_what_is_needed_is_imported(module, without):
    assert not imported(module) & set(without)


def test_tables_are_written_and_read_without_pandas(tmp_path):
    """pyarrow imports it to convert columns: 0.3 s of every job that reads or writes a table."""
    code = f"""
import sys
from pathlib import Path
import numpy as np
from velocal.io import schemas, storage
path = Path({str(tmp_path / "rotations.parquet")!r})
plain = {{name: np.arange(20) % 2 for name in schemas.ROTATIONS.names}}
columns = {{
    field.name: plain[field.name].astype(field.type.to_pandas_dtype())
    for field in schemas.ROTATIONS
}}
storage.write_table(path, schemas.ROTATIONS, columns)
found, _ = storage.read_table(path, schemas.ROTATIONS)
assert all((found[name] == columns[name]).all() for name in columns)
assert all(found[name].dtype == columns[name].dtype for name in columns)
wider = {{"row": plain["offset"].astype(np.uint32), "plane": plain["block"].astype(np.uint8)}}
wider |= dict.fromkeys(("x_m", "y_m", "z_m", "before_m", "after_m"), np.linspace(0.0, 1.0, 20))
wider["laser_id"] = wider["plane"]
storage.write_table(path, schemas.RESIDUALS, wider)
storage.write_csv(path, {{"laser_id": [0, 1], "mean": np.array([0.5, np.nan]), "kind": ["a", "b"]}})
assert storage.read_csv(path)["mean"][0] == 0.5
print(*sys.modules)
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert "pandas" not in done.stdout.split()


def test_the_help_names_what_there_is():
    """It does so without importing the modules that hold it."""
    assert tuple(SCANNERS) == names.SCANNERS
    assert tuple(DIALECTS) == names.DIALECTS
    assert tuple(FORMATS) == names.SUFFIXES
    assert (convert.RANGES_M, convert.RATE_HZ) == (names.RANGES_M, names.RATE_HZ)
