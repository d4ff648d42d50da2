"""Files for programs are proven on points: the formula of the reader, on planes that were seen."""

from dataclasses import replace

import numpy as np
import pytest
from unit.test_lint import unit

import velocal
from velocal.adjustment.observations import Observations
from velocal.calibration.applied import applied
from velocal.calibration.dialects import DIALECTS
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.evaluation.exported import Observed, exported_columns
from velocal.scanner.models import SCANNERS

RATE_HZ = 10.0


@pytest.fixture(scope="module")
def seen():
    """Shots of a unit onto two walls at 4 m, exact but for the raw distance of 0.1 mm."""
    scanner = SCANNERS["HDL-64E"]
    true = replace(unit(), carried={})
    rng = np.random.default_rng(3)
    laser = np.tile(np.arange(64), 40)
    wall = rng.integers(0, 2, len(laser))
    phi = wall * np.pi / 2.0 + rng.uniform(-0.5, 0.5, len(laser))
    normal = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])[wall]
    data = Observations(np.full(len(laser), 3.0), phi, laser, normal, np.full(len(laser), -4.0))
    data = replace(data, distance_m=data.distance_m - data.misclosure(true))
    assert np.abs(data.misclosure(true)).max() < 1e-9
    return scanner, true, Observed(data, RATE_HZ)


@pytest.mark.parametrize("program", [name for name in DIALECTS if name not in ("paper", "mrpt")])
def test_files_of_every_program_put_points_on_the_planes(seen, program, tmp_path):
    scanner, true, window = seen
    factory = CalibrationFile(true.corrected({"dl": np.full(64, 0.02)}))
    path = tmp_path / "a.json"
    velocal.write_calibration(path, true, scanner, program=program, rate_hz=RATE_HZ)
    found = formats.read_calibration(path)
    table = exported_columns({"a.json": found}, factory, true, [window], scanner)
    assert 1.5 < table["factory_cm"][0] < 2.0  # 2 cm along the beam, across the walls
    assert table["before_cm"][0] > 1.5
    reads_alike = program in ("manual", "manual_s2", "pcl")
    assert (table["before_cm"][0] == table["factory_cm"][0]) == reads_alike
    assert table["model_cm"][0] < 1e-6
    # Rounded azimuths: half of 0.01 deg at 4 m is 0.03 cm along a wall.
    assert table["after_cm"][0] < (0.02 if found.rotation_rate_hz else 1e-6)
    needs = DIALECTS[program].delays_s(scanner).any()
    assert (found.rotation_rate_hz == RATE_HZ) == needs
    # Without the rate the azimuths within a firing are wrong, and the table shows it.
    velocal.write_calibration(path, true, scanner, program=program)
    without = formats.read_calibration(path)
    assert without.rotation_rate_hz is None
    table = exported_columns({"a.json": without}, factory, true, [window], scanner)
    assert (table["after_cm"][0] > 0.1) == needs


@pytest.mark.parametrize("suffix", ["json", "yaml", "xml"])
def test_a_file_states_its_rate_and_is_read_back_at_it(seen, suffix, tmp_path):
    scanner, true, _ = seen
    path = tmp_path / f"a.{suffix}"
    velocal.write_calibration(path, true, scanner, program="veloview", rate_hz=9.87)
    found = formats.read_calibration(path)
    assert found.rotation_rate_hz == 9.87
    np.testing.assert_allclose(velocal.read_parameters(path, scanner).alpha, true.alpha, atol=1e-12)
    # Applied at another rate it is what the program makes of it: a turn by the difference.
    turned = applied(found, scanner, 2 * 9.87).model.alpha - true.alpha
    delays = 2 * np.pi * 9.87 * scanner.firing_time_s
    np.testing.assert_allclose(turned, -delays, atol=1e-12)


def test_the_ros_file_is_another_one_than_that_of_velodyne_decoder(seen, tmp_path):
    """It accepts the YAML of ROS, and is then wrong by the offsets and the azimuths."""
    scanner, true, window = seen
    path = tmp_path / "a.yaml"
    velocal.write_calibration(path, true, scanner, program="ros", rate_hz=RATE_HZ)
    ros = formats.read_calibration(path)
    taken = replace(ros, dialect="velodyne_decoder")
    table = exported_columns({"ros": ros, "taken": taken}, true, true, [window], scanner)
    assert table["after_cm"][0] < 0.02
    assert table["after_cm"][1] > 0.5
