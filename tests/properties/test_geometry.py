"""Rigid transformations and planes: inverses, exact recovery, covariances against simulation."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from velocal.errors import SurveyError
from velocal.geometry.planes import Patch, Plane, fit_plane, hull_patch
from velocal.geometry.rigid import (
    RigidTransformation,
    adjust_rigid,
    closed_form,
    rotation_from_vector,
    skew,
)

RUNS = 400
# The standard deviation of RUNS normal numbers is uncertain by 1/sqrt(2 RUNS) = 3.5 %.
STD_TOLERANCE = 5 / np.sqrt(2 * RUNS)

vectors = hnp.arrays(np.float64, 3, elements=st.floats(-3, 3, allow_subnormal=False))


def covariance_of(seed: int, n: int = 6, scale: float = 1e-3) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(n, n)) * scale
    return root @ root.T


def mahalanobis_mean(errors: np.ndarray, covariance: np.ndarray) -> float:
    """Mean of e' C^-1 e over the degrees of freedom: 1 if the covariance is right."""
    values, basis = np.linalg.eigh(covariance)
    kept = values > 1e-9 * values[-1]
    whitened = errors @ basis[:, kept] / np.sqrt(values[kept])
    return float(np.mean(whitened**2))


# -- rotations and transformations --------------------------------------------------------


@given(vectors, vectors)
def test_rotation_from_vector(vector, point):
    rotation = rotation_from_vector(vector)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(rotation @ vector, vector, atol=1e-13)
    np.testing.assert_allclose(rotation_from_vector(-vector), rotation.T, atol=1e-14)
    np.testing.assert_allclose(skew(vector) @ point, np.cross(vector, point), atol=1e-13)


def test_rotation_by_hand():
    """A quarter turn about Z takes X to Y."""
    np.testing.assert_allclose(
        rotation_from_vector(np.array([0, 0, np.pi / 2])) @ [1, 0, 0], [0, 1, 0], atol=1e-15
    )


@given(vectors, vectors, hnp.arrays(np.float64, (4, 3), elements=st.floats(-9, 9)))
def test_inverse(vector, translation, points):
    there = RigidTransformation(rotation_from_vector(vector), translation, covariance_of(1))
    back = there.inverse()
    np.testing.assert_allclose(back.apply(there.apply(points)), points, atol=1e-12)
    np.testing.assert_allclose(there.apply(back.apply(points)), points, atol=1e-12)
    twice = back.inverse()
    np.testing.assert_allclose(twice.rotation, there.rotation, atol=1e-14)
    np.testing.assert_allclose(twice.translation, there.translation, atol=1e-13)
    np.testing.assert_allclose(twice.covariance, there.covariance, rtol=1e-9, atol=1e-16)


def log_rotation(rotation: np.ndarray) -> np.ndarray:
    """Rotation vector of a small rotation."""
    return 0.5 * np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )


def test_covariance_of_the_inverse():
    """Drawn transformations, each inverted, spread as the propagated covariance says."""
    rng = np.random.default_rng(3)
    covariance = covariance_of(4, scale=1e-5)
    rotation, translation = rotation_from_vector(np.array([0.3, -0.9, 2.0])), np.array([1, -2, 5.0])
    inverse = RigidTransformation(rotation, translation, covariance).inverse()
    errors = []
    for error in rng.multivariate_normal(np.zeros(6), covariance, size=RUNS):
        true_rotation = rotation_from_vector(error[:3]) @ rotation
        true = RigidTransformation(true_rotation, translation + error[3:], covariance).inverse()
        turned = log_rotation(true.rotation @ inverse.rotation.T)
        errors.append([*turned, *(true.translation - inverse.translation)])
    # The eigenvalues span a wide range: every direction has to be right, not the largest alone.
    assert mahalanobis_mean(np.array(errors), inverse.covariance) == pytest.approx(
        1, abs=5 * np.sqrt(2 / (6 * RUNS))
    )
    np.testing.assert_allclose(
        np.std(errors, axis=0), np.sqrt(np.diag(inverse.covariance)), rtol=STD_TOLERANCE
    )


