"""Stability of a unit: planted drifts come back within their intervals, and chance is no drift."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support.corner import TRUE, N, position
from support.small_survey import pose, record, small

from velocal.adjustment.nuisance import by_pose
from velocal.chain import unit_stations
from velocal.evaluation.planes_in_data import Cloud, plane_of
from velocal.evaluation.stability import (
    SIGNIFICANT,
    between_recordings,
    between_windows,
    tabulate,
    verdict,
)
from velocal.evaluation.unsurveyed import (
    Seen,
    adjust_unsurveyed,
    unit_station_of,
    unsurveyed_settings,
)
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

SEEN = position(0.4, (2.0, 3.0, 0.8))
NOISE_M = 0.003
#: Changes over four windows, metres: of each laser, and of all together.
SINGLE = np.outer([-1.5, -0.5, 0.5, 1.5], np.linspace(-0.002, 0.002, N))
COMMON = np.array([-0.004, 0.001, 0.001, 0.002])


def windows(rng, single=0.0, common=0.0, pattern_m=0.01):
    """Windows of one recording, with a pattern that stays."""
    pattern = rng.normal(0.0, pattern_m, len(SEEN.phi))
    changes = np.zeros((4, N)) + single + np.reshape(common * np.ones(4), (4, 1))
    return [
        replace(
            SEEN,
            distance_m=SEEN.distance_m + pattern + change[SEEN.laser_id]
            + rng.normal(0.0, NOISE_M, len(SEEN.phi)),
        )
        for change in changes
    ]  # fmt: skip


def test_a_drift_within_a_recording_is_found_in_both_parts():
    found = between_windows(windows(np.random.default_rng(1), SINGLE, COMMON), TRUE)
    assert found.significant
    assert found.lasers_p < 1e-6
    assert found.common_p < 1e-3
    assert (np.abs(found.single_m - SINGLE) < 2.0 * found.single_half_m).all()
    assert (np.abs(found.common_m - COMMON) < 2.0 * found.common_half_m).all()
    np.testing.assert_allclose(found.single_m.mean(axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize("part", ["lasers_p", "common_p"])
def test_one_part_of_a_drift_is_not_taken_for_the_other(part):
    rng = np.random.default_rng(2)
    drifts = {"lasers_p": {"single": SINGLE}, "common_p": {"common": COMMON}}[part]
    found = [between_windows(windows(rng, **drifts), TRUE) for _ in range(20)]
    other = ({"lasers_p", "common_p"} - {part}).pop()
    assert np.median([getattr(one, part) for one in found]) < 1e-3
    assert sum(getattr(one, other) < SIGNIFICANT for one in found) <= 4


def test_chance_is_rarely_a_drift_and_intervals_contain_the_truth():
    """Of 200 recordings without a drift 10 are expected; more than 19 in 1 of 200 such tests."""
    rng = np.random.default_rng(3)
    found = [between_windows(windows(rng), TRUE) for _ in range(200)]
    for part in ("lasers_p", "common_p"):
        assert 2 <= sum(getattr(one, part) < SIGNIFICANT for one in found) <= 19
    assert sum(one.significant for one in found) <= 19
    single = np.mean([np.abs(one.single_m) < one.single_half_m for one in found])
    common = np.mean([np.abs(one.common_m) < one.common_half_m for one in found])
    assert 0.93 < single < 0.97
    assert 0.92 < common < 0.98


def test_neither_a_movement_nor_a_passer_by_is_a_drift():
    """The scanner shifts by 5 mm and turns a little; somebody stands before a wall for a while."""
    found = []
    for seed in range(20):
        rng = np.random.default_rng([8, seed])
        some = windows(rng)
        moved = by_pose(points_of(some[3]), some[3].normal, towards(some[3]), np.zeros(3))
        step = np.array([0.0, 0.0, 0.002, 0.005, -0.003, 0.001])
        some[3] = replace(some[3], distance_m=some[3].distance_m + moved @ step)
        hidden = (some[1].phi > 0.3) & (some[1].phi < 0.6)
        some[1] = replace(some[1], distance_m=np.where(hidden, 0.7, 1.0) * some[1].distance_m)
        found.append(between_windows(some, TRUE))
    assert sum(one.significant for one in found) <= 4
    assert all(0.0 < one.disturbed < 0.2 for one in found)
    steps = np.mean([one.movement[3] - one.movement[0] for one in found], axis=0)
    np.testing.assert_allclose(steps, step, atol=5e-4)


def towards(data):
    direction, _ = laser_beams(data.phi, data.laser_id, TRUE)
    return np.einsum("ni,ni->n", direction, data.normal)


def points_of(data):
    direction, origin = laser_beams(data.phi, data.laser_id, TRUE)
    length = data.distance_m + TRUE.dl[data.laser_id] - data.misclosure(TRUE)
    return origin + length[:, None] * direction


def test_one_window_or_one_laser_is_not_compared():
    some = windows(np.random.default_rng(4))
    assert between_windows(some[:1], TRUE) is None
    assert between_windows([one.take(one.laser_id == 0) for one in some], TRUE) is None


SCANNER = SCANNERS["VLP-16"]
NOMINAL = nominal(SCANNER)
SETTINGS = replace(
    unsurveyed_settings(SCANNER, NOMINAL),
    azimuth_bin_rad=np.deg2rad(4.0),
    integration_points=1,
    linearisations=1,
)
#: Normals of the walls of two rooms, degrees, with their distances, metres.
ROOMS = {"hall": {0: 3.0, 95: 2.0, 170: 4.0, 260: 2.5}, "cellar": {20: 2.5, 110: 3.5, 205: 2.0}}


def room(name, dl, rng):
    """A room as a unit with some errors of its distances sees it, with nominal values."""
    true = NOMINAL.corrected({"dl": dl})
    parts, rows, used = [], {}, 0
    for middle, distance in ROOMS[name].items():
        phi = np.repeat(np.deg2rad(middle + np.arange(-30.0, 30.0, 1.0)) % (2.0 * np.pi), len(dl))
        laser = np.tile(np.arange(len(dl)), len(phi) // len(dl))
        normal = np.array([np.sin(np.deg2rad(middle)), np.cos(np.deg2rad(middle)), 0.0])
        direction, origin = laser_beams(phi, laser, true)
        length = (distance - origin @ normal) / (direction @ normal)
        parts.append((length - dl[laser] + rng.normal(0.0, NOISE_M, len(laser)), phi, laser))
        rows[f"wall {middle}"] = used + np.arange(len(laser))
        used += len(laser)
    beams = Beams(*(np.concatenate(column) for column in zip(*parts, strict=True)), 0.002)
    cloud = Cloud.from_beams(beams, NOMINAL)
    return Seen(name, cloud, tuple(plane_of(wall, cloud, own) for wall, own in rows.items()))


def compared(single, seed):
    rng = np.random.default_rng(seed)
    dl = rng.normal(0.0, 0.015, len(NOMINAL))
    seen = [room(name, dl + change, rng) for name, change in zip(ROOMS, single, strict=True)]
    unit = adjust_unsurveyed(seen, SETTINGS)
    return between_recordings([unit_station_of(each) for each in seen], unit, SETTINGS)


def visible(change):
    """Changes without the trend with the sine of the vertical angle, by which all walls tilt."""
    hidden = np.column_stack([np.ones(len(NOMINAL)), np.sin(NOMINAL.v)])
    return change - hidden @ np.linalg.lstsq(hidden, change, rcond=None)[0]


def test_a_drift_between_recordings_is_found_relative_to_the_mean():
    """A laser that measures longer needs a smaller dl."""
    wanted = visible(np.random.default_rng(5).normal(0.0, 0.004, len(NOMINAL)))
    found = compared([-0.5 * wanted, 0.5 * wanted], 6)
    assert found.significant
    assert found.lasers_p < 1e-6
    # Distances are measured longer where dl, the correction, has become smaller.
    assert np.mean(np.abs(found.single_m[1] + 0.5 * wanted) < found.single_half_m[1]) > 0.85
    assert np.corrcoef(found.single_m[1], -wanted)[0, 1] > 0.9
    # What all lasers share is hardly seen.
    assert (found.common_std_m > 3.0 * np.nanmean(found.single_std_m)).all()


def test_chance_between_recordings_is_no_drift():
    """Each has a chance of 5 %; two of four in 1.4 % of such tests."""
    found = [compared([0.0, 0.0], seed) for seed in range(10, 14)]
    assert sum(one.significant for one in found) <= 1
    covered = np.mean([np.abs(one.single_m) < one.single_half_m for one in found])
    assert covered > 0.9


def test_the_table_has_every_part_and_the_slope_by_temperature():
    found = between_windows(windows(np.random.default_rng(7), common=COMMON), TRUE)
    times = [("hall", str(number + 1), 40.0 + warmth) for number, warmth in enumerate(COMMON * 1e3)]
    table = pd.DataFrame(tabulate({"hall": found}, {"hall": times}))
    parts = table.groupby("part").size()
    assert parts.to_dict() == {"common": 4, "laser": 4 * N, "lasers": 4, "per K": 1}
    common = table[table["part"] == "common"]
    np.testing.assert_allclose(common["change_cm"], found.common_m * 1e2)
    slope = table[table["part"] == "per K"].iloc[0]
    assert slope["low_cm"] <= 0.1 <= slope["high_cm"]
    said = verdict({"hall": found})
    assert "4 windows of hall: a drift is shown" in said
    assert "nothing can be compared" in verdict({})


def drifted(seed, size_m):
    """Windows of a surveyed position, of a unit whose lasers drift on their own, by assignment."""
    made = small("VLP-16", seed)
    station, at = made.stations()["P1"], pose("P1")
    rng = np.random.default_rng([seed, 9])
    factory = made.stated
    steps = np.outer([-1.0, 0.0, 1.0], rng.normal(0.0, size_m, len(factory)))
    # The unit is that of its file: only what changes is looked for.
    parts = [record("VLP-16", factory.corrected({"dl": step}), at, rng) for step in steps]
    seen = [unit_stations([(each, station)], factory)[0].observations for each in parts]
    found = between_windows(seen, factory)
    return found, steps - steps.mean(axis=1, keepdims=True)


def test_the_drift_of_a_surveyed_unit_is_found_and_none_where_there_is_none():
    """A unit without a drift is called so by chance in 5 of 100 cases; three of 12 in 2 %."""
    found, steps = drifted(11, 0.004)
    assert found.significant
    assert found.lasers_p < 1e-4
    # Distances are measured longer where dl, the correction, is smaller.
    seen = np.isfinite(found.single_m[2])
    assert np.corrcoef(found.single_m[2, seen], -steps[2, seen])[0, 1] > 0.9
    still = [drifted(seed, 0.0)[0] for seed in range(20, 32)]
    assert sum(one.significant for one in still) <= 2
