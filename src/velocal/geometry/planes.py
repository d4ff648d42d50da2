"""Planes in Hesse normal form, their adjustment from points, and bounded patches of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.errors import SurveyError


@dataclass(frozen=True)
class Plane:
    """``normal . X + offset = 0`` with a unit normal.

    Attributes
    ----------
    normal : ndarray, shape (3,)
        Unit normal.
    offset : float
        Metres; minus the distance of the plane from the origin along the normal.
    covariance : ndarray, shape (4, 4)
        Of (normal, offset); singular, as the normal has unit length.
    """

    normal: Array
    offset: float
    covariance: Array

    def distance(self, points: Array) -> Array:
        """Signed orthogonal distance of points from the plane; the paper's D, equation (4).

        Parameters
        ----------
        points : ndarray, shape (..., 3)
            Metres, in the frame of the plane.

        Returns
        -------
        ndarray, shape (...)
            Metres; positive on the side to which the normal points.
        """
        return points @ self.normal + self.offset

    def general_form(self) -> Array:
        """Coefficients (a, b, c) of the paper's aX + bY + cZ + 1 = 0, for reports only.

        Returns
        -------
        ndarray, shape (3,)
            a, b and c, per metre.

        Raises
        ------
        SurveyError
            If the plane passes through the origin, where the form does not exist.
        """
        if abs(self.offset) < 1e-9:
            raise SurveyError("a plane through the origin has no form aX + bY + cZ + 1 = 0")
        return self.normal / self.offset


@dataclass(frozen=True)
class PlaneFit:
    """A plane estimated from points.

    Attributes
    ----------
    plane : Plane
        The plane; its normal points away from the origin.
    residuals : ndarray, shape (n,)
        Orthogonal distances of the points, metres.
    variance_factor : float
        Weighted sum of squared residuals over n - 3.
    """

    plane: Plane
    residuals: Array
    variance_factor: float

    @property
    def flatness_mean_m(self) -> float:
        """Mean absolute deviation of the points from the plane, metres."""
        return float(np.mean(np.abs(self.residuals)))

    @property
    def flatness_max_m(self) -> float:
        """Largest absolute deviation of the points from the plane, metres."""
        return float(np.max(np.abs(self.residuals)))


def fit_plane(points: Array, std: Array | None = None, covariance: Array | None = None) -> PlaneFit:
    """Adjust a plane by weighted orthogonal (total) least squares.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres.
    std : ndarray, shape (n,), optional
        Isotropic standard deviation of every point, metres; equal and estimated from the
        residuals if omitted.
    covariance : ndarray, shape (3 n, 3 n), optional
        Of the coordinates of all points, from which that of the plane follows; the weights
        are those of `std`, without the correlations between points.

    Returns
    -------
    PlaneFit
        Its covariance follows from `covariance`, from `std`, or else from the residuals.

    Raises
    ------
    SurveyError
        If there are fewer than three points or they lie on one line.
    """
    if len(points) < 3:
        raise SurveyError(f"{len(points)} points for a plane", allowed="3 or more, not on a line")
    weight = np.ones(len(points)) if std is None else 1.0 / np.square(std)
    centre = np.average(points, axis=0, weights=weight)
    centred = points - centre
    moments = (centred * weight[:, None]).T @ centred
    values, vectors = np.linalg.eigh(moments)
    if values[1] <= 1e-12 * values[2]:
        raise SurveyError("the points of a plane lie on one line", hint="Add a point off the line.")
    normal = vectors[:, 0]
    offset = -float(normal @ centre)
    if offset > 0 or (offset == 0 and normal[2] < 0):
        normal, offset = -normal, -offset
    residuals = points @ normal + offset
    redundancy = len(points) - 3
    factor = float(weight @ residuals**2) / redundancy if redundancy else float("nan")
    scale = 1.0 if std is not None else (factor if redundancy else 0.0)
    # Small turns of the normal about the two axes in the plane, and the shift along it.
    tangent = vectors[:, 1:]
    design = np.column_stack([centred @ tangent, np.ones(len(points))])
    cofactor = np.linalg.inv((design * weight[:, None]).T @ design)
    if covariance is not None:
        influence = cofactor @ (design * weight[:, None]).T
        blocks = covariance.reshape(len(points), 3, len(points), 3)
        across = np.einsum("i,aibj,j->ab", normal, blocks, normal, optimize=True)
        cofactor, scale = influence @ across @ influence.T, 1.0
    spread = np.zeros((4, 3))
    spread[:3, :2] = tangent
    spread[3, :2] = -centre @ tangent
    spread[3, 2] = 1.0
    return PlaneFit(Plane(normal, offset, scale * spread @ cofactor @ spread.T), residuals, factor)


@dataclass(frozen=True)
class Patch:
    """The part of a plane that was surveyed: the convex hull of its targets.

    Attributes
    ----------
    name : str
        Name of the wall or floor.
    plane : Plane
        In the frame of the patch.
    corners : ndarray, shape (m, 3)
        Corners of the hull, in order, on the plane.
    """

    name: str
    plane: Plane
    corners: Array

    def contains(self, points: Array, margin_m: float = 0.0) -> NDArray[np.bool_]:
        """Tell which points lie above or below the hull, seen along the normal.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Metres, in the frame of the patch.
        margin_m : float
            Points must lie this far inside the edge of the hull.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        along = np.roll(self.corners, -1, axis=0) - self.corners
        inward = np.cross(self.plane.normal, along)
        inward /= np.linalg.norm(inward, axis=1)[:, None]
        edge = (inward * self.corners).sum(axis=1)
        turned = inward @ self.corners.mean(axis=0) < edge
        inward[turned], edge[turned] = -inward[turned], -edge[turned]
        return np.asarray((inward @ points.T >= edge[:, None] + margin_m).all(axis=0))


def hull_patch(name: str, fit: PlaneFit, points: Array) -> Patch:
    """Bound a fitted plane by the convex hull of points.

    Parameters
    ----------
    name : str
        Name of the wall or floor.
    fit : PlaneFit
    points : ndarray, shape (n, 3)
        Metres; they are projected onto the plane.

    Returns
    -------
    Patch

    Raises
    ------
    SurveyError
        If the points span no area.
    """
    from scipy.spatial import ConvexHull, QhullError

    plane = fit.plane
    on_plane = points - np.outer(plane.distance(points), plane.normal)
    basis = np.linalg.svd(np.eye(3) - np.outer(plane.normal, plane.normal))[0][:, :2]
    try:
        order = ConvexHull((on_plane - on_plane[0]) @ basis).vertices
    except QhullError:
        raise SurveyError(
            f"the targets of {name!r} span no area", hint="Spread the targets over the plane."
        ) from None
    return Patch(name, plane, on_plane[order])