def test_accuracy_of_the_origin_does_not_depend_on_the_place_of_the_source_frame():
    """A scanner is as accurate as its targets, however far away the site frame begins."""
    targets = np.array([[0.3, 0, 0], [-0.3, 0.1, 0], [0, 0.3, 0.2], [0, -0.2, -0.1]])
    covariance = 1e-6 * np.eye(12)
    stated = []
    for far in (0.0, 1.0, 100.0):
        rotation = rotation_from_vector(np.array([0.1, 0.2, 1.5]))
        source = (targets - far * np.array([1.0, -2.0, 0.5])) @ rotation
        pose = adjust_rigid(source, targets, covariance, covariance).transformation
        turned = pose.rotation @ pose.inverse().covariance[3:, 3:] @ pose.rotation.T
        np.testing.assert_allclose(pose.origin_std_m(), np.sqrt(np.diag(turned)), rtol=1e-6)
        stated.append(pose.origin_std_m())
    np.testing.assert_allclose(stated, np.tile(stated[0], (3, 1)), rtol=1e-5)
    assert 0.0005 < min(stated[0]) < max(stated[0]) < 0.0012


# -- adjustment of a transformation -------------------------------------------------------

SOURCE = np.array(
    [[0.1, 0.1, 0], [0.1, -0.1, 0], [-0.1, 0.1, 0.02],
     [-0.1, -0.1, 0.1], [0, 0.12, 0.2], [0.1, 0, 0.2]]
)  # fmt: skip


def isotropic(std: float, n: int) -> np.ndarray:
    return np.tile(np.eye(3) * std**2, (n, 1, 1))


@given(vectors, vectors, st.integers(3, 10), st.integers(0, 10**6))
def test_exact_points_give_the_exact_transformation(vector, translation, n, seed):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (n, 3))
    singular = np.linalg.svd(source - source.mean(axis=0), compute_uv=False)
    assume(singular[1] > 0.1)
    rotation = rotation_from_vector(vector)
    target = source @ rotation.T + translation
    source_cov = np.stack([covariance_of(seed + k, 3) + 1e-8 * np.eye(3) for k in range(n)])
    target_cov = np.stack([covariance_of(seed + 99 + k, 3) + 1e-8 * np.eye(3) for k in range(n)])
    found = adjust_rigid(source, target, source_cov, target_cov)
    np.testing.assert_allclose(found.transformation.rotation, rotation, atol=1e-11)
    np.testing.assert_allclose(found.transformation.translation, translation, atol=1e-11)
    np.testing.assert_allclose(found.residuals, 0, atol=1e-11)
    assert found.redundancy == 3 * n - 6
    plain_rotation, plain_translation = closed_form(source, target)
    np.testing.assert_allclose(plain_rotation, rotation, atol=1e-11)
    np.testing.assert_allclose(plain_translation, translation, atol=1e-11)


def test_flat_points_are_not_mirrored():
    """Points in one plane, as on a scanner's base, fit a mirrored frame just as well."""
    source = SOURCE * [1, 1, 0]
    rotation = rotation_from_vector(np.array([3.0, 0.2, -0.4]))
    found = adjust_rigid(source, source @ rotation.T, *[isotropic(1e-3, 6)] * 2).transformation
    assert np.linalg.det(found.rotation) == pytest.approx(1)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)


def test_covariance_of_the_adjustment():
    """Different and correlated errors in both systems; the estimates spread as stated."""
    rng = np.random.default_rng(11)
    n = len(SOURCE)
    rotation, translation = (
        rotation_from_vector(np.array([0.02, -0.01, 2.5])),
        np.array([3, -1, 0.8]),
    )
    target = SOURCE @ rotation.T + translation
    source_cov = np.stack([covariance_of(20 + k, 3, 3e-4) for k in range(n)])
    target_cov = np.stack([covariance_of(40 + k, 3, 3e-4) for k in range(n)])
    draw = [
        np.stack([rng.multivariate_normal(np.zeros(3), c, size=RUNS) for c in cov], axis=1)
        for cov in (source_cov, target_cov)
    ]
    errors, factors, covariances = [], [], []
    for source_error, target_error in zip(*draw, strict=True):
        found = adjust_rigid(SOURCE + source_error, target + target_error, source_cov, target_cov)
        estimate = found.transformation
        turned = log_rotation(rotation @ estimate.rotation.T)
        errors.append([*turned, *(translation - estimate.translation)])
        factors.append(found.variance_factor)
        covariances.append(estimate.covariance)
    stated = np.mean(covariances, axis=0)
    np.testing.assert_allclose(np.std(errors, axis=0), np.sqrt(np.diag(stated)), rtol=STD_TOLERANCE)
    assert mahalanobis_mean(np.array(errors), stated) == pytest.approx(
        1, abs=5 * np.sqrt(2 / (6 * RUNS))
    )
    # The variance factor times the redundancy is chi-square of 12 degrees of freedom.
    assert np.mean(factors) == pytest.approx(1, abs=5 * np.sqrt(2 / (12 * RUNS)))


