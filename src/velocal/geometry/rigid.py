"""Rigid (6-parameter congruent) transformations and their adjustment from common points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from velocal.arrays import Array
from velocal.errors import SurveyError


@dataclass(frozen=True)
class RigidTransformation:
    """``x_target = rotation @ x_source + translation``, with the covariance of its six parameters.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
        Proper rotation matrix.
    translation : ndarray, shape (3,)
        Metres, in the target frame.
    covariance : ndarray, shape (6, 6)
        Of (rotation vector in the target frame [rad], translation [m]); the rotation vector acts
        from the left: ``R_true = exp([w]x) R``.
    """

    rotation: Array
    translation: Array
    covariance: Array

    def apply(self, points: Array) -> Array:
        """Transform points from the source to the target frame.

        Parameters
        ----------
        points : ndarray, shape (..., 3)
            Metres, source frame.

        Returns
        -------
        ndarray, shape (..., 3)
            Metres, target frame.
        """
        return points @ self.rotation.T + self.translation

    def plane_matrix(self) -> Array:
        """Matrix that takes normal and offset of a plane to the target frame.

        Returns
        -------
        ndarray, shape (4, 4)
            To be multiplied by (normal, offset) of the plane in the source frame.
        """
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[3, :3] = -self.translation @ self.rotation
        return matrix

    def inverse(self) -> RigidTransformation:
        """Return the transformation from target to source, covariance propagated.

        Returns
        -------
        RigidTransformation
            ``T_source_target``.
        """
        rotation = self.rotation.T
        # exp([w]x) R inverted is R' exp(-[w]x): the rotation vector turns to -R' w; the
        # translation -R' exp(-[w]x)(t + dt) changes by -R' dt - R' [t]x w.
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = -rotation
        jacobian[3:, :3] = -rotation @ skew(self.translation)
        jacobian[3:, 3:] = -rotation
        return RigidTransformation(
            rotation, -rotation @ self.translation, jacobian @ self.covariance @ jacobian.T
        )

    def origin_std_m(self) -> Array:
        """Standard deviations of the place of the target frame's origin.

        Those of `translation` are of the origin of the source frame: they grow with the distance
        between the two, as the rotation is uncertain too.

        Returns
        -------
        ndarray, shape (3,)
            Metres, along the axes of the target frame: of the scanner, if that is the target.
        """
        # In the source frame the place is -R' t, see `inverse`; R turns it to the target's axes.
        jacobian = np.hstack([skew(self.translation), np.eye(3)])
        return np.sqrt(np.diag(jacobian @ self.covariance @ jacobian.T))


@dataclass(frozen=True)
class RigidAdjustment:
    """A transformation estimated from common points, with what tells how good it is.

    Attributes
    ----------
    transformation : RigidTransformation
        `T_target_source`; its covariance uses the a-priori standard deviations.
    residuals : ndarray, shape (n, 3)
        Target minus transformed source, metres.
    variance_factor : float
        Weighted sum of squared residuals over the redundancy (1 if the survey is as good as
        stated); NaN without redundancy.
    redundancy : int
        3 n - 6.
    iterations : int
        Gauss-Newton steps taken.
    """

    transformation: RigidTransformation
    residuals: Array
    variance_factor: float
    redundancy: int
    iterations: int


def skew(vector: Array) -> Array:
    """Cross-product matrix of a vector.

    Parameters
    ----------
    vector : ndarray, shape (3,)

    Returns
    -------
    ndarray, shape (3, 3)
        ``skew(a) @ b`` is the cross product of a and b.
    """
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_from_vector(vector: Array) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues), exact for any length.

    Parameters
    ----------
    vector : ndarray, shape (3,)
        Axis times angle, radians.

    Returns
    -------
    ndarray, shape (3, 3)
    """
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    axis = skew(vector / angle)
    return np.asarray(np.eye(3) + np.sin(angle) * axis + (1.0 - np.cos(angle)) * axis @ axis)


def closed_form(source: Array, target: Array) -> tuple[Array, Array]:
    """Rotation and translation of least squared distance for equal weights (Kabsch).

    Parameters
    ----------
    source, target : ndarray, shape (n, 3)
        The same points in both frames, metres.

    Returns
    -------
    rotation : ndarray, shape (3, 3)
    translation : ndarray, shape (3,)
        Metres, in the target frame.

    Raises
    ------
    SurveyError
        If the points are fewer than three or lie on one line.
    """
    if len(source) < 3:
        raise SurveyError(
            f"{len(source)} common points for a rigid transformation",
            allowed="3 or more, not on one line",
        )
    centre_source, centre_target = source.mean(axis=0), target.mean(axis=0)
    left, singular, right = np.linalg.svd((target - centre_target).T @ (source - centre_source))
    if singular[1] <= 1e-9 * singular[0]:
        raise SurveyError(
            "the common points lie on one line: the rotation about it is not determined",
            hint="Add a target off the line.",
        )
    sign = np.sign(np.linalg.det(left @ right))
    rotation = left @ np.diag([1.0, 1.0, sign]) @ right
    return rotation, centre_target - rotation @ centre_source


def adjust_rigid(
    source: Array,
    target: Array,
    source_covariance: Array,
    target_covariance: Array,
    *,
    max_iterations: int = 20,
) -> RigidAdjustment:
    """Adjust a rigid transformation with the covariances of both systems.

    Parameters
    ----------
    source, target : ndarray, shape (n, 3)
        The same points in both frames, metres.
    source_covariance, target_covariance : ndarray, shape (n, 3, 3) or (3n, 3n)
        Covariance of every point, or of all coordinates, square metres.
    max_iterations : int
        Largest number of Gauss-Newton steps.

    Returns
    -------
    RigidAdjustment
        Of ``T_target_source``.

    Raises
    ------
    SurveyError
        If the points do not determine the transformation.
    """
    rotation, translation = closed_form(source, target)
    n = len(source)
    of_source, of_target = _joint(source_covariance, n), _joint(target_covariance, n)
    iterations = 0
    for iterations in range(1, max_iterations + 1):  # noqa: B007 (kept for the result)
        rotated = source @ rotation.T
        misclosure = target - (rotated + translation)
        turn = np.kron(np.eye(n), rotation)
        weight = np.linalg.inv(of_target + turn @ of_source @ turn.T)
        # d(target)/d(w, t) = (-[R x]x, I): small rotation from the left.
        design = np.concatenate(
            [np.concatenate([-skew(point), np.eye(3)], axis=1) for point in rotated]
        )
        normal = design.T @ weight @ design
        step = np.linalg.solve(normal, design.T @ weight @ misclosure.ravel())
        rotation = rotation_from_vector(step[:3]) @ rotation
        translation = translation + step[3:]
        if np.max(np.abs(step)) < 1e-13:
            break
    residuals = target - (source @ rotation.T + translation)
    redundancy = 3 * n - 6
    squares = float(residuals.ravel() @ weight @ residuals.ravel())
    # Rotation about the origin of the target frame is what (w, t) means after the last step.
    return RigidAdjustment(
        transformation=RigidTransformation(rotation, translation, np.linalg.inv(normal)),
        residuals=residuals,
        variance_factor=squares / redundancy if redundancy else float("nan"),
        redundancy=redundancy,
        iterations=iterations,
    )


def _joint(covariance: Array, n: int) -> Array:
    """Expand covariances of single points to that of all coordinates; leave a full one as it is."""
    if covariance.ndim == 2:
        return covariance
    joint = np.zeros((n, 3, n, 3))
    joint[np.arange(n), :, np.arange(n)] = covariance
    return joint.reshape(3 * n, 3 * n)
