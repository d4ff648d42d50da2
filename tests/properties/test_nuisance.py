"""Derivatives by pose and planes, and the effect of their errors on the parameters of a laser."""

import numpy as np
import pytest

from velocal.adjustment.functional import misclosure
from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.nuisance import by_plane, by_pose
from velocal.adjustment.observations import Observations
from velocal.adjustment.solvers import GaussHelmert
from velocal.adjustment.stochastic import Stochastic, SurveyUncertainty
from velocal.geometry.rigid import rotation_from_vector
from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import LaserParameters

NAMES = ("dl", "alpha", "v")
PRIOR = {"dl": 0.02, "alpha": 0.0035, "v": 0.0035}
LASER = (0.05, 0.02, -0.2, 0.2, 0.026)
#: ``T_scanner_site``, far from the identity.
ROTATION = rotation_from_vector(np.array([0.05, -0.04, 2.1]))
TRANSLATION = np.array([1.5, -2.5, 0.7])


def in_scanner(normal, offset, rotation, translation):
    """Planes of the site frame, shape (n, 3) and (n,), in the scanner frame."""
    turned = normal @ rotation.T
    return turned, offset - turned @ translation


def moved(error):
    """Rotation and translation of the pose after an error of shape (6,)."""
    return rotation_from_vector(error[:3]) @ ROTATION, TRANSLATION + error[3:]


# -- derivatives --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def beams():
    """Beams of a laser in all directions, each with a plane of its own in the site frame."""
    rng = np.random.default_rng(11)
    n = 500
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    phi, offset = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(-20.0, 20.0, n)
    parameters = LaserParameters(*(np.array([x]) for x in LASER))
    direction, _ = laser_beams(phi, np.zeros(n, dtype=int), parameters)
    seen = np.abs(np.sum(direction * (normal @ ROTATION.T), axis=1)) > 0.2
    return phi[seen], normal[seen], offset[seen], parameters


def s_of(beams, normal, offset):
    phi, _, _, parameters = beams
    laser = np.zeros(len(phi), dtype=int)
    return misclosure(np.full(len(phi), 5.0), phi, laser, parameters, normal, offset)


def where_they_meet(beams, normal, offset):
    """Point of every beam on its plane, and the cosine of the angle with the normal."""
    phi, _, _, parameters = beams
    direction, origin = laser_beams(phi, np.zeros(len(phi), dtype=int), parameters)
    towards = np.sum(direction * normal, axis=1)
    length = -(np.sum(origin * normal, axis=1) + offset) / towards
    return origin + length[:, None] * direction, towards


def central(function, n, step=1e-5):
    """Central differences by `n` numbers at zero, shape (rows, n)."""
    return np.column_stack([(function(e) - function(-e)) / (2.0 * step) for e in step * np.eye(n)])


def test_derivatives_by_the_pose_are_central_differences(beams):
    field = beams[1:3]
    plane = in_scanner(*field, ROTATION, TRANSLATION)
    point, towards = where_they_meet(beams, *plane)
    expected = central(lambda e: s_of(beams, *in_scanner(*field, *moved(e))), 6)
    found = by_pose(point, plane[0], towards, TRANSLATION)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_derivatives_by_the_plane_are_central_differences(beams):
    """The normal and the offset are four free numbers: the normal may change its length."""
    normal, offset = in_scanner(*beams[1:3], ROTATION, TRANSLATION)
    expected = central(lambda e: s_of(beams, normal + e[:3], offset + e[3]), 4)
    point, towards = where_they_meet(beams, normal, offset)
    np.testing.assert_allclose(by_plane(point, towards), expected, rtol=1e-6, atol=1e-6)


# -- covariance by source -----------------------------------------------------------------

