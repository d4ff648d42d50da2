"""Calibrations on clouds: those of `velocal points`, of KITTI, and of scanners of other makers."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import clouds
from support.chain import study_world
from support.kitti import street_scan
from typer.testing import CliRunner

from velocal.calibration.files import formats
from velocal.chain import points_of
from velocal.cli import app
from velocal.evaluation.plane_search import find_planes
from velocal.evaluation.planes_in_data import Search, fit_patches
from velocal.evaluation.unsurveyed import Seen, _datum, adjust_unsurveyed, unsurveyed_settings
from velocal.io import storage
from velocal.recording.cloud import read_cloud
from velocal.recording.recording import open_recording
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.simulation import capture, truth
from velocal.study.planes import Box, PlaneSearch
from velocal.study.scanner_file import read_scanner

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


#: Boxes that leave out the corners between the road and the fronts, axes of the scanner frame.
BOXES = {
    "road": ((-5.5, 5.0), (-8, 11), (-2.2, -1.4)),
    "left": ((-9.6, -8.4), (-5, 11), (-1.2, 5)),
    "right": ((4.0, 9.0), (-6, 11), (-1.2, 5)),
    "front": ((-6, 5), (13, 15.5), (-1.2, 5)),
    "back": ((-2, 5), (-11.5, -10.5), (-1.2, 5)),
}


def on_boxes(path: Path, scanner, parameters, **how):
    """Adjustment on the planes of the boxes."""
    found = read_cloud(path, scanner, parameters, dialect="paper", **how)
    cloud = points_of(found.returns.medians(azimuth_bin_deg=1.8, min_count=1), parameters)
    boxes = {n: Box(x_m=x, y_m=y, z_m=z) for n, (x, y, z) in BOXES.items()}
    wide = SEARCH.model_copy(update={"min_points": 50, "incidence_deg": 84.0, "extent_m": 40.0})
    planes, _ = fit_patches(cloud, boxes, Search.from_config(wide))
    assert len(planes) == len(BOXES)
    seen = Seen("street", cloud, tuple(planes))
    return adjust_unsurveyed([seen], unsurveyed_settings(scanner, parameters))


@pytest.mark.slow
def test_the_common_vertical_angle_of_kitti_is_seen(tmp_path):
    """0.2 deg between the beams and the file with which a cloud without rings was computed.

    The road is a cone then. No real scan of KITTI is at hand: this one is simulated.
    """
    scanner, wrong = SCANNERS["HDL-64E"], np.deg2rad(0.2)
    used = nominal(scanner)
    used = replace(used, voff=used.voff - used.voff.mean())
    scan, _ = street_scan(replace(used, v=used.v + wrong), used, sigma_m=0.02)
    path = tmp_path / "000000.bin"
    path.write_bytes(scan.tobytes())
    output = tmp_path / "rings.json"
    done = CliRunner().invoke(
        app,
        ["calibration", "from-cloud", str(path), "-o", str(output), "--scanner", "HDL-64E"],
    )
    assert done.exit_code == 0, done.output
    rings = formats.read_for(output, scanner).parameters
    # Only what the points were computed with is in the cloud, not what is right.
    np.testing.assert_allclose(rings.v, used.v, atol=np.deg2rad(0.001))
    np.testing.assert_allclose(rings.voff, used.voff, atol=1e-3)
    unit = on_boxes(path, scanner, rings)
    common = {each.name: each for each in unit.common}["v"]
    assert common.by_survey_std < np.deg2rad(0.06)
    assert abs(common.by_survey - wrong) < 2.5 * common.by_survey_std
    assert common.by_survey > 3.0 * common.by_survey_std
    # It is clear enough to be applied, though no single laser shows its own angle.
    assert abs(common.value - wrong) < 2.5 * common.std
    found = unit.calibration
    assert (unit.determined[found.observed, 2] < 0.5).all()
    np.testing.assert_allclose(found.corrections[found.observed, 2], common.value, atol=1e-4)
    assert (found.std[found.observed, 2] > 0.9 * common.std).all()
    assert "deg higher than the file says" in _datum(unit)[1]


def test_a_scanner_that_a_file_describes(tmp_path):
    """Sixteen lasers of another maker, numbered from the highest down, with wrong distances."""
    angles = np.linspace(15.0, -15.0, 16)
    text = f"""\
name: ACME-16
lasers: 16
vertical_deg: {angles.tolist()}
distance_tick_m: 0.001
azimuth_bin_deg: 0.36
range_sigma_m: 0.01
min_range_m: 0.5
max_range_m: 60
"""
    (tmp_path / "acme.yaml").write_text(text)
    scanner = read_scanner(tmp_path / "acme.yaml")
    used = nominal(scanner)
    dl = np.random.default_rng(2).normal(0.0, 0.02, 16)
    scan, laser = street_scan(replace(used, dl=dl), used, sigma_m=0.01)
    columns = dict(zip(("x", "y", "z", "intensity"), scan.T, strict=True))
    path = tmp_path / "a.pcd"
    path.write_bytes(clouds.pcd(columns | {"channel": laser.astype("u1")}))
    found = on_boxes(path, scanner, used, frame="ros").calibration
    left = dl - found.adjusted.dl
    assert np.std(dl) > 0.015
    # A hundred medians of 1 cm each, and what the lasers have in common is hardly seen.
    assert np.std(left) < 0.003
    told = CliRunner().invoke(
        app, ["inspect", str(path), "--dialect", "paper", "--frame", "ros", "--json",
              "--scanner", str(tmp_path / "acme.yaml")],
    )  # fmt: skip
    assert told.exit_code == 0, told.output
    facts = json.loads(told.output)
    assert facts["scanner"] == "ACME-16"
    assert facts["points_used"] == facts["points"] == len(scan)
