"""The inverse of every dialect gives back the raw values, for every scanner and two-point files."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.test_every_dialect import unit

from velocal.calibration.applied import AppliedCalibration
from velocal.calibration.dialects import DIALECTS
from velocal.calibration.inverse import raw_values
from velocal.scanner.models import AZIMUTH_TICK_DEG, SCANNERS

TICK = np.deg2rad(AZIMUTH_TICK_DEG)


def between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angles between directions, radians."""
    return np.abs(np.mod(one - other + np.pi, 2 * np.pi) - np.pi)


@pytest.mark.parametrize("scanner", SCANNERS)
@pytest.mark.parametrize("name", DIALECTS)
@settings(max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.floats(1.0, 30.0),
    rounded=st.booleans(),
    nearest_m=st.floats(0.3, 30.0),
)
def test_raw_values_come_back(scanner, name, seed, rate_hz, rounded, nearest_m):
    """All lasers at any azimuth and range, with near-point corrections of centimetres."""
    known, rng = SCANNERS[scanner], np.random.default_rng(seed)
    applied = AppliedCalibration(DIALECTS[name], unit(known), known, rate_hz)
    laser = np.arange(known.n_lasers)
    distance = np.rint(rng.uniform(nearest_m, 4 * nearest_m, len(laser)) / known.distance_tick_m)
    azimuth = rng.integers(0, 36_000, len(laser)) * TICK
    phi = azimuth + 2 * np.pi * rate_hz * known.azimuth_delay_s[laser]
    xyz = applied.points(distance * known.distance_tick_m, phi, laser, rounded=rounded)
    found = applied.raw(xyz, laser, rounded=rounded)
    np.testing.assert_allclose(
        found.distance_m, distance * known.distance_tick_m, rtol=0, atol=1e-7
    )
    assert (between(found.azimuth, azimuth) * distance * known.distance_tick_m).max() < 1e-7
    assert found.residual_m.max() < 1e-7
    # With the rounding of a file: single precision, and millimetres in LAS.
    near = distance * known.distance_tick_m < 24.0
    for digits, moved_m in ((np.float32(xyz).astype(float), 1e-5), (np.round(xyz, 3), 1e-3)):
        again = applied.raw(digits, laser, rounded=rounded)
        off = np.abs(again.distance_m - found.distance_m)
        assert off[near].max(initial=0.0) < moved_m


@pytest.mark.parametrize("name", ["manual", "velodyne_decoder", "ros"])
def test_a_point_that_no_raw_value_makes_has_its_distance_from_the_cone(name):
    """Raised by 5 cm along the normal of the cone, and within the offset of a laser."""
    known, dialect = SCANNERS["HDL-64E"], DIALECTS[name]
    numbers, laser = unit(known), np.arange(64)
    azimuth = np.linspace(0.0, 6.0, 64)
    xyz = dialect.points(np.full(64, 12.0), azimuth, laser, numbers)
    theta = azimuth - numbers.alpha
    steep, flat = np.sin(numbers.v), np.cos(numbers.v)
    normal = np.stack([-steep * np.sin(theta), -steep * np.cos(theta), flat], axis=-1)
    found = raw_values(dialect, xyz + 0.05 * normal, laser, numbers)
    # Near-point corrections stretch a cone by a few millimetres per metre.
    np.testing.assert_allclose(found.residual_m, 0.05, atol=5e-4)
    inside = raw_values(dialect, np.zeros((64, 3)), laser, numbers)
    assert np.isnan(inside.residual_m[numbers.hoff != 0]).all()