def test_weights_count():
    """A point known badly moves the result little, one known well much."""
    shifted = SOURCE.copy()
    shifted[0] += [0.01, 0, 0]
    moved = []
    for std in (1e-5, 1e-3, 1.0):
        target_cov = isotropic(1e-3, 6)
        target_cov[0] = np.eye(3) * std**2
        found = adjust_rigid(SOURCE, shifted, isotropic(1e-5, 6), target_cov)
        moved.append(float(np.linalg.norm(found.residuals[0])))
    assert moved[0] < 1e-4 < moved[1] < moved[2]
    assert moved[2] == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("n", [3, 8])
def test_points_on_a_line(n):
    source = np.outer(np.linspace(0, 1, n), [1, 2, 3.0])
    with pytest.raises(SurveyError, match="lie on one line") as caught:
        adjust_rigid(source, source + 1.0, *[isotropic(1e-3, n)] * 2)
    assert "Hint:" in str(caught.value)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_too_few_points(n):
    with pytest.raises(SurveyError, match=f"^{n} common points"):
        adjust_rigid(SOURCE[:n], SOURCE[:n], *[isotropic(1e-3, n)] * 2)


# -- planes -------------------------------------------------------------------------------


def grid(normal: np.ndarray, distance: float, n: int = 8, half: float = 1.5) -> np.ndarray:
    """Points of a plane, `distance` from the origin along its normal, around a shifted centre."""
    first = np.cross(normal, [0.3, 0.2, 0.9])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    a, b = np.meshgrid(np.linspace(-half, half, n) + 0.7, np.linspace(-half, half, n) - 0.4)
    return distance * normal + a.reshape(-1, 1) * first + b.reshape(-1, 1) * second


unit_normals = vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(
    lambda v: v / np.linalg.norm(v)
)
slanted = unit_normals.filter(lambda v: np.linalg.norm(np.cross(v, [0.3, 0.2, 0.9])) > 0.05)


@given(slanted, st.floats(0.01, 20), st.booleans())
def test_a_plane_is_recovered(normal, distance, weighted):
    points = grid(normal, distance)
    std = np.linspace(1e-3, 5e-3, len(points)) if weighted else None
    fit = fit_plane(points, std)
    np.testing.assert_allclose(fit.plane.normal, normal, atol=1e-11)
    assert fit.plane.offset == pytest.approx(-distance, abs=1e-11)
    np.testing.assert_allclose(fit.residuals, 0, atol=1e-11)
    # s > 0 behind the plane, seen from the origin
    assert fit.plane.distance(normal * (distance + 1)) == pytest.approx(1)
    a, b, c = fit.plane.general_form()
    np.testing.assert_allclose(points @ [a, b, c] + 1, 0, atol=1e-9 / distance)


@pytest.mark.parametrize("weighted", [True, False])
def test_covariance_of_a_plane(weighted):
    rng = np.random.default_rng(5)
    normal = np.array([0.6, 0.72, -0.35])
    normal /= np.linalg.norm(normal)
    points = grid(normal, 4.0, n=6)
    std = np.full(len(points), 3e-3)
    if weighted:
        std[::3] = 1e-2
    errors, covariances, factors = [], [], []
    for noise in rng.normal(size=(RUNS, len(points), 3)):
        fit = fit_plane(points + noise * std[:, None], std if weighted else None)
        errors.append([*(fit.plane.normal - normal), fit.plane.offset + 4.0])
        covariances.append(fit.plane.covariance)
        factors.append(fit.variance_factor)
    stated = np.mean(covariances, axis=0)
    np.testing.assert_allclose(np.std(errors, axis=0), np.sqrt(np.diag(stated)), rtol=STD_TOLERANCE)
    assert mahalanobis_mean(np.array(errors), stated) == pytest.approx(
        1, abs=5 * np.sqrt(2 / (3 * RUNS))
    )
    expected = 1 if weighted else 9e-6
    assert np.mean(factors) == pytest.approx(expected, rel=5 * np.sqrt(2 / (33 * RUNS)))


def test_weights_of_a_plane():
    """Three sure points hold the plane against a fourth."""
    points = np.array([[0, 5, 0], [1, 5, 0], [0, 5, 1], [1, 5.1, 1.0]])
    fit = fit_plane(points, np.array([1e-6, 1e-6, 1e-6, 1.0]))
    np.testing.assert_allclose(fit.residuals, [0, 0, 0, 0.1], atol=1e-9)


