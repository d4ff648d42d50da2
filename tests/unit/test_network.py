"""Networks: equations, an independent solution, what cannot be adjusted, and their files."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from support.chain import study_world

from velocal.errors import SurveyError
from velocal.geometry.rigid import adjust_rigid, skew
from velocal.simulation import survey
from velocal.survey.network.adjust import adjust_network
from velocal.survey.network.approximate import intersection, resected_camera, resected_instrument
from velocal.survey.network.field_book import FILES, FieldBook, read_field_book, write_field_book
from velocal.survey.network.model import (
    ControlPoints,
    ImageObservations,
    PolarObservations,
    Unknowns,
    image_equations,
    polar_equations,
)
from velocal.survey.network.survey import accuracy, adjust_field_book
from velocal.survey.targets import SurveyCovariances, Targets

CONTROL = np.array(
    [[0, 0, 0.3], [4, 0, 1.8], [2, 0, 1], [0, 2, 1.5], [0, 1, 0.2], [3, 2, 0], [1, 2.5, 0.0]]
)
NAMES = tuple(f"C{i}" for i in range(len(CONTROL)))
EXTRA = np.array([[1.5, 0.4, 0.8], [2.5, 0.1, 1.4]])
INSTRUMENTS = {"S1": [1.0, 4.0, 1.5, 0.3], "S2": [3.0, 4.5, 1.4, -2.0], "S3": [5.0, 3.0, 1.6, 3.1]}


def polar(rng, points, names, instruments=INSTRUMENTS, angle=2e-4, distance=1e-3):
    """Observe all points from all instruments; no distance to the points named E."""
    parts = []
    for station in instruments.values():
        value, _, _ = polar_equations(points, np.tile(np.array(station), (len(points), 1)))
        parts.append(value + rng.normal(size=value.shape) * [angle, angle, distance])
    value = np.concatenate(parts)
    target = names * len(instruments)
    value[[name.startswith("E") for name in target], 2] = np.nan
    std = np.tile([angle, angle, distance], (len(value), 1))
    return PolarObservations(tuple(s for s in instruments for _ in names), target, value, std)


def cameras(count=4):
    """Places, and rotations into cameras that look at the points."""
    places = np.array([[0.5 + 1.4 * i, 4.5 - 0.3 * i, 0.8 + 0.4 * (i % 2)] for i in range(count)])
    rotations = []
    for place in places:
        forward = np.array([1.6, 0.4, 0.8]) - place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotations.append(np.stack([right, np.cross(forward, right), forward]))
    return places, np.array(rotations)


def image_coordinates(rng, points, names, std=1e-4):
    places, rotations = cameras()
    parts = []
    for place, rotation in zip(places, rotations, strict=True):
        n = len(points)
        value, _, _ = image_equations(points, np.tile(place, (n, 1)), np.tile(rotation, (n, 1, 1)))
        parts.append(value + rng.normal(0.0, std, value.shape))
    value = np.concatenate(parts)
    images = tuple(f"I{i}" for i in range(len(places)) for _ in names)
    return ImageObservations(images, names * len(places), value, np.full(value.shape, std))


def everything(seed=0):
    rng = np.random.default_rng(seed)
    names = (*NAMES, "E1", "E2")
    points = np.concatenate([CONTROL, EXTRA])
    control = ControlPoints(NAMES, CONTROL + rng.normal(0.0, 0.003, CONTROL.shape))
    return control, polar(rng, points, names), image_coordinates(rng, points, names)


def constraints(xyz):
    """Inner constraints: three shifts, and the turn about Z."""
    centred = xyz - xyz.mean(axis=0)
    return np.concatenate(
        [np.concatenate([np.eye(3), [[-y], [x], [0.0]]], axis=1) for x, y, _ in centred]
    )


def test_derivatives_of_polar_and_image_observations():
    rng = np.random.default_rng(3)
    points, stations = rng.normal(size=(5, 3)), rng.normal(size=(5, 4)) + 4.0
    rotations = Rotation.random(5, rng=rng).as_matrix()
    h = 1e-6
    _, by_point, by_station = polar_equations(points, stations)
    _, ray_point, ray_camera = image_equations(points, stations[:, :3], rotations)
    for axis in range(3):
        e = h * np.eye(3)[axis]
        found = [polar_equations(points + s * e, stations)[0] for s in (1, -1)]
        np.testing.assert_allclose(by_point[:, :, axis], (found[0] - found[1]) / (2 * h), atol=1e-8)
        found = [image_equations(points + s * e, stations[:, :3], rotations)[0] for s in (1, -1)]
        scale = np.abs(ray_point).max()
        np.testing.assert_allclose(
            ray_point[:, :, axis], (found[0] - found[1]) / (2 * h), atol=1e-8 * scale**2
        )
    for axis in range(4):
        e = h * np.eye(4)[axis]
        found = [polar_equations(points, stations + s * e)[0] for s in (1, -1)]
        np.testing.assert_allclose(
            by_station[:, :, axis], (found[0] - found[1]) / (2 * h), atol=1e-8
        )
    for axis in range(6):
        step = h * np.eye(6)[axis]
        found = []
        for sign in (1, -1):
            moved = Unknowns(np.zeros((0, 3)), np.zeros((0, 4)), stations[:, :3], rotations).moved(
                np.tile(sign * step, 5)
            )
            found.append(image_equations(points, moved.cameras, moved.rotations)[0])
        np.testing.assert_allclose(
            ray_camera[:, :, axis], (found[0] - found[1]) / (2 * h),
            atol=1e-7 * np.abs(ray_camera).max() ** 2,
        )  # fmt: skip


def test_against_an_independent_solution():
    """scipy's least squares in some datum, and its covariance by the S-transformation."""
    control, observed, images = everything()
    found = adjust_network(control, observed, images)
    n, stations = len(found.name), list(INSTRUMENTS)
    there = np.isfinite(observed.value)
    number = {name: row for row, name in enumerate(found.name)}
    polar_rows = [(number[t], stations.index(s))
             for s, t in zip(observed.setup, observed.target, strict=True)]  # fmt: skip
    image_rows = [(number[t], int(s[1:])) for s, t in zip(images.setup, images.target, strict=True)]
    places, rotations = cameras()
    start = np.concatenate(
        [CONTROL.ravel(), EXTRA.ravel(), np.array(list(INSTRUMENTS.values())).ravel(),
         np.column_stack([places, Rotation.from_matrix(rotations).as_rotvec()]).ravel()]
    )  # fmt: skip

    def residuals(x):
        points = x[: 3 * n].reshape(-1, 3)
        setup = x[3 * n : 3 * n + 12].reshape(-1, 4)
        camera = x[3 * n + 12 :].reshape(-1, 6)
        p, s = (np.array(i) for i in zip(*polar_rows, strict=True))
        d = points[p] - setup[s, :3]
        length = np.linalg.norm(d, axis=1)
        angle = observed.value[:, 0] - (np.pi / 2 - np.angle(d[:, 0] + 1j * d[:, 1]) - setup[s, 3])
        angle = np.angle(np.exp(1j * angle))
        w = np.column_stack(
            [angle, observed.value[:, 1] - np.arccos(d[:, 2] / length),
             observed.value[:, 2] - length]
        ) / observed.std  # fmt: skip
        p, c = (np.array(i) for i in zip(*image_rows, strict=True))
        seen = Rotation.from_rotvec(camera[c, 3:]).apply(points[p] - camera[c, :3])
        image = (images.value - seen[:, :2] / seen[:, 2:]) / images.std
        return np.concatenate([w[there], image.ravel()])

    other = least_squares(residuals, start, jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15,
                          gtol=1e-15)  # fmt: skip
    k = 3 * len(NAMES)
    # Its frame drifts along the four freedoms: bring it to the datum of the control points.
    points = other.x[: 3 * n].reshape(-1, 3)
    known, middle = control.xyz - control.xyz.mean(axis=0), points[: len(NAMES)].mean(axis=0)
    flat, wanted = ((xyz[:, 0] + 1j * xyz[:, 1]) for xyz in (points[: len(NAMES)] - middle, known))
    turn = Rotation.from_rotvec([0, 0, np.angle(np.sum(wanted * flat.conj()))])
    points = turn.apply(points - middle) + control.xyz.mean(axis=0)
    np.testing.assert_allclose(found.xyz, points, atol=1e-8)

    jacobian = other.jac
    some = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-11)[: 3 * n, : 3 * n]
    some = np.kron(np.eye(n), turn.as_matrix()) @ some @ np.kron(np.eye(n), turn.as_matrix().T)
    border, freedoms = constraints(control.xyz), constraints(points)
    inner = np.zeros((3 * n, 4))
    inner[:k] = border
    transform = np.eye(3 * n) - freedoms @ np.linalg.solve(inner.T @ freedoms, inner.T)
    expected = transform @ some @ transform.T
    np.testing.assert_allclose(found.cofactor, expected, atol=1e-6 * np.abs(expected).max())
    assert found.redundancy == int(there.sum()) + images.value.size - len(start) + 4
    np.testing.assert_allclose(found.variance_factor, 2 * other.cost / found.redundancy, rtol=1e-6)


