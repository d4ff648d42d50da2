"""Faults that were planted in the tiny study are seen in its frozen numbers, and the check says so.

Each fault is planted into what the rules call, the stages behind it run again through the real
scripts, and the comparison with the frozen numbers has to name a file in which it shows.
"""

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import reduce_recording
import residuals_calibration
import yaml
from support.frozen import FILES, differences
from support.in_process import Rules

from velocal.evaluation.candidates import Candidate, Role
from velocal.scanner.parameters import LaserParameters

pytestmark = pytest.mark.workflow

#: Outputs of the stages, in their order, of the sample sa3 and of its scanner.
STAGES = {
    "simulation": ("simulation/recordings/sa3.bin", "simulation/factory", "simulation/truth"),
    "recording": ("recordings/sa3", "returns/sa3", "medians/sa3", "assigned/sa3"),
    "calibration": ("adjustment/sa3", "parameter_sets/HDL-64E"),
    "validation": ("residuals/sa3", "statistics", "tables"),
}


@dataclass(frozen=True)
class Study:
    """A copy of the finished tiny study, which is the current folder."""

    folder: Path

    def again_from(self, stage: str) -> list[str]:
        """Differences from the frozen numbers after a stage and all later ones have run again."""
        for name in list(STAGES)[list(STAGES).index(stage) :]:
            for path in STAGES[name]:
                place = self.folder / "results" / path
                shutil.rmtree(place) if place.is_dir() else place.unlink()
        rules = Rules(self.folder, yaml.safe_load(Path("config/config.yaml").read_text()))
        for name in FILES:
            rules.make(f"results/{name}")
        return [line for name in FILES for line in differences(name, self.folder / "results")]


@pytest.fixture
def study(tiny_study, tmp_path, monkeypatch):
    ignored = shutil.ignore_patterns(".*", "outdoor", "map", "figures", "logs")
    folder = shutil.copytree(tiny_study, tmp_path / "study", ignore=ignored)
    monkeypatch.chdir(folder)
    return Study(folder)


def test_stages_that_run_again_without_a_fault_give_the_frozen_numbers(study):
    assert study.again_from("calibration") == []


def test_a_wrong_sigma(study, monkeypatch):
    right = residuals_calibration.statistics_table
    monkeypatch.setattr(
        residuals_calibration,
        "statistics_table",
        lambda heading, candidates, data, sigma_m: right(heading, candidates, data, 1.5 * sigma_m),
    )
    lines = study.again_from("validation")
    assert any(line.startswith("tables/table_2.csv: within_1sigma_pct differs") for line in lines)


def test_one_window_in_place_of_three(study, monkeypatch):
    right = reduce_recording.window_rotations
    monkeypatch.setattr(
        reduce_recording,
        "window_rotations",
        lambda index, window, length, where: right(index, "middle", length, where),
    )
    lines = study.again_from("recording")
    assert any(line.startswith("statistics/summary.csv: rms_cm differs") for line in lines)


def test_the_wrong_sign_of_alpha(study, monkeypatch):
    right = LaserParameters.corrected

    def corrected(self, corrections):
        return right(self, corrections | {"alpha": -np.asarray(corrections["alpha"])})

    monkeypatch.setattr(LaserParameters, "corrected", corrected)
    lines = study.again_from("calibration")
    assert any(line.startswith("parameter_sets/HDL-64E/set1.csv: alpha_rad") for line in lines)
    assert any(line.startswith("statistics/summary.csv: rms_cm differs") for line in lines)


def test_before_and_after_exchanged(study, monkeypatch):
    other = {Role.FACTORY: Role.WINDOW, Role.WINDOW: Role.FACTORY}
    monkeypatch.setattr(
        residuals_calibration, "Candidate", lambda role, *rest: Candidate(other[role], *rest)
    )
    lines = study.again_from("validation")
    assert any(line.startswith("tables/table_2.csv: std_cm differs") for line in lines)


def test_a_world_with_larger_errors(study):
    path = Path("config/world.yaml")
    world = yaml.safe_load(path.read_text())
    world["scanners"]["HDL-64E"]["errors"]["dl_cm"] = 3.5
    path.write_text(yaml.safe_dump(world))
    lines = study.again_from("simulation")
    assert any(line.startswith("tables/table_2.csv: std_cm differs") for line in lines)
