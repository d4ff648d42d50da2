"""The scanner model against its equations, written once more with scalars, and by hand."""

from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest

from velocal.errors import VelocalError
from velocal.scanner import beam as beam_model
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import PARAMETERS, LaserParameters, nominal


def literal_point(l_raw, phi, dl, alpha, v, voff, hoff):
    """Equations (1) and (2) of the paper."""
    length = l_raw + dl
    l_xy = length * cos(v)
    theta = phi - alpha
    return (
        l_xy * sin(theta) - hoff * cos(theta),
        l_xy * cos(theta) + hoff * sin(theta),
        length * sin(v) + voff,
    )


def random_set(n: int, seed: int) -> LaserParameters:
    rng = np.random.default_rng(seed)
    return LaserParameters(
        dl=rng.uniform(-0.5, 1.5, n),
        alpha=rng.uniform(-0.2, 0.2, n),
        v=rng.uniform(-0.6, 0.3, n),
        voff=rng.uniform(0, 0.3, n),
        hoff=rng.uniform(-0.05, 0.05, n),
    )


def test_points_are_those_of_equations_1_and_2():
    rng = np.random.default_rng(1)
    parameters = random_set(64, 2)
    laser = rng.integers(0, 64, 500)
    distance, phi = rng.uniform(0, 120, 500), rng.uniform(-7, 7, 500)
    expected = [
        literal_point(d, p, *(getattr(parameters, name)[k] for name in PARAMETERS))
        for d, p, k in zip(distance, phi, laser, strict=True)
    ]
    found = beam_model.points(distance, phi, laser, parameters)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


def test_beams_are_those_of_equation_3():
    rng = np.random.default_rng(3)
    parameters = random_set(32, 4)
    laser = rng.integers(0, 32, 200)
    phi = rng.uniform(0, 2 * pi, 200)
    direction, origin = beam_model.laser_beams(phi, laser, parameters)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, rtol=1e-14)
    for u, o, p, k in zip(direction, origin, phi, laser, strict=True):
        theta, v = p - parameters.alpha[k], parameters.v[k]
        np.testing.assert_allclose(
            u, [cos(v) * sin(theta), cos(v) * cos(theta), sin(v)], atol=1e-15
        )
        hoff, voff = parameters.hoff[k], parameters.voff[k]
        np.testing.assert_allclose(o, [-hoff * cos(theta), hoff * sin(theta), voff], atol=1e-15)
        # The offset lies across the beam, so it leaves the range as it is.
        assert u @ (o - [0, 0, voff]) == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize(
    ("distance", "phi_deg", "values", "expected"),
    [
        # Ahead is Y, a quarter turn clockwise from above is X, up is Z.
        (5, 0, {}, (0, 5, 0)),
        (5, 90, {}, (5, 0, 0)),
        (5, 180, {}, (0, -5, 0)),
        (5, 270, {}, (-5, 0, 0)),
        (2, 0, {"v": pi / 2}, (0, 0, 2)),
        (2, 0, {"v": -pi / 6}, (0, 2 * 0.75**0.5, -1)),
        (5, 0, {"dl": 0.25}, (0, 5.25, 0)),
        # alpha is subtracted; hoff is to the left of the beam; voff is along Z whatever v is.
        (5, 30, {"alpha": pi / 6}, (0, 5, 0)),
        (5, 0, {"hoff": 0.026}, (-0.026, 5, 0)),
        (5, 90, {"hoff": 0.026}, (5, 0.026, 0)),
        (2, 0, {"v": pi / 2, "voff": 0.2}, (0, 0, 2.2)),
        (10, 0, {"dl": 1.0, "voff": 0.1, "hoff": 0.02, "v": pi / 6}, (-0.02, 9.526279, 5.6)),
    ],
)
def test_by_hand(distance, phi_deg, values, expected):
    parameters = replace(
        LaserParameters(*[np.zeros(1)] * 5), **{name: np.array([v]) for name, v in values.items()}
    )
    found = beam_model.points(
        np.array([float(distance)]), np.deg2rad([float(phi_deg)]), np.array([0]), parameters
    )
    np.testing.assert_allclose(found[0], expected, atol=1e-6)


def test_ticks():
    assert list(beam_model.distance_from_ticks(np.array([0, 1, 65_535], np.uint16), 0.002)) == [
        0.0,
        0.002,
        pytest.approx(131.07),
    ]
    ticks = np.array([0, 9000, 35_999], np.uint16)
    laser = np.zeros(3, int)
    found = beam_model.angle_from_ticks(ticks, laser, SCANNERS["HDL-32E"], 2 * pi * 10)
    np.testing.assert_allclose(found, np.deg2rad([0, 90, 359.99]), rtol=1e-15)