def test_datum_is_that_of_the_approximate_coordinates():
    control, observed, images = everything()
    found = adjust_network(control, observed, images)
    moved = (found.xyz[: len(NAMES)] - control.xyz).ravel()
    np.testing.assert_allclose(constraints(control.xyz).T @ moved, 0.0, atol=1e-9)
    k = 3 * len(NAMES)
    np.testing.assert_allclose(constraints(control.xyz).T @ found.cofactor[:k, :k], 0.0, atol=1e-12)


def test_one_after_the_other_is_as_good_as_together():
    """Control points with their full covariance carry all information of the polar observations."""
    control, observed, images = everything()
    observed = without(observed, lambda s, t: t in NAMES)
    together = adjust_network(control, observed, images)
    first = adjust_network(control, observed)
    known = ControlPoints(first.name, *first.part(first.name, a_priori=True))
    second = adjust_network(known, images=images)
    order = [second.name.index(name) for name in together.name]
    np.testing.assert_allclose(second.xyz[order], together.xyz, atol=2e-6)
    std = np.sqrt(np.diag(together.cofactor)).reshape(-1, 3)
    again = np.sqrt(np.diag(second.cofactor)).reshape(-1, 3)
    np.testing.assert_allclose(again[order], std, rtol=5e-3)


def test_true_points_lie_within_what_is_stated():
    """Errors of a hundred small networks, normalised: 95 % within 1.96, mean square 1."""
    names, points = (*NAMES, "E1", "E2"), np.concatenate([CONTROL, EXTRA])
    normalised, factors = [], []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        found = adjust_network(ControlPoints(NAMES, CONTROL), polar(rng, points, names))
        # The truth is in the datum: the approximate coordinates are the true ones.
        std = np.sqrt(np.diag(found.cofactor)).reshape(-1, 3)
        normalised.append((found.xyz - points) / std)
        factors.append(found.variance_factor)
    normalised = np.array(normalised)
    # Coordinates of a network are correlated: only the networks count as independent.
    assert np.mean(np.abs(normalised) < 1.96) == pytest.approx(0.95, abs=0.03)
    assert np.mean(normalised**2) == pytest.approx(1.0, abs=0.15)
    assert np.mean(factors) == pytest.approx(1.0, abs=4 * np.sqrt(2 / found.redundancy / 100))


