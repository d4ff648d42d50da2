"""Adjustment of a unit: what must not matter, small and odd data, and errors."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from tests.support.unit import errors_of, unit_draws
from velocal.adjustment.unit import adjust
from velocal.adjustment.unit.adjust import adjust_unit, readjust
from velocal.adjustment.unit.assemble import hold, typical
from velocal.adjustment.unit.corrected_survey import CorrectedSurvey
from velocal.adjustment.unit.model import UNKNOWNS, about_scanner, linearise, shared_effects
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import azimuth_bins
from velocal.errors import VelocalError
from velocal.geometry.rigid import RigidTransformation, rotation_from_vector
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.simulation.independent.plan import Plan, UnitErrors
from velocal.simulation.independent.trial import draw

#: Without integration: what is tested here does not depend on it.
QUICK = UnitSettings(integration_points=1, linearisations=1, shift_m=0.0013)


@pytest.fixture(scope="module")
def small():
    """Every fourth laser of an HDL-32E at a station, every 3 degrees."""
    factory, runs = unit_draws("HDL-32E", "P5", 1, 4, step_deg=3.0, every=4)
    return factory, *runs[0]


def stacked(result):
    """All numbers of a result in one vector."""
    calibration = result.calibration
    parts = [calibration.corrections, calibration.covariance, result.determined]
    parts += [result.mean_range_m, *(station.pose for station in result.stations)]
    return np.concatenate([part.ravel() for part in parts])


def finite(result):
    assert np.isfinite(stacked(result)).all()
    variances = np.diagonal(result.calibration.covariance, axis1=1, axis2=2)
    assert (variances > 0.0).all()
    total = sum(result.calibration.sources.values())
    np.testing.assert_allclose(total, result.calibration.covariance)


def threads():
    """Threads of every library of linear algebra."""
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}


def test_the_linear_algebra_has_one_thread_meanwhile(small, monkeypatch):
    """With two threads, an adjustment took three times as long."""
    factory, station, _ = small
    seen = []
    find_mode = adjust.find_mode

    def watched(*given):
        seen.append(threads())
        return find_mode(*given)

    monkeypatch.setattr(adjust, "find_mode", watched)
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        adjust_unit([station], factory, QUICK)
        assert threads() == before
    assert before != {1}
    assert seen == [{1}]


@pytest.mark.parametrize("far_point_m", [None, 25.04])
def test_columns_are_derivatives_of_the_misclosure(small, far_point_m):
    """By finite differences; the misclosure is minus z without what the point accounts for."""
    factory, station, _ = small
    bins = azimuth_bins([station], factory, np.deg2rad(0.9))
    x = np.zeros((len(factory), len(UNKNOWNS)))
    at = linearise(bins, factory, x, far_point_m)
    for number, name in enumerate(UNKNOWNS):
        change = np.zeros_like(x)
        change[:, number] = 1e-6
        if name in ("dl", "scale"):
            # A correction of the distance by its two columns.
            first = at.matrix[:, number] * 1e-6
            if far_point_m is None:
                expected = 1e-6 if name == "dl" else 1e-6 * at.range_m
            else:
                share = at.range_m / far_point_m
                expected = 1e-6 * (1.0 - share if name == "dl" else share)
            np.testing.assert_allclose(first, expected, rtol=1e-12)
            continue
        moved = factory.corrected({name: change[:, number]})
        before, after = bins.mean.misclosure(factory), bins.mean.misclosure(moved)
        difference = (after - before) / 1e-6
        np.testing.assert_allclose(at.matrix[:, number], difference, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("with_pose", [True, False])
def test_corrected_poses_and_planes_change_the_misclosure_as_accounted(small, with_pose):
    """A small correction moves s by its derivatives, and one of a degree does not."""
    factory, station, _ = small
    turned = RigidTransformation(
        rotation_from_vector(np.array([0.1, -0.2, 1.0])),
        station.survey.translation,
        np.zeros((6, 6)),
    )
    station = replace(station, pose=turned if with_pose else None)
    bins = azimuth_bins([station], factory, np.deg2rad(0.9))
    x = np.zeros((len(factory), len(UNKNOWNS)))
    before = bins.mean.misclosure(factory)
    pose = np.array([[1.0, -2.0, 3.0, 0.5, -1.0, 2.0]]) * 1e-5
    planes = np.zeros((len(station.plane_names), 4))
    planes[:, 3] = 1e-5
    for size, least, most in ((1.0, 0.0, 1e-3), (1000.0, 1e-3, 0.5)):
        survey = CorrectedSurvey((station,), size * pose, (size * planes,))
        moved = survey.bins(bins)
        at = linearise(moved, factory, x, None)
        change = moved.mean.misclosure(factory) - before
        differs = np.abs(change - survey.accounted(moved, at)).max() / np.abs(change).max()
        assert least <= differs < most
        np.testing.assert_allclose(np.linalg.norm(moved.mean.normal, axis=1), 1.0)


def test_corrected_pose_is_that_of_the_moved_planes(small):
    """A plane of the site has the same place, by the corrected pose and by the moved bins."""
    factory, station, _ = small
    pose = RigidTransformation(
        rotation_from_vector(np.array([0.1, -0.2, 1.0])),
        station.survey.translation,
        np.zeros((6, 6)),
    )
    station = replace(station, pose=pose)
    bins = azimuth_bins([station], factory, np.deg2rad(0.9))
    planes = (np.zeros((len(station.plane_names), 4)),)
    survey = CorrectedSurvey((station,), np.array([[0.01, -0.02, 0.03, 0.1, 0.2, -0.1]]), planes)
    moved = survey.bins(bins).mean
    before = np.column_stack([bins.mean.normal, bins.mean.offset])
    site = np.linalg.solve(pose.plane_matrix(), before.T)
    after = survey.moved()[0].pose.plane_matrix() @ site
    np.testing.assert_allclose(np.column_stack([moved.normal, moved.offset]), after.T, atol=1e-12)


@pytest.mark.parametrize("linearisations", [1, 2])
def test_a_pose_that_is_wrong_by_some_degrees_is_found(small, linearisations):
    """The lasers are as with the right pose, but for what the prior of the pose pulls.

    Without further linearisations, and with the pose about the origin of the site, dl is off by
    4 mm here.
    """
    factory, station, _ = small
    settings = replace(QUICK, linearisations=linearisations)

    def corrections(vector):
        turn = RigidTransformation(rotation_from_vector(vector), np.zeros(3), np.zeros((6, 6)))
        matrix = turn.plane_matrix()
        data, survey = station.observations, station.survey
        moved = np.column_stack([data.normal, data.offset]) @ matrix.T
        place = turn.apply(survey.translation)
        about = np.eye(6)
        about[3:, :3] = -np.cross(np.eye(3), place)
        pose = about @ np.diag([0.06, 0.06, 0.06, 1e-3, 1e-3, 1e-3]) ** 2 @ about.T
        planes = matrix @ survey.planes @ matrix.T
        result = adjust_unit(
            [
                replace(
                    station,
                    pose=None,
                    observations=replace(data, normal=moved[:, :3], offset=moved[:, 3]),
                    survey=replace(survey, translation=place, pose=pose, planes=planes),
                )
            ],
            factory,
            settings,
        )
        return result.calibration.corrections

    right, wrong = corrections(np.zeros(3)), corrections(np.deg2rad([5.0, -4.0, 2.0]))
    apart = np.abs(wrong - right).max(axis=0)
    # The rough passes, which linearise once at the usual poses, only have to assign returns.
    assert apart[0] < {1: 2e-3, 2: 1e-3}[linearisations]
    assert (apart[1:] < np.deg2rad(0.02)).all()


def test_held_parameters_take_the_others_with_them():
    """As if the laser had been adjusted with the held value: the normal equations say the same."""
    rng = np.random.default_rng(1)
    design, data, prior = rng.normal(size=(9, 3)), rng.normal(size=9), np.array([4.0, 1.0, 2.0])
    covariance = np.linalg.inv(design.T @ design + np.diag(1.0 / prior))
    corrections = covariance @ design.T @ data
    held = np.array([[False, False, True]])
    means = np.array([[0.0, 0.0, 0.3]])
    found, back = hold(corrections[None], covariance[None], means, prior[None], held)
    free = design[:, :2]
    again = np.linalg.solve(
        free.T @ free + np.diag(1.0 / prior[:2]), free.T @ (data - 0.3 * design[:, 2])
    )
    np.testing.assert_allclose(found[0], [*again, 0.3])
    assert back[0, 2, 2] + covariance[2, 2] == pytest.approx(prior[2])
    assert (np.linalg.eigvalsh(back[0]) > -1e-12).all()


@pytest.mark.parametrize("seen", [0.3, 1.0, 3.0, 10.0])
def test_a_laser_that_is_far_off_is_not_known_less_well(seen):
    """One observation of one laser, and a spread of which 0.5, 1 and 2 are equally probable."""
    spread = np.array([0.5, 1.0, 2.0])
    gain = spread**2 / (spread**2 + 1.0)
    estimates = gain * seen
    difference, prior = np.mean(estimates), np.mean(spread**2)
    of_spread = np.var(estimates)
    arrays = ([[value]] for value in (np.mean(gain) + of_spread, of_spread, difference, prior))
    variance = typical(*map(np.array, arrays))[0, 0]
    # Where the estimate differs from 0 by the root of the prior variance.
    at_spread = np.mean(gain) + np.var(gain * np.sqrt(prior) / np.mean(gain))
    if difference**2 < prior:
        assert variance == pytest.approx(np.mean(gain) + of_spread)
        assert variance < at_spread
    else:
        assert variance == pytest.approx(at_spread)


def test_nominal_values_have_no_far_point():
    scanner = SCANNERS["HDL-64E"]
    design = nominal(scanner)
    assert UnitSettings.recommended(scanner, factory=design).far_point_m is None
    measured = replace(design, dl=np.full(len(design), 1.2))
    assert UnitSettings.recommended(scanner, factory=measured).far_point_m == 25.04


def test_means_of_bins_have_the_mean_misclosure(small):
    factory, station, _ = small
    data = station.observations
    own = (data.laser_id == data.laser_id[0]) & (data.plane_number == data.plane_number[0])
    bins = azimuth_bins([replace(station, observations=data.take(own))], factory, np.deg2rad(12.0))
    assert bins.count.max() > 2.0
    ours = (bins.count * bins.mean.misclosure(factory)).sum() / bins.count.sum()
    assert ours == pytest.approx(data.take(own).misclosure(factory).mean(), rel=1e-9)


def test_order_of_rows_and_of_stations_does_not_matter(small):
    factory, station, _ = small
    other = replace(
        station, name="other", observations=station.observations.take(slice(0, None, 2))
    )
    first = adjust_unit([station, other], factory, QUICK)
    order = np.random.default_rng(0).permutation(len(station.observations.phi))
    mixed = replace(station, observations=station.observations.take(order))
    second = adjust_unit([other, mixed], factory, QUICK)
    np.testing.assert_allclose(stacked(first), stacked(second), rtol=1e-6, atol=1e-9)


def test_lasers_without_observations_get_the_mean_of_the_unit(small):
    """Their standard deviation is that of the unit, and they are named."""
    factory, station, _ = small
    result = adjust_unit([station], factory, QUICK)
    finite(result)
    unseen = ~result.calibration.observed
    assert unseen.any()
    assert not unseen.all()
    assert np.ptp(result.calibration.corrections[unseen], axis=0).max() == 0.0
    assert (result.determined[unseen] < 0.05).all()
    assert {held.laser_id for held in result.held} >= set(np.flatnonzero(unseen).tolist())
    sigma = result.sigma("sigma_alpha")
    assert (result.calibration.std[unseen, 1] >= 0.99 * sigma).all()


def test_covariance_between_lasers_is_positive_semi_definite(small):
    factory, station, _ = small
    result = adjust_unit([station], factory, QUICK)
    lasers = len(factory)
    flat = result.shared.reshape(3 * lasers, -1)
    total = flat @ flat.T
    for k in range(lasers):
        rows = slice(3 * k, 3 * k + 3)
        own = result.calibration.covariance[k] - total[rows, rows]
        assert np.linalg.eigvalsh(own).min() > -1e-9 * np.abs(total).max()


def test_standard_deviation_without_the_mean_is_that_of_the_whole_covariance(small):
    factory, station, _ = small
    result = adjust_unit([station], factory, QUICK)
    lasers = len(factory)
    for place, name in enumerate(("dl", "alpha", "v")):
        shared = result.shared[:, place]
        whole = shared @ shared.T
        np.fill_diagonal(whole, result.calibration.covariance[:, place, place])
        without = np.eye(lasers) - 1.0 / lasers
        expected = np.sqrt(np.diag(without @ whole @ without.T))
        np.testing.assert_allclose(result.std_without_mean(name), expected, rtol=1e-6)


def test_errors_of_the_base_are_the_same_at_all_stations(small):
    """Base targets turn and move the scanner frame alike, wherever the origin of the site lies."""
    factory, station, _ = small
    rng = np.random.default_rng(5)
    root = np.diag([7e-3, 7e-3, 5e-3, 5e-4, 5e-4, 4e-4]) @ np.linalg.qr(rng.normal(size=(6, 6)))[0]
    base = root @ root.T
    stations = []
    for number, place in enumerate(([2.0, -3.0, -1.0], [-4.0, 5.0, -1.0])):
        # Rotation w about the scanner and movement r are rotation w and translation r + w x t.
        about = np.eye(6)
        about[3:, :3] = -np.cross(np.eye(3), place)
        survey = replace(station.survey, pose=about @ base @ about.T, translation=np.array(place))
        stations.append(about_scanner(replace(station, name=f"S{number}", survey=survey)))
    bins = azimuth_bins(stations, factory, np.deg2rad(0.9))
    at = linearise(bins, factory, np.zeros((len(factory), len(UNKNOWNS))), None)
    settings = UnitSettings(pose_in_common=0.4)
    shared = shared_effects(stations, bins, at, settings)
    first, second = shared.pose(0), shared.pose(1)
    scale = np.sqrt(np.outer(np.diag(base), np.diag(base)))
    np.testing.assert_allclose(first @ first.T / scale, base / scale, atol=1e-9)
    np.testing.assert_allclose(first @ second.T / scale, 0.4 * base / scale, atol=1e-9)


@pytest.mark.parametrize("planes", [(0,), (2,), (0, 1)], ids=["one wall", "floor", "walls"])
def test_few_planes_do_no_harm(small, planes):
    """At most the errors of the factory by the share that eight lasers can show by chance."""
    factory, station, true = small
    kept = np.isin(station.observations.plane_number, planes)
    part = replace(station, observations=station.observations.take(kept))
    result = adjust_unit([part], factory, replace(QUICK, integration_points=8))
    finite(result)
    seen = result.calibration.observed
    error, wanted = errors_of(result, true, factory)
    size, before = (np.sqrt((each[seen] ** 2).mean(axis=0)) for each in (error, wanted))
    assert size[0] < 0.5 * before[0]
    assert (size[1:] < 1.2 * before[1:]).all()


def test_a_handful_of_observations_gives_a_finite_result(small):
    factory, station, _ = small
    few = replace(station, observations=station.observations.take(slice(0, 7)))
    finite(adjust_unit([few], factory, QUICK))


def test_a_prior_that_is_given_is_not_learnt(small):
    factory, station, _ = small
    settings = replace(QUICK, prior={"alpha": 0.001, "dl": 0.03})
    result = adjust_unit([station], factory, settings)
    learnt = {one.name: one.learnt for one in result.population}
    assert result.sigma("sigma_alpha") == 0.001
    assert not learnt["sigma_alpha"]
    assert not learnt["sigma_dl"]
    assert learnt["sigma_v"]


def test_the_correction_of_the_distance_fades_to_the_far_point(small):
    factory, station, _ = small
    result = adjust_unit([station], factory, replace(QUICK, far_point_m=25.04))
    dl, at = result.calibration.corrections[:, 0], result.mean_range_m
    ranges = np.array([0.0, 25.04, 80.0])
    found = result.near_correction(ranges)
    np.testing.assert_allclose(found[:, 0], dl * 25.04 / (25.04 - at))
    np.testing.assert_array_equal(found[:, 1:], 0.0)
    own = np.array([result.near_correction(at[[k]])[k, 0] for k in range(len(at))])
    np.testing.assert_allclose(own, dl)


def test_a_laser_that_is_off_by_the_limit_is_assigned_again(small):
    """A laser is off by 25 cm: half of its returns lie outside of the limit, the nearer ones in.

    What is left of them brings it in.
    """
    factory, station, _ = small
    data = station.observations
    laser = int(data.laser_id[0])
    own = data.laser_id == laser
    off = 0.25 - np.median(data.misclosure(factory)[own])
    whole = replace(data, distance_m=np.where(own, data.distance_m + off, data.distance_m))
    expected = np.bincount(data.laser_id, minlength=len(factory))

    def assign(parameters):
        kept = np.abs(whole.misclosure(parameters)) < 0.25
        return [replace(station, observations=whole.take(kept), expected=expected)]

    first = adjust_unit(assign(factory), factory, QUICK)
    assert first.stations[0].share[laser] < 0.9
    assert any(f"lasers {laser}" in text for text in first.warnings)
    result = readjust(assign, factory, QUICK)
    assert result.passes > 1
    assert result.stations[0].share[laser] == 1.0
    assert not result.warnings


def test_an_assignment_that_never_ends_is_told(small, monkeypatch):
    factory, station, _ = small
    monkeypatch.setattr(adjust, "MAX_PASSES", 2)
    calls = []

    def assign(parameters):
        calls.append(parameters)
        return [
            replace(
                station, observations=station.observations.take(slice(0, None, 1 + len(calls) % 2))
            )
        ]

    result = readjust(assign, factory, QUICK)
    assert any("still changes" in text for text in result.warnings)


def test_recommended_settings_follow_the_scanner():
    own_file = UnitSettings.recommended(SCANNERS["HDL-64E"])
    nominal = UnitSettings.recommended(SCANNERS["VLP-16"], prior={"v": 0.001})
    assert own_file.far_point_m == 25.04
    assert nominal.far_point_m is None
    assert own_file.shift_m > nominal.shift_m
    assert nominal.prior == {"v": 0.001}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"azimuth_bin_rad": 0.0}, "azimuth_bin_rad is 0.0"),
        ({"pose_in_common": 1.0}, "pose_in_common is 1.0"),
        ({"prior": {"range": 1.0}}, "'range'"),
        ({"prior": {"dl": -1.0}}, "-1.0"),
    ],
)
def test_wrong_settings_are_told(change, told):
    with pytest.raises(VelocalError, match=told):
        UnitSettings(**change)


def test_wrong_input_is_told(small):
    factory, station, _ = small
    data = station.observations
    with pytest.raises(VelocalError, match="no observations"):
        adjust_unit([], factory)
    with pytest.raises(VelocalError, match="no observations"):
        adjust_unit([replace(station, observations=data.take(slice(0, 0)))], factory)
    with pytest.raises(VelocalError, match="more than one station"):
        adjust_unit([station, station], factory)
    unknown = replace(data, laser_id=np.full(len(data.phi), 40))
    with pytest.raises(VelocalError, match="laser 40"):
        adjust_unit([replace(station, observations=unknown)], factory)
    endless = replace(data, distance_m=np.full(len(data.phi), np.nan))
    with pytest.raises(VelocalError, match="no finite distance"):
        adjust_unit([replace(station, observations=endless)], factory)
    with pytest.raises(VelocalError, match="2 names"):
        replace(station, plane_names=("a", "b"))


def test_lasers_are_adjusted_though_the_survey_does_not_know_their_mean():
    """The survey is turned by 3.7 times what it states: some of it may be a mean of alpha.

    The differences of the lasers are well known all the same.
    """
    common = UnitErrors(alpha_mean_deg=0.9)
    trial = draw(Plan(scanner="VLP-16", stations=2, windows=1, every=8, unit=common), 4)
    stations = [each.survey.of_unit(each.windows[0]) for each in trial.stations]
    found = adjust_unit(
        stations, trial.factory, replace(QUICK, linearisations=2, integration_points=8)
    )
    alpha = next(one for one in found.common if one.name == "alpha")
    assert 3.0 < alpha.by_survey / alpha.by_survey_std < 4.5
    assert 0.0 < alpha.decided < 1.0
    assert alpha.std > found.sigma("sigma_alpha")
    error, wanted = errors_of(found, trial.true, trial.factory)
    assert np.std(error[:, 1]) < 0.2 * np.std(wanted[:, 1])
    assert not any(one.name == "alpha" for one in found.held)
