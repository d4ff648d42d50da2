"""Every dialect for every scanner: the hardware decides when a laser fires, not its name."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from velocal.calibration.convert import convert, max_point_distance
from velocal.calibration.dialects import DIALECTS, PAPER
from velocal.errors import DialectError
from velocal.scanner.beam import angle_from_ticks, points
from velocal.scanner.models import AZIMUTH_TICK_DEG, SCANNERS
from velocal.scanner.parameters import nominal

#: The same hardware under two names.
TWINS = [("HDL-64E", "HDL-64E-S3"), ("VLP-16", "VLP-16-Hi-Res")]
#: Dialects that compute each laser's azimuth at its own firing time, by scanner.
LATER = {
    "HDL-64E": {"veloview", "velodyne_decoder"},
    "HDL-64E-S3": {"veloview", "velodyne_decoder"},
    "HDL-32E": {"paper", "manual", "manual_s2", "veloview", "mrpt", "velodyne_decoder"},
    "VLP-16": {"paper", "manual", "manual_s2", "ros", "veloview", "mrpt", "velodyne_decoder"},
    "VLP-16-Hi-Res": {
        "paper", "manual", "manual_s2", "ros", "veloview", "mrpt", "velodyne_decoder",
    },
    "VLP-32C": {"paper", "manual", "manual_s2", "veloview", "velodyne_decoder"},
    "VLS-128": {"paper", "manual", "manual_s2", "ros", "veloview", "velodyne_decoder"},
}  # fmt: skip


@pytest.mark.parametrize("name", SCANNERS)
@given(
    ticks=st.lists(st.integers(0, 35_999), min_size=1, max_size=5),
    rate_hz=st.floats(1.0, 30.0),
    distance_m=st.floats(0.5, 200.0),
)
def test_the_dialect_paper_is_the_beam_model(name, ticks, rate_hz, distance_m):
    scanner = SCANNERS[name]
    parameters = nominal(scanner)
    raw = np.repeat(ticks, scanner.n_lasers)
    laser = np.tile(np.arange(scanner.n_lasers), len(ticks))
    distance = np.full(len(raw), distance_m)
    azimuth = PAPER.azimuths(np.deg2rad(raw * AZIMUTH_TICK_DEG), laser, scanner, rate_hz)
    phi = angle_from_ticks(raw, laser, scanner, 2.0 * np.pi * rate_hz)
    np.testing.assert_allclose(azimuth, phi, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        PAPER.points(distance, azimuth, laser, parameters),
        points(distance, phi, laser, parameters),
        rtol=0,
        atol=1e-10,
    )


@pytest.mark.parametrize(("one", "other"), TWINS)
def test_another_name_of_the_same_hardware_gives_the_same_differences(one, other):
    assert SCANNERS[one].n_lasers == SCANNERS[other].n_lasers
    parameters = nominal(SCANNERS[one])
    for first, second in itertools.combinations(DIALECTS.values(), 2):
        pair = (first, parameters), (second, parameters)
        found = [
            max_point_distance(*pair, (25.0, 80.0), scanner=SCANNERS[name], rate_hz=10.0)
            for name in (one, other)
        ]
        np.testing.assert_array_equal(*found, err_msg=f"{first.name}, {second.name}")


@pytest.mark.parametrize("scanner", LATER)
@pytest.mark.parametrize("name", DIALECTS)
def test_lasers_that_fire_later_are_placed_later(scanner, name):
    known = SCANNERS[scanner]
    delays = DIALECTS[name].delays_s(known)
    if name in LATER[scanner]:
        np.testing.assert_array_equal(delays, known.firing_time_s)
        assert delays.max() > 30e-6
    elif (scanner, name) != ("VLP-32C", "mrpt"):
        assert not delays.any()


@pytest.mark.parametrize("scanner", SCANNERS)
@pytest.mark.parametrize("name", DIALECTS)
def test_what_converts_without_objection_gives_the_points_of_the_model(scanner, name):
    """At 80 m and 10 Hz, but for azimuths that are rounded: half of 0.01 deg is 7 mm."""
    design, dialect = nominal(SCANNERS[scanner]), DIALECTS[name]
    laser = np.arange(len(design)).repeat(36)
    ticks = np.tile(np.arange(0, 36_000, 1000), len(design))
    raw = np.full(len(laser), 80.0)
    model = points(
        raw, angle_from_ticks(ticks, laser, SCANNERS[scanner], 20 * np.pi), laser, design
    )
    for rate_hz in (None, 10.0):
        try:
            found = convert(design, PAPER, dialect, scanner=SCANNERS[scanner], rate_hz=rate_hz)
        except DialectError:
            continue
        azimuth = dialect.azimuths(np.deg2rad(ticks * 0.01), laser, SCANNERS[scanner], 10.0)
        distance = np.linalg.norm(dialect.points(raw, azimuth, laser, found) - model, axis=1)
        assert distance.max() < 0.0075


def test_mrpt_takes_every_scanner_of_32_lasers_for_an_hdl32e():
    """It chooses its firing table by the number of lasers, and scales it to the cycle."""
    known, taken_for = SCANNERS["VLP-32C"], SCANNERS["HDL-32E"]
    delays = DIALECTS["mrpt"].delays_s(known)
    np.testing.assert_allclose(
        delays / known.firing_cycle_s, taken_for.firing_time_s / taken_for.firing_cycle_s
    )


@pytest.mark.parametrize("name", ["veloview", "velodyne_decoder"])
def test_unknown_firing_times_are_no_exact_conversion(name):
    """No manual of the HDL-64E-S1 tells when its lasers fire; both programs interpolate."""
    design = nominal(SCANNERS["HDL-64E-S1"])
    with pytest.raises(DialectError, match="firing times of the HDL-64E-S1 are not known"):
        convert(design, PAPER, DIALECTS[name], scanner=SCANNERS["HDL-64E-S1"], rate_hz=10.0)