def test_a_gross_error_is_named():
    control, observed, _ = everything()
    value = observed.value.copy()
    value[4, 0] += 0.004
    found = adjust_network(control, replace(observed, value=value))
    assert found.largest_residual_of == f"direction S1-{observed.target[4]}"
    assert found.largest_residual > 4.0
    assert found.probability < 0.01


def without(observed, keep):
    rows = [r for r, pair in enumerate(zip(observed.setup, observed.target, strict=True))
            if keep(*pair)]  # fmt: skip
    return PolarObservations(
        tuple(observed.setup[r] for r in rows), tuple(observed.target[r] for r in rows),
        observed.value[rows], observed.std[rows],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("keep", "message"),
    [
        (lambda s, t: t != "E1" or s == "S1", r"point 'E1' is seen from 1 set-up"),
        (lambda s, t: s == "S1", "seen from 1 set-up"),
        (lambda s, t: s != "S3" or t in ("C0", "E1"), "S3.*cannot be placed"),
        (lambda s, t: t != "C3", "point 'C3' is seen from 0 set-up"),
    ],
)
def test_what_hangs_in_the_air_is_named(keep, message):
    control, observed, _ = everything()
    with pytest.raises(SurveyError, match=message):
        adjust_network(control, without(observed, keep), where="book")