@pytest.mark.parametrize("name", ["HDL-64E", "VLP-16", "VLS-128"])
def test_beams_leave_ticks_once(name):
    scanner, rng = SCANNERS[name], np.random.default_rng(5)
    columns = {
        "laser_id": rng.integers(0, scanner.n_lasers, 50).astype(np.uint8),
        "azimuth": rng.integers(0, 36_000, 50).astype(np.uint16),
        "distance": rng.integers(1, 65_535, 50).astype(np.uint16),
    }
    beams = beam_model.Beams.from_ticks(columns, scanner, 10.0)
    assert len(beams) == 50
    assert beams.tick_m == scanner.distance_tick_m
    np.testing.assert_array_equal(
        beams.distance_m, columns["distance"] * (0.004 if name == "VLS-128" else 0.002)
    )
    np.testing.assert_allclose(
        beams.phi,
        np.deg2rad(columns["azimuth"] * 0.01)
        + 20 * pi * scanner.azimuth_delay_s[columns["laser_id"]],
        rtol=1e-14,
    )
    chosen = columns["distance"] > 30_000
    some, parameters = beams[chosen], nominal(scanner)
    assert 0 < len(some) < 50
    assert some.tick_m == beams.tick_m
    np.testing.assert_array_equal(some.points(parameters), beams.points(parameters)[chosen])


@pytest.mark.parametrize(
    ("name", "laser", "delay_us"),
    [("HDL-32E", 31, 31 * 1.152), ("VLP-16", 15, 15 * 2.304), ("HDL-64E", 63, 0)],
)
def test_the_head_rotates_further_until_later_lasers_fire(name, laser, delay_us):
    found = beam_model.angle_from_ticks(
        np.array([1000], np.uint16), np.array([laser]), SCANNERS[name], 2 * pi * 20
    )
    assert np.rad2deg(found[0]) == pytest.approx(10 + 20 * 360 * delay_us * 1e-6, rel=1e-12)


@pytest.mark.parametrize("name", SCANNERS)
def test_nominal_scanners(name):
    scanner = SCANNERS[name]
    parameters = nominal(scanner)
    assert len(parameters) == scanner.n_lasers
    # No two lasers look the same way, and a firing is over before the next begins.
    aims = np.column_stack([parameters.v, parameters.alpha]).round(6)
    assert len(np.unique(aims, axis=0)) == scanner.n_lasers
    assert scanner.azimuth_delay_s.max() < scanner.firing_cycle_s
    lowest, highest = {
        "HDL-64E": (-24.33, 2.0),
        "HDL-64E-S1": (-24.33, 2.0),
        "HDL-64E-S3": (-24.33, 2.0),
        "HDL-32E": (-30.67, 10.67),
        "VLP-16": (-15, 15),
        "VLP-16-Hi-Res": (-10, 10),
        "VLP-32C": (-25, 15),
        "VLS-128": (-25, 15),
    }[name]
    assert np.rad2deg(parameters.v.min()) == pytest.approx(lowest, abs=0.01)
    assert np.rad2deg(parameters.v.max()) == pytest.approx(highest, abs=0.01)


def test_nominal_is_a_copy():
    scanner = SCANNERS["HDL-64E"]
    before = scanner.vertical_rad.copy()
    nominal(scanner).v[:] = 7
    np.testing.assert_array_equal(scanner.vertical_rad, before)


def test_corrected():
    plain = replace(
        random_set(4, 5),
        carried={"dist_correction_x": np.arange(4.0), "focal_slope": np.ones(4)},
    )
    changed = plain.corrected({"dl": np.full(4, 0.01), "v": np.array([0, 0, 0, 0.1])})
    np.testing.assert_array_equal(changed.dl, plain.dl + 0.01)
    np.testing.assert_array_equal(changed.v - plain.v > 0, [False, False, False, True])
    for name in ("alpha", "voff", "hoff"):
        np.testing.assert_array_equal(getattr(changed, name), getattr(plain, name))
    np.testing.assert_allclose(changed.carried["dist_correction_x"], np.arange(4) + 0.01)
    np.testing.assert_array_equal(changed.carried["focal_slope"], 1)
    assert plain.carried["dist_correction_x"][0] == 0  # the old set stays as it was


def test_parameters_of_different_lasers_do_not_mix():
    with pytest.raises(VelocalError, match="'voff' has shape"):
        LaserParameters(*[np.zeros(4)] * 3, np.zeros(3), np.zeros(4))
