"""A cloud that `velocal points` wrote gives the calibration of the packets it was made from."""

from pathlib import Path

import numpy as np
import pytest
from support.chain import study_world
from typer.testing import CliRunner

from velocal.calibration.files import formats
from velocal.chain import points_of
from velocal.cli import app
from velocal.evaluation.plane_search import find_planes
from velocal.evaluation.planes_in_data import Search
from velocal.evaluation.unsurveyed import Seen, adjust_unsurveyed, unsurveyed_settings
from velocal.io import storage
from velocal.recording.cloud import read_cloud
from velocal.recording.recording import open_recording
from velocal.scanner.models import SCANNERS
from velocal.simulation import capture, truth
from velocal.study.planes import PlaneSearch

SCANNER = "HDL-32E"
SEARCH = PlaneSearch(
    planes=3, distance_cm=6.0, extent_m=4.0, min_points=150, incidence_deg=70.0, seed=1
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A simulated recording in a room, and the factory's file."""
    made = tmp_path_factory.mktemp("clouds")
    world = study_world()
    stream = capture.records(world, SCANNER, "P5", "cloud", 4)
    storage.write_blocks(made / "room.bin", stream)
    formats.write(made / "factory.yaml", truth.factory_parameters(world, SCANNER))
    return made


def calibrated(returns, parameters):
    """Corrections without a survey: planes are searched, and adjusted with the lasers."""
    cloud = points_of(returns.medians(azimuth_bin_deg=1.0, min_count=1), parameters)
    planes, _ = find_planes(cloud, Search.from_config(SEARCH))
    settings = unsurveyed_settings(SCANNERS[SCANNER], parameters)
    return adjust_unsurveyed([Seen("room", cloud, tuple(planes))], settings).calibration


@pytest.fixture(scope="module")
def by_packets(folder):
    parameters = formats.read_or_nominal(folder / "factory.yaml", SCANNERS[SCANNER])
    packets = open_recording(folder / "room.bin", SCANNER).returns("all")
    return parameters, packets, calibrated(packets, parameters)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "bound_m", "bound_rad"),
    [
        # Single precision: the ticks of the packets come back, and with them every digit. So they
        # do from PLY and Parquet (tests/unit/test_clouds.py).
        (".pcd", 0.0, 0.0),
        # Millimetres: half of one in a distance, and in an angle at 4 m; medians are better.
        (".las", 5e-4, 1.25e-4),
    ],
)
def test_the_calibration_is_that_of_the_packets(folder, by_packets, suffix, bound_m, bound_rad):
    parameters, packets, expected = by_packets
    path = folder / f"points{suffix}"
    done = CliRunner().invoke(
        app, ["points", str(folder / "room.bin"), "-o", str(path), "--scanner", SCANNER,
              "--calibration", str(folder / "factory.yaml")],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    numbers = formats.read_for(folder / "factory.yaml", SCANNERS[SCANNER])
    found = read_cloud(path, SCANNER, numbers)
    assert found.used == found.points == len(packets.seen)
    again = calibrated(found.returns, parameters)
    for name, bound in (("dl", bound_m), ("alpha", bound_rad), ("v", bound_rad)):
        moved = getattr(again.adjusted, name) - getattr(expected.adjusted, name)
        assert np.abs(moved).max() <= bound
    # The corrections are much larger than these differences.
    assert np.std(expected.adjusted.dl - parameters.dl) > 5e-3