def test_two_networks_that_share_no_point():
    rng = np.random.default_rng(0)
    left = polar(rng, CONTROL, NAMES)
    names = tuple(f"D{i}" for i in range(len(CONTROL)))
    right = polar(rng, CONTROL + 9.0, names, {"T1": INSTRUMENTS["S1"], "T2": INSTRUMENTS["S2"]})
    both = PolarObservations(
        left.setup + right.setup, left.target + right.target,
        np.concatenate([left.value, right.value]), np.concatenate([left.std, right.std]),
    )  # fmt: skip
    control = ControlPoints(NAMES + names, np.concatenate([CONTROL, CONTROL + 9.0]))
    with pytest.raises(SurveyError, match="point 'D0' is not connected"):
        adjust_network(control, both)


def test_images_alone_have_no_plumb_line():
    control, _, images = everything()
    with pytest.raises(SurveyError, match="do not determine"):
        adjust_network(control, images=images)


def test_exchanged_names_do_not_pass_silently():
    control, observed, _ = everything()
    swapped = {"C0": "C1", "C1": "C0"}
    target = tuple(
        swapped.get(t, t) if s == "S2" else t
        for s, t in zip(observed.setup, observed.target, strict=True)
    )
    found = adjust_network(control, replace(observed, target=target))
    assert found.probability < 1e-6
    assert found.largest_residual_of.split()[-1] in ("S2-C0", "S2-C1")


def test_approximate_values():
    places, rotations = cameras()
    names = len(CONTROL)
    for place, rotation in zip(places, rotations, strict=True):
        value, _, _ = image_equations(
            CONTROL, np.tile(place, (names, 1)), np.tile(rotation, (names, 1, 1))
        )
        found = resected_camera(value, CONTROL, where="x")
        np.testing.assert_allclose(found[0], place, atol=1e-9)
        np.testing.assert_allclose(found[1], rotation, atol=1e-9)
    # Hardly off a plane, and noisy: the linear solution fails, the camera is found all the same.
    rng = np.random.default_rng(0)
    for place, rotation in zip(places, rotations, strict=True):
        thin = CONTROL * [1.0, 0.02, 1.0]
        value, _, _ = image_equations(
            thin, np.tile(place, (names, 1)), np.tile(rotation, (names, 1, 1))
        )
        value += rng.normal(0.0, 1e-3, value.shape)
        found = resected_camera(value, thin, where="x")
        np.testing.assert_allclose(found[0], place, atol=0.1)
    with pytest.raises(SurveyError, match="do not fit"):
        resected_camera(rng.normal(size=(7, 2)), CONTROL, where="x")
    for station in INSTRUMENTS.values():
        value, _, _ = polar_equations(CONTROL, np.tile(np.array(station), (names, 1)))
        place, zero = resected_instrument(value, CONTROL, where="x")
        np.testing.assert_allclose([*place, zero], station, atol=1e-9)
    flat = CONTROL * [1, 1, 0]
    with pytest.raises(SurveyError, match="7 control points"):
        resected_camera(np.zeros((7, 2)), flat, where="x")
    with pytest.raises(SurveyError, match="parallel"):
        intersection(np.eye(3)[:2], np.array([[0, 0, 1.0], [0, 0, 1.0]]))