def test_flatness():
    points = grid(np.array([0, 1.0, 0]), 5.0)
    checkers = np.where(np.indices((8, 8)).sum(axis=0).reshape(-1) % 2, 0.002, -0.002)
    fit = fit_plane(points + checkers[:, None] * [0, 1, 0])
    assert fit.flatness_mean_m == pytest.approx(0.002, rel=0.01)
    assert fit.flatness_max_m == pytest.approx(0.002, rel=0.05)


def test_no_plane():
    line = np.linspace([1, 1, 4], [2, 3, 7], 9)
    with pytest.raises(SurveyError, match="lie on one line"):
        fit_plane(line)
    with pytest.raises(SurveyError, match="2 points for a plane"):
        fit_plane(line[:2])
    with pytest.raises(SurveyError, match="lie on one line"):
        fit_plane(np.tile([1.0, 2, 3], (5, 1)))


def test_a_plane_through_the_origin_has_no_general_form():
    with pytest.raises(SurveyError, match="through the origin"):
        Plane(np.array([0, 0, 1.0]), 0.0, np.zeros((4, 4))).general_form()


# -- patches ------------------------------------------------------------------------------

WALL = Plane(np.array([0, 1.0, 0]), -5.0, np.zeros((4, 4)))
# Six corners in X and Z, on the wall Y = 5.
CORNERS = np.array([[0, 0], [4, 0], [5, 1], [4.5, 2], [1, 2.2], [-0.5, 1]])


def distance_inside(x: float, z: float) -> float:
    """Distance to the nearest edge of CORNERS, negative outside, an edge after the other."""
    nearest = np.inf
    for (x1, z1), (x2, z2) in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True):
        area = (x2 - x1) * (z - z1) - (z2 - z1) * (x - x1)  # counter-clockwise: inside is left
        nearest = min(nearest, area / np.hypot(x2 - x1, z2 - z1))
    return nearest


@given(st.floats(-1, 6), st.floats(-3, 3), st.floats(-1, 3), st.floats(-0.2, 0.5))
@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_contains(order, x, off, z, margin):
    """Whichever way round the corners go, and however far the point is from the plane."""
    inside = distance_inside(x, z)
    assume(abs(inside - margin) > 1e-9)
    corners = np.column_stack([CORNERS[:, 0], np.full(6, 5.0), CORNERS[:, 1]])[order]
    patch = Patch("wall", WALL, corners)
    assert bool(patch.contains(np.array([[x, 5 + off, z]]), margin)[0]) == (inside > margin)


def test_contains_many_at_once():
    corners = np.column_stack([CORNERS[:, 0], np.full(6, 5.0), CORNERS[:, 1]])
    patch = Patch("wall", WALL, corners)
    points = np.array([[2, 5, 1.0], [2, 5, -0.1], [5.5, 5, 1], [4.9, 5, 1]])
    assert list(patch.contains(points)) == [True, False, False, True]
    assert list(patch.contains(points, margin_m=0.2)) == [True, False, False, False]
    assert patch.contains(np.empty((0, 3))).shape == (0,)


@given(st.integers(0, 10**6))
def test_hull_of_targets(seed):
    """The hull holds its targets, and the shrunken hull holds none of its corners."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    first = np.linalg.svd(normal[None])[2][1:]
    flat = rng.uniform(-2, 2, (12, 2))
    targets = 4 * normal + flat @ first + rng.normal(size=(12, 3)) * 1e-3
    fit = fit_plane(targets)
    patch = hull_patch("wall", fit, targets)
    assert patch.contains(targets, margin_m=-1e-9).all()
    assert not patch.contains(patch.corners, margin_m=1e-6).any()
    np.testing.assert_allclose(fit.plane.distance(patch.corners), 0, atol=1e-12)
    # A point of the plane that is a mixture of targets is inside, a far one is not.
    mixture = rng.dirichlet(np.ones(12)) @ targets
    assert patch.contains(mixture[None])[0]
    assert not patch.contains((mixture + 9 * first[0])[None])[0]


def test_targets_without_area():
    fit = fit_plane(grid(np.array([0, 1.0, 0]), 5.0))
    line = np.array([[0, 5, 0], [1, 5, 0], [2, 5, 0], [3.0, 5, 0]])
    with pytest.raises(SurveyError, match="'wall' span no area"):
        hull_patch("wall", fit, line)
