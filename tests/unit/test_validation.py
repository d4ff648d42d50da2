"""Statistics per laser and per window against literal formulas."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import residuals_validation
from scipy.stats import chi2
from support.capture import record_list, write
from support.station import write_station

from velocal.adjustment.observations import Observations
from velocal.calibration.dialects import MANUAL
from velocal.calibration.files import formats
from velocal.errors import VelocalError
from velocal.evaluation.candidates import Candidate, Role, with_sets
from velocal.evaluation.statistics import (
    KEYS,
    laser_statistics,
    statistics_columns,
    statistics_table,
    summary_row,
)
from velocal.geometry.planes import Patch, Plane
from velocal.io import storage
from velocal.packets.data import encode
from velocal.recording.scan import inspect
from velocal.recording.windows import write_index
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import NEAR_POINT, nominal
from velocal.study.outputs import Validation
from velocal.study.reduction import AssignmentLimits

S = np.array([0.01, -0.03, 0.02, 0.05, 0.07, 0.001, -0.002])
LASER = np.array([0, 0, 0, 2, 2, 2, 2])


def test_against_literal_formulas():
    found = laser_statistics(S, LASER, 4, 0.02)
    for laser in (0, 2):
        own = S[laser == LASER]
        assert found.count[laser] == len(own)
        np.testing.assert_allclose(found.rms_m[laser], np.sqrt(np.mean(own**2)))
        np.testing.assert_allclose(found.std_m[laser], np.std(own, ddof=1))
        np.testing.assert_allclose(found.within_1sigma[laser], np.mean(np.abs(own) < 0.02))
        np.testing.assert_allclose(found.within_3sigma[laser], np.mean(np.abs(own) < 0.06))
    assert found.count[1] == found.count[3] == 0
    assert np.isnan(found.rms_m[[1, 3]]).all()
    assert np.isnan(found.std_m[[1, 3]]).all()
    assert not found.complies_zero[[1, 3]].any()


@pytest.mark.parametrize("spread", [0.012, 0.019, 0.021])
def test_variance_test(spread):
    s = np.random.default_rng(2).normal(0.003, spread, 200)
    found = laser_statistics(s, np.zeros(200, int), 1, 0.02)
    assert found.complies_zero[0] == (np.sum(s**2) / 0.02**2 < chi2.ppf(0.05, 200))
    assert found.complies_mean[0] == (199 * np.var(s, ddof=1) / 0.02**2 < chi2.ppf(0.05, 199))


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_laser_at_the_limit_of_the_variance_test(share):
    """Twenty residuals have twenty degrees of freedom about zero, and nineteen about their mean."""
    n, sigma_m = 20, 0.02
    noise = np.random.default_rng(5).normal(size=n)
    about_zero = noise * sigma_m * np.sqrt(share * chi2.ppf(0.05, n) / np.sum(noise**2))
    centred = noise - noise.mean()
    centred *= sigma_m * np.sqrt(share * chi2.ppf(0.05, n - 1) / np.sum(centred**2))
    laser = np.zeros(n, int)
    zero = laser_statistics(about_zero, laser, 1, sigma_m)
    mean = laser_statistics(centred + 0.004, laser, 1, sigma_m)
    assert zero.complies_zero[0] == (share < 1.0)
    assert mean.complies_mean[0] == (share < 1.0)


def test_size_of_the_variance_test():
    """At the limit of the hypothesis, 5 % of lasers with independent noise pass by chance."""
    s = np.random.default_rng(3).normal(0.0, 0.02, (2000, 100))
    laser = np.repeat(np.arange(2000), 100)
    share = laser_statistics(s.ravel(), laser, 2000, 0.02).complies_zero.mean()
    assert 0.035 < share < 0.065


def test_summary_reads_the_table():
    table = statistics_columns({"sample": "a"}, S, LASER, 4, 0.02)
    assert set(table["sample"]) == {"a"}
    row = summary_row(table)
    rms = [np.sqrt(np.mean(S[laser == LASER] ** 2)) * 100 for laser in (0, 2)]
    np.testing.assert_allclose(row["rms_cm"], np.mean(rms))
    np.testing.assert_allclose(row["pooled_rms_cm"], np.sqrt(np.mean(S**2)) * 100)
    np.testing.assert_allclose(row["within_1sigma_pct"], np.mean(np.abs(S) < 0.02) * 100)
    assert (row["lasers"], row["count"]) == (2, 7)


def test_nothing_assigned_is_not_a_number():
    nothing = np.zeros(0)
    table = statistics_columns({}, nothing, nothing.astype(int), 3, 0.02)
    row = summary_row(table)
    assert np.isnan(row["rms_cm"])
    assert np.isnan(row["std_cm"])
    assert row["lasers"] == 0


def test_std_of_a_window_is_that_of_its_lasers():
    """One column name has one meaning: standard deviation about the mean of the laser."""
    table = statistics_columns({}, S, LASER, 4, 0.02)
    assert summary_row(table)["std_cm"] == pytest.approx(np.nanmean(table["std_cm"]))


#: Firings of a rotation, and its complete ones, of the recording of a wall.
FIRINGS, ROTATIONS = 240, 11


def recording_of_a_wall(folder, factory, known, moved):
    """Packets of a head in front of the plane y = 4 m, and the index of its rotations.

    The plane is further by `moved[i]` in the complete rotation i + 1. The recording begins and ends
    within a rotation. Only beams near the normal return: a head as fast as this one turns by
    a degree within a firing.
    """
    n = (ROTATIONS + 1) * FIRINGS
    number = np.arange(n) + FIRINGS // 2
    azimuth = number % FIRINGS * (36_000 // FIRINGS)
    away = 4.0 + np.concatenate([[0.0], moved, [0.0]])[number // FIRINGS]
    ahead = np.cos(np.deg2rad(azimuth * 0.01))[:, None]
    distance = np.where(ahead > np.cos(np.deg2rad(4.0)), away[:, None] / ahead, 0.0)
    distance = distance / np.cos(factory.v)
    payloads = encode(
        np.full((n // 12, 12), known.flags[0], dtype=np.uint16),
        azimuth.reshape(-1, 12).astype(np.uint16),
        np.round(distance / known.distance_tick_m).reshape(-1, 12, 32).astype(np.uint16),
        np.zeros((n // 12, 12, 32), dtype=np.uint8),
        (553 * np.arange(n // 12)).astype(np.uint32),
        np.tile(np.array([0x37, 0x21], dtype=np.uint8), (n // 12, 1)),
    )
    path, index = write(folder, record_list(payloads, 42)), folder / "rotations.parquet"
    found = inspect(path).index
    assert list(np.flatnonzero(found.complete)) == list(range(1, ROTATIONS + 1))
    write_index(index, found)
    return path, index


@pytest.mark.parametrize(
    ("length", "singles", "origin"), [(3, 1, "outside"), (3, 3, "window"), (1, 3, "outside")]
)
@pytest.mark.parametrize("name", ["before", "factory"])
def test_a_set_of_any_name_leaves_the_factory_its_own_numbers(
    tmp_path, name, length, singles, origin
):
    """The wall stands where the factory's parameters see it; the set is 10 cm off.

    It stands there in the rotations that are to be used only, and 20 cm further in the others.
    """
    known = SCANNERS["HDL-32E"]
    factory = nominal(known)
    # Complete are 1 to 11; windows of three are 1 2 3, 5 6 7 and 9 10 11, windows of one 1, 6, 11.
    used = {(3, 1): [8], (3, 3): [5, 6, 7], (1, 3): [5, 7, 8]}[length, singles]
    moved = np.full(ROTATIONS, 0.2)
    moved[np.array(used) - 1] = 0.0
    recording, rotations = recording_of_a_wall(tmp_path, factory, known, moved)
    survey = tmp_path / "P1.json"
    corners = np.array([[x, 4.0, z] for x, z in ((-9, -9), (9, -9), (9, 9), (-9, 9))])
    plane = Plane(np.array([0.0, 1.0, 0.0]), -4.0, np.zeros((4, 4)))
    write_station(survey, "P1", known.name, [Patch("wall", plane, corners)])
    of_set = tmp_path / f"{name}.csv"
    formats.write(of_set, factory.corrected({"dl": np.full(known.n_lasers, 0.1)}))
    statistics = tmp_path / "statistics.csv"
    residuals_validation.main(
        recording=recording, rotations=rotations, survey=survey, calibration=None, sets=[of_set],
        statistics=statistics, sample="a", window="middle", scanner=known.name, port=None,
        address=None, which="strongest", length=length, candidates=[name], units=[],
        limits=AssignmentLimits(distance_cm=50, incidence_deg=70, edge_cm=5),
        validation=Validation(rotations=singles), sigma_cm=2.0, near_points=True,
    )  # fmt: skip
    rows = pd.DataFrame(storage.read_csv(statistics, text=KEYS))
    assert len(rows) == 2 * known.n_lasers
    assert set(rows["rotations_from"]) == {origin}
    assert rows["role"].tolist() == ["factory"] * known.n_lasers + ["set"] * known.n_lasers
    assert rows["parameter_set"].tolist() == [""] * known.n_lasers + [name] * known.n_lasers
    rms = rows.groupby(rows.index // known.n_lasers)["rms_cm"].mean()
    assert rms[0] < 0.5 < 9.0 < rms[1] < 11.0


def test_a_name_belongs_to_a_set_and_to_nothing_else():
    factory = nominal(SCANNERS["VLP-16"])
    for role, name in ((Role.SET, ""), (Role.FACTORY, "set1"), (Role.WINDOW, "set1")):
        with pytest.raises(
            VelocalError, match="a name for the roles 'set' and 'unit', none for the others"
        ):
            Candidate(role, factory, name)


def test_candidates_stand_below_each_other():
    factory = nominal(SCANNERS["VLP-16"])
    lasers = np.arange(16)
    data = Observations(
        np.full(16, 3.0), np.zeros(16), lasers, np.tile([0.0, 1.0, 0.0], (16, 1)),
        np.full(16, -3.0), np.zeros(16, int),
    )  # fmt: skip
    candidates = with_sets(factory, {"window": factory.corrected({"dl": np.full(16, 0.5)})})
    table = statistics_table({"sample": "a"}, candidates, data, 0.02)
    assert list(table["laser_id"]) == [*lasers] * 2
    for k, each in enumerate(candidates):
        own = slice(16 * k, 16 * (k + 1))
        assert set(table["role"][own]) == {each.role.value}
        assert set(table["parameter_set"][own]) == {each.parameter_set}
        rms_cm = np.abs(data.misclosure(each.parameters)) * 1e2
        np.testing.assert_allclose(table["rms_cm"][own], rms_cm)


def test_the_factory_file_is_judged_by_its_own_formula():
    """Beams along Y onto a wall at 3 m: with near points they have the points of the manual."""
    n = 64
    factory = replace(
        nominal(SCANNERS["HDL-64E"]), alpha=np.zeros(n), hoff=np.zeros(n), dl=np.full(n, 1.0)
    )
    lasers, raw_m = np.arange(n), 2.0
    data = Observations(
        np.full(n, raw_m), np.zeros(n), lasers, np.tile([0.0, 1.0, 0.0], (n, 1)),
        np.full(n, -3.0), np.zeros(n, int),
    )  # fmt: skip
    near = dict.fromkeys(NEAR_POINT, factory.dl + 0.05)
    candidates = with_sets(replace(factory, carried=near), {"a": factory}, near_points=True)
    table = statistics_table({"sample": "a"}, candidates, data, 0.02)
    assert list(dict.fromkeys(table["role"])) == ["factory", "factory_single", "set"]
    y = MANUAL.points(data.distance_m, data.phi, lasers, candidates[0].parameters)[:, 1]
    wanted_cm = 100.0 * (y - 3.0) / np.cos(factory.v)
    np.testing.assert_allclose(table["rms_cm"][:n], np.abs(wanted_cm), atol=1e-9)
    moved = table["mean_cm"][:n] - table["mean_cm"][n : 2 * n]
    assert 4.0 < moved.min() < moved.max() < 5.0
    np.testing.assert_array_equal(table["rms_cm"][n : 2 * n], table["rms_cm"][2 * n :])
    # The paper's study, and files without near points, have the rows that they had.
    for parameters, applies in ((replace(factory, carried=near), False), (factory, True)):
        rows = with_sets(parameters, {"a": factory}, near_points=applies)
        found = statistics_table({"sample": "a"}, rows, data, 0.02)["role"]
        assert list(dict.fromkeys(found)) == ["factory", "set"]