@pytest.fixture(scope="module")
def book() -> FieldBook:
    return survey.field_book(study_world())


def paths(folder):
    return {name: folder / f"{name}.csv" for name in FILES}


def test_field_book_round_trip(tmp_path, book):
    write_field_book(book, paths(tmp_path), 24.0)
    found = read_field_book(paths(tmp_path))
    assert found.control.name == book.control.name
    assert found.planes == book.planes
    np.testing.assert_allclose(found.control.xyz, book.control.xyz, atol=1e-9)
    turn = np.exp(1j * (found.polar.value[:, 0] - book.polar.value[:, 0]))
    np.testing.assert_allclose(turn, 1.0, atol=1e-8)
    np.testing.assert_allclose(found.polar.value[:, 1:], book.polar.value[:, 1:], atol=5.1e-6)
    np.testing.assert_allclose(found.images.value, book.images.value, atol=3e-7)
    np.testing.assert_allclose(found.images.std, book.images.std, rtol=1e-3)
    for position, part in book.base_polar.items():
        assert found.base_polar[position].target == part.target
        np.testing.assert_allclose(found.base_polar[position].std, part.std, rtol=1e-3)
    for scanner, part in book.base_coordinates.items():
        np.testing.assert_allclose(found.base_coordinates[scanner].xyz, part.xyz, atol=5.1e-6)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("network", "zenith_deg", "zenith_gon", "missing column 'zenith_deg'"),
        ("network", "S1,short_wall_c001,1", "S1,short_wall_c001,x1", "is no number"),
        ("network", ",2.008", ",0", "std_distance_mm is not positive: '0"),
        ("base_readings", "HDL-64E,B1,-0.3", "HDL-64E,B1,,-0.3", "row 2: the row has 9 values"),
        ("images", ",3.35,", ",,", "std_um"),
        ("points", "floor_t001,", "floor_t002,", "'floor_t002' occurs twice"),
    ],
)
def test_faults_of_a_field_book(tmp_path, book, file, old, new, message):
    write_field_book(book, paths(tmp_path), 24.0)
    path = tmp_path / f"{file}.csv"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(SurveyError, match=message):
        read_field_book(paths(tmp_path))


def test_targets_may_be_observed_by_instruments_instead_of_cameras():
    rng = np.random.default_rng(2)
    names = (*NAMES, "E1", "E2")
    control = ControlPoints(NAMES, CONTROL)
    observed = polar(rng, np.concatenate([CONTROL, EXTRA]), names)
    found = adjust_field_book(FieldBook(control, {"E1": "wall", "E2": "wall"}, observed))
    assert found.planes.name == ("E1", "E2")
    np.testing.assert_allclose(found.planes.xyz, EXTRA, atol=5e-3)
    assert accuracy(found)["item"] == ["control_points", "targets"]
    assert [row["adjustment"] for row in found.to_json()["adjustments"]] == ["control points"]
    with pytest.raises(SurveyError, match="target 'E9' of 'wall' was never observed"):
        adjust_field_book(FieldBook(control, {"E9": "wall"}, observed))