#: Floor and two walls in the scanner frame, and rotational angles at which the laser meets them.
NORMAL = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [0.8, 0.6, 0.0]])
OFFSET = np.array([-0.8, -5.0, -4.0])
ANGLES = [np.linspace(0.0, 6.2, 40), np.linspace(-0.5, 0.3, 40), np.linspace(0.6, 1.4, 40)]
#: The same planes in the site frame.
FIELD = NORMAL @ ROTATION, OFFSET + NORMAL @ TRANSLATION
DRAWS = 1000


def drawn(source):
    """Errors of one source and their stated covariance, with the planes that they lead to.

    Returns
    -------
    survey : SurveyUncertainty
        With the covariance of that source alone.
    planes : list of (ndarray, ndarray)
        Normals and offsets in the scanner frame of every draw.
    """
    rng = np.random.default_rng(17)
    pose, of_planes = np.zeros((6, 6)), np.zeros((3, 4, 4))
    if source == "pose":
        # Rotations (rad) have smaller errors than translations (m); all six are correlated.
        root = rng.normal(size=(6, 6)) * np.repeat([2e-4, 1e-3], 3)[:, None]
        pose = root @ root.T
        errors = rng.normal(size=(DRAWS, 6)) @ root.T
        planes = [in_scanner(*FIELD, *moved(error)) for error in errors]
    else:
        # A unit normal changes only at right angles to itself.
        turn = np.linalg.svd(NORMAL[:, None])[2][:, 1:]
        root = np.zeros((3, 4, 3))
        root[:, :3, :2] = 2e-4 * turn.swapaxes(1, 2)
        root[:, 3] = [3e-4, -2e-4, 1e-3]
        of_planes = root @ root.swapaxes(1, 2)
        errors = np.einsum("pij,dpj->dpi", root, rng.normal(size=(DRAWS, 3, 3)))
        planes = [(NORMAL + error[:, :3], OFFSET + error[:, 3]) for error in errors]
    survey = SurveyUncertainty(
        translation=TRANSLATION, pose=pose, planes=of_planes, flatness_m=np.zeros(3)
    )
    return survey, planes


@pytest.mark.parametrize("source", ["pose", "planes"])
def test_errors_of_the_survey_spread_a_laser_as_its_part_says(source):
    """Lasers with the same parameters are adjusted with wrong planes, each with its own draw.

    Their distances are measured to the true planes without noise. So the spread of their
    corrections is the covariance that `Adjustment.parts` must state for that source.
    """
    survey, planes = drawn(source)
    parameters = LaserParameters(*(np.full(DRAWS, x) for x in LASER))
    plane = np.repeat([0, 1, 2], [len(angles) for angles in ANGLES])
    phi = np.tile(np.concatenate(ANGLES), DRAWS)
    laser = np.repeat(np.arange(DRAWS), len(plane))
    normal = np.concatenate([normal[plane] for normal, _ in planes])
    offset = np.concatenate([offset[plane] for _, offset in planes])
    true = Observations(np.zeros(len(phi)), phi, laser, normal, offset)
    distance = -true.misclosure(parameters)
    assert (distance > 0.5).all()

    plane = np.tile(plane, DRAWS)
    data = Observations(distance, phi, laser, NORMAL[plane], OFFSET[plane], plane)
    model = Stochastic(noise_std_m=0.01, prior_std=PRIOR, survey=(survey,))
    found = adjust_all(data, parameters, NAMES, GaussHelmert(), model)
    errors = np.array([result.corrections for result in found])
    stated = found[0].parts[source]

    # If the stated covariance is right, whitened errors are independent and have unit variance.
    # Standard deviations of N draws: mean and covariance 1 / sqrt(N), variance sqrt(2 / N).
    white = np.linalg.solve(np.linalg.cholesky(stated), errors.T)
    sampling = np.sqrt((1.0 + np.eye(3)) / DRAWS)
    assert (np.abs(white.mean(axis=1)) < 4.0 / np.sqrt(DRAWS)).all()
    assert (np.abs(white @ white.T / DRAWS - np.eye(3)) < 4.0 * sampling).all()
    others = {"pose", "planes"} - {source}
    assert not any(found[0].parts[other].any() for other in others)
