"""A unit calibrated on planes that nobody surveyed."""

from dataclasses import replace

import numpy as np
import pytest

from velocal.adjustment.unit.adjust import adjust_unit
from velocal.errors import VelocalError
from velocal.evaluation.another_plane import with_another_plane, with_another_room
from velocal.evaluation.holdout import Verdict
from velocal.evaluation.planes_in_data import Cloud, PlaneLimits, fit_robustly
from velocal.evaluation.unsurveyed import (
    Seen,
    adjust_unsurveyed,
    calibrate_unsurveyed,
    divisions,
    leave_out,
    relative_std,
    unit_station_of,
    unsurveyed_settings,
)
from velocal.geometry.planes import Plane
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

SCANNER = SCANNERS["VLP-16"]
NOMINAL = nominal(SCANNER)
SETTINGS = replace(
    unsurveyed_settings(SCANNER, NOMINAL),
    azimuth_bin_rad=np.deg2rad(3.0),
    integration_points=1,
    linearisations=1,
)
LIMITS = PlaneLimits(min_points=100, incidence_rad=np.deg2rad(70.0))
#: Angle of the normal, distance, and middle of the part of four walls: degrees and metres.
WALLS = {"north": (0, 3.0), "east": (95, 2.0), "south": (170, 4.0), "west": (260, 2.5)}
NOISE_M = 0.003


@pytest.fixture(scope="module")
def errors():
    """Errors of the distances; their mean is zero."""
    found = np.random.default_rng(4).normal(0.0, 0.015, len(NOMINAL))
    return found - found.mean()