def test_a_fault_is_found_in_the_row_of_the_file(tmp_path, book):
    """Also if the row belongs to a later position."""
    write_field_book(book, paths(tmp_path), 24.0)
    path = tmp_path / "base_sights.csv"
    lines = path.read_text().splitlines()
    observed = lines[-1].rsplit(",", 3)[0]
    path.write_text("\n".join([*lines[:-1], f"{observed},0,3,1"]) + "\n")
    with pytest.raises(SurveyError, match=f"row {len(lines)}: "):
        read_field_book(paths(tmp_path))


def test_accuracy_of_repeated_coordinates_follows_from_their_scatter():
    rng = np.random.default_rng(5)
    true = rng.normal(size=(6, 3))
    names = tuple(f"B{i}" for i in range(6) for _ in range(50))
    xyz = np.repeat(true, 50, axis=0) + rng.normal(0.0, [2e-3, 1e-3, 1e-3], (300, 3))
    repeated = Targets(names, ("s",) * 300, xyz, np.full((300, 3), 5e-3))
    control, observed, _ = everything()
    book = FieldBook(control, {}, observed, base_coordinates={"s": repeated})
    found = adjust_field_book(book).base_scanner["s"]
    groups = xyz.reshape(6, 50, 3)
    expected = np.sqrt(groups.var(axis=1, ddof=1).mean(axis=0) / 50)
    np.testing.assert_allclose(found.targets.std, np.tile(expected, (6, 1)))
    np.testing.assert_allclose(found.targets.xyz, groups.mean(axis=1))
    assert found.redundancy == 3 * (300 - 6)
    assert found.probability < 1e-6  # 5 mm stated, 1 and 2 mm seen
    once = replace(book, base_coordinates={"s": repeated.take(range(0, 300, 50))})
    single = adjust_field_book(once).base_scanner["s"]
    np.testing.assert_allclose(single.targets.std, 5e-3)
    assert np.isnan(single.variance_factor)


def test_pose_uses_what_base_targets_have_in_common():
    """A common error of all targets shifts the pose, and may not count as n independent ones."""
    rng = np.random.default_rng(1)
    base = rng.normal(0.0, 0.3, (6, 3))
    own, common = 1e-4, 1e-3
    joint = own**2 * np.eye(18) + common**2 * np.tile(np.eye(3), (6, 6))
    none = np.tile(1e-12 * np.eye(3), (6, 1, 1))
    pose = adjust_rigid(base, base, none, joint).transformation
    design = np.concatenate([np.concatenate([-skew(p), np.eye(3)], axis=1) for p in base])
    expected = np.linalg.inv(design.T @ np.linalg.inv(joint + 1e-12 * np.eye(18)) @ design)
    np.testing.assert_allclose(pose.covariance, expected, rtol=1e-6)
    assert np.sqrt(pose.covariance[5, 5]) > 0.9 * common
    blocks = joint.reshape(6, 3, 6, 3)[range(6), :, range(6)]
    alone = adjust_rigid(base, base, none, blocks).transformation
    assert np.sqrt(alone.covariance[5, 5]) < 0.6 * common


def test_targets_carry_their_covariance():
    joint = np.diag(np.arange(1.0, 10.0))
    joint[0, 3] = joint[3, 0] = 0.5
    targets = Targets(("a", "b", "c"), ("P",) * 3, np.zeros((3, 3)), np.ones((3, 3)))
    np.testing.assert_array_equal(targets.covariance(), np.eye(9))
    base = {"targets": ["a", "b", "c"], "covariance_m2": joint.tolist()}
    covariances = SurveyCovariances.from_json({"base_field": {"P": base}, "planes": {}})
    known = covariances.of_base(targets, "P", where="x")
    assert known.take([1, 0]).covariance()[3, 0] == 0.5
    np.testing.assert_array_equal(known.blocks()[2], np.diag([7.0, 8.0, 9.0]))
    with pytest.raises(SurveyError, match="other targets"):
        covariances.of_base(targets.take([0, 1]), "P", where="x")
    with pytest.raises(SurveyError, match=r"other targets.*'P2'"):
        covariances.of_base(targets, "P2", where="x")