def cloud_of(errors, wave_m=0.0, v=0.0):
    """Four walls as a unit with errors sees them, with nominal values; rows of every wall.

    The walls have waves of 1.5 m with this standard deviation. `v` has errors of the vertical
    angles.
    """
    rng = np.random.default_rng(5)
    true = NOMINAL.corrected({"dl": errors, "v": v + np.zeros(len(NOMINAL))})
    parts, rows, used = [], {}, 0
    for name, (middle, distance) in WALLS.items():
        phi = np.deg2rad(middle + np.arange(-30.0, 30.0, 0.5)) % (2.0 * np.pi)
        phi = np.repeat(phi, len(NOMINAL))
        laser = np.tile(np.arange(len(NOMINAL)), len(phi) // len(NOMINAL))
        normal = np.array([np.sin(np.deg2rad(middle)), np.cos(np.deg2rad(middle)), 0.0])
        direction, origin = laser_beams(phi, laser, true)
        length = (distance - origin @ normal) / (direction @ normal)
        along = (origin + length[:, None] * direction) @ np.cross([0.0, 0.0, 1.0], normal)
        wave = np.sqrt(2.0) * wave_m * np.sin(2.0 * np.pi * along / 1.5)
        length = length + wave / (direction @ normal)
        raw = length - true.dl[laser] + rng.normal(0.0, NOISE_M, len(laser))
        parts.append((raw, phi, laser))
        rows[name] = used + np.arange(len(laser))
        used += len(laser)
    raw, phi, laser = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Cloud.from_beams(Beams(raw, phi, laser, SCANNER.distance_tick_m), NOMINAL), rows


def seen_of(errors, name="room", wave_m=0.0, v=0.0):
    cloud, rows = cloud_of(errors, wave_m, v)
    planes = tuple(fit_robustly(name, cloud, own, LIMITS) for name, own in rows.items())
    return Seen(name, cloud, planes)


def visible(dl):
    """What upright planes that nobody surveyed show of the distances.

    If the distances of all lasers change by a constant, the planes shift; if they change by a
    multiple of the sine of the vertical angle, the planes tilt.
    """
    hidden = np.column_stack([np.ones(len(dl)), np.sin(NOMINAL.v)])
    return dl - hidden @ np.linalg.lstsq(hidden, dl, rcond=None)[0]


def rms(values):
    return np.sqrt(np.mean(values**2))


def test_distances_are_found_without_a_survey(errors):
    found = adjust_unsurveyed([seen_of(errors)], SETTINGS).calibration
    dl = found.corrections[:, 0]
    assert rms(visible(dl - errors)) < 0.05 * rms(visible(errors))
    std = np.sqrt(found.covariance[:, 0, 0])
    assert (np.abs(dl - errors) < 3.0 * std).all()
    # Angles that the walls show no better than the distances remain the factory's. That they are
    # right is not certain.
    np.testing.assert_allclose(found.corrections[:, 1:], 0.0, atol=1e-5)
    assert (found.std[:, 1:] > np.deg2rad(0.005)).all()
    np.testing.assert_allclose(sum(found.sources.values()), found.covariance, atol=1e-12)


def test_the_covariance_contains_what_an_angle_that_is_not_adjusted_does_to_distances(errors):
    """v of one laser is wrong: its distance is, as the covariance of both says."""
    laser, wrong = 13, np.deg2rad(0.3)
    v = wrong * (np.arange(len(NOMINAL)) == laser)
    right, off = (adjust_unsurveyed([seen_of(errors, v=each)], SETTINGS) for each in (0.0, v))
    assert not off.calibration.corrections[:, 2].round(6).any()
    moved = (off.calibration.corrections - right.calibration.corrections)[laser, 0]
    covariance = right.calibration.covariance[laser]
    # The error of v is minus its true value, as the estimate stays at zero.
    assert abs(moved) > 1e-3
    assert covariance[0, 2] / covariance[2, 2] == pytest.approx(-moved / wrong, rel=0.2)
    # What is said of the mean does not take v of all lasers to be equal.
    free = adjust_unit([unit_station_of(seen_of(errors, v=v))], NOMINAL, SETTINGS)
    stated, expected = ({one.name: one for one in unit.common}["v"] for unit in (off, free))
    assert stated.by_survey == expected.by_survey
    assert stated.by_survey_std == expected.by_survey_std
    assert stated.value == pytest.approx(0.0, abs=1e-6)


def test_what_all_lasers_share_is_hardly_seen_and_left(errors):
    """The mean of dl remains near the factory's, though all distances are wrong by 3 cm.

    The walls are as uneven as walls are.
    """
    seen = seen_of(errors + 0.03, wave_m=0.005)
    dl = adjust_unsurveyed([seen], SETTINGS).calibration.corrections[:, 0]
    assert abs(dl.mean()) < 0.2 * 0.03
    assert rms(visible(dl - errors)) < 0.05 * rms(visible(errors))


def test_even_walls_show_what_all_lasers_share(errors):
    """A wall that is seen at many angles of incidence looks bent if all distances are wrong."""
    unit = adjust_unsurveyed([seen_of(errors + 0.03)], SETTINGS)
    common = next(one for one in unit.common if one.name == "dl")
    assert common.decided > 0.9
    assert abs(common.value - 0.03) < 2.0 * common.std < 0.02


def test_the_fitted_planes_are_not_believed(errors):
    """Planes that are wrong by 5 cm and 1 degree give the same calibration."""
    seen = seen_of(errors)
    cloud, moved = seen.cloud, []
    for plane in seen.planes:
        old = plane.fit.plane
        normal = old.normal + np.deg2rad(1.0) * np.cross([0.0, 0.0, 1.0], old.normal)
        normal /= np.linalg.norm(normal)
        centre = cloud.xyz[plane.rows].mean(axis=0)
        new = Plane(normal, 0.05 - float(normal @ centre), old.covariance)
        moved.append(replace(plane, fit=replace(plane.fit, plane=new)))
    dl = [
        adjust_unsurveyed([replace(seen, planes=tuple(each))], SETTINGS).calibration.corrections
        for each in (seen.planes, moved)
    ]
    assert rms(visible(dl[0][:, 0] - dl[1][:, 0])) < 0.05 * rms(visible(errors))


@pytest.mark.parametrize(("wave_m", "least", "most"), [(0.0, 0.0, 0.3), (0.005, 0.5, 1.7)])
def test_the_unevenness_of_the_walls_is_learnt(errors, wave_m, least, most):
    """In units of 5 mm. Even walls give smaller standard deviations, uneven ones do not."""
    seen = seen_of(errors, wave_m=wave_m)
    unit = adjust_unsurveyed([seen], SETTINGS)
    assert least < unit.sigma("sigma_relief") < most
    given = adjust_unsurveyed([seen], replace(SETTINGS, learn_relief=False))
    ratio = rms(relative_std(unit)[:, 0]) / rms(relative_std(given)[:, 0])
    assert ratio < 0.8 if wave_m == 0.0 else 0.7 < ratio < 1.4


def test_every_plane_is_left_out_once(errors):
    seen = seen_of(errors)
    found = leave_out([seen], divisions([seen]), SETTINGS)
    assert [each.plane.name for each in found.planes] == list(WALLS)
    for each in found.planes:
        assert each.lasers == len(NOMINAL)
        assert each.spread.within_m == pytest.approx(NOISE_M, rel=0.1)
        assert each.spread.after_m < 1.3 * NOISE_M < each.spread.before_m
        assert 0.0 < each.spread.low_m < each.spread.gain_m < each.spread.high_m
    before = np.mean([each.spread.before_m for each in found.planes])
    assert found.mean.before_m == pytest.approx(before)


def test_recordings_are_left_out_where_there_are_several(errors):
    rooms = [seen_of(errors, "hall"), seen_of(errors, "cellar")]
    parts = divisions(rooms)
    assert parts == [frozenset((room.name, wall) for wall in WALLS) for room in rooms]
    found = calibrate_unsurveyed(rooms, SETTINGS)
    assert [(one.station, one.plane) for one in found.hold_out.parts] == [
        (room, wall) for room in ("hall", "cellar") for wall in WALLS
    ]
    assert found.recommended


def test_judged_planes_are_not_adjusted_on(errors):
    """With planes that are only judged, the result does not know them."""
    seen = seen_of(errors)
    judged = [("room", "north"), ("room", "west")]
    found = calibrate_unsurveyed([seen], SETTINGS, judged)
    alone = adjust_unsurveyed([seen.without(judged)], SETTINGS)
    np.testing.assert_array_equal(found.unit.calibration.corrections, alone.calibration.corrections)
    assert [one.plane for one in found.hold_out.parts] == ["north", "west"]
    assert found.hold_out.verdict is Verdict.BETTER
    assert "a common correction of the distances" in "".join(found.unit.warnings)


def test_a_perfect_unit_gains_nothing():
    seen = seen_of(np.zeros(len(NOMINAL)))
    mean = leave_out([seen], divisions([seen]), SETTINGS).mean
    assert abs(mean.gain_m) < 0.03 * NOISE_M
    assert not calibrate_unsurveyed([seen], SETTINGS).recommended


def test_one_plane_is_not_judged(errors):
    seen = seen_of(errors)
    one = replace(seen, planes=seen.planes[:1])
    with pytest.raises(VelocalError, match="all 1 planes are left out"):
        leave_out([one], divisions([one]), SETTINGS)
    assert calibrate_unsurveyed([one], SETTINGS).hold_out.verdict is Verdict.NOT_JUDGED
    with pytest.raises(VelocalError, match="no recording has a plane"):
        calibrate_unsurveyed([replace(seen, planes=())], SETTINGS)


def test_the_range_scale_is_stated_but_not_extrapolated(errors):
    """Walls at 2 to 4 m decide on scales of millimetres per metre, and say nothing of 7 m."""
    scale = np.random.default_rng(7).normal(0.0, 0.005, len(NOMINAL))
    cloud, rows = cloud_of(errors)
    short = replace(cloud, distance_m=cloud.distance_m * (1.0 - scale[cloud.laser_id]))
    cloud = Cloud.from_beams(short, NOMINAL)
    planes = tuple(fit_robustly(name, cloud, own, LIMITS) for name, own in rows.items())
    unit = adjust_unsurveyed([Seen("room", cloud, planes)], SETTINGS)
    found = unit.range_scale
    assert np.median(found.determined) > 0.5
    error = found.value - scale
    assert rms(error - error.mean()) < 0.3 * rms(scale)
    assert found.near_m.min() == pytest.approx(2.0, abs=0.1)
    laser, mean = np.arange(len(NOMINAL)), unit.mean_range_m
    np.testing.assert_allclose(found.change(mean, laser, mean), 0.0, atol=1e-15)
    np.testing.assert_allclose(found.change(mean + 0.1, laser, mean), 0.1 * found.value, rtol=1e-9)
    # The correction of a laser stays what it is at the longest range at which it was observed.
    far = found.change(found.far_m, laser, mean)
    assert np.abs(far).max() > 0.002
    np.testing.assert_array_equal(found.change(np.full(len(laser), 50.0), laser, mean), far)
    # Nothing of it is in the calibration: its dl holds at all ranges.
    np.testing.assert_array_equal(unit.range_factor([1.0, 50.0]), 1.0)


def test_nominal_values_contain_no_far_correction():
    scanner = SCANNERS["HDL-64E-S1"]
    assert unsurveyed_settings(scanner, nominal(scanner)).far_point_m is None


def test_one_more_plane_brings_what_was_predicted(errors):
    """A third wall at right angles: predicted from two walls, and recorded."""
    whole = seen_of(errors)
    part = whole.without([("room", "south"), ("room", "west")])
    unit = adjust_unsurveyed([part], SETTINGS)
    found = with_another_plane([part], unit, SETTINGS)
    assert found[0].planes == "as it is"
    assert len({one.planes for one in found}) == len(found) >= 4
    assert all(one.lasers == len(NOMINAL) and one.dl_mm > 0.0 for one in found)
    predicted = next(one for one in found if "right angles" in one.planes)
    # It is recorded later: the lasers have shifted by as much as they usually do.
    shift = np.random.default_rng(8).normal(0.0, SETTINGS.shift_m, len(NOMINAL))
    later = seen_of(errors + shift, "later")
    later = later.without([("later", wall) for wall in ("north", "east", "south")])
    recorded = adjust_unsurveyed([part, later], SETTINGS)
    assert predicted.dl_mm == pytest.approx(rms(relative_std(recorded)[:, 0]) * 1e3, rel=0.35)
    assert predicted.dl_mm < found[0].dl_mm
    # What all lasers share is hardly known, and no part of these.
    assert (relative_std(unit)[:, 0] < unit.calibration.std[:, 0]).all()


def test_another_room_brings_what_was_predicted(errors):
    """Only directions and planes of the second recording are used, not its distances."""
    # The lasers shift from recording to recording as much as they usually do.
    shifts = np.random.default_rng(8).normal(0.0, SETTINGS.shift_m, (2, len(NOMINAL)))
    first, second = seen_of(errors + shifts[0]), seen_of(errors + shifts[1], "other room")
    first = first.without([("room", "south"), ("room", "west")])
    second = second.without([("other room", "north"), ("other room", "east")])
    unit = adjust_unsurveyed([first], SETTINGS)
    met = unit_station_of(second).observations
    found = with_another_room(
        [first], unit, SETTINGS, replace(met, distance_m=np.zeros(len(met.phi)))
    )
    recorded = adjust_unsurveyed([first, second], SETTINGS)
    assert found.dl_mm == pytest.approx(rms(relative_std(recorded)[:, 0]) * 1e3, rel=0.5)
    assert found.dl_mm < 0.9 * rms(relative_std(unit)[:, 0]) * 1e3
