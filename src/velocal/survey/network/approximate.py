"""Approximate values for the adjustment of a network: set-ups, cameras and points."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from velocal.errors import SurveyError
from velocal.geometry.rigid import closed_form, rotation_from_vector

Array = NDArray[np.float64]


def unit_vectors(direction: Array, zenith: Array) -> Array:
    """Unit vectors of directions (clockwise from Y) and zenith angles, radians, shape (n, 3)."""
    flat = np.sin(zenith)
    return np.column_stack([flat * np.sin(direction), flat * np.cos(direction), np.cos(zenith)])


def resected_setup(polar: Array, known: Array, *, where: str) -> tuple[Array, float]:
    """Place of a levelled total station, and the azimuth of its direction zero.

    Parameters
    ----------
    polar : ndarray, shape (n, 3)
        Direction, zenith angle (radians) and slope distance (metres) to known points.
    known : ndarray, shape (n, 3)
        Their approximate coordinates, metres.
    where : str
        Name of the set-up, for errors.

    Raises
    ------
    SurveyError
        If there are fewer than three points or they lie on one line.
    """
    local = polar[:, 2:] * unit_vectors(polar[:, 0], polar[:, 1])
    try:
        rotation, place = closed_form(local, known)
    except SurveyError as error:
        raise SurveyError(
            f"cannot be placed: {error.what}",
            where=where,
            hint="Sight three or more control points with their distances.",
        ) from None
    return place, float(np.arctan2(rotation[0, 1], rotation[1, 1]))


def resected_camera(tangents: Array, known: Array, *, where: str) -> tuple[Array, Array]:
    """Place and rotation of a camera: direct linear transformation, then least squares.

    Parameters
    ----------
    tangents : ndarray, shape (n, 2)
        Image coordinates over the principal distance.
    known : ndarray, shape (n, 3)
        Coordinates of the points, metres.
    where : str
        Name of the image, for errors.

    Returns
    -------
    place : ndarray, shape (3,)
    rotation : ndarray, shape (3, 3)
        From the field into the camera, whose third axis looks forward.

    Raises
    ------
    SurveyError
        If there are fewer than six points, or all of them lie in one plane.
    """
    n = len(known)
    centre = known.mean(axis=0) if n else np.zeros(3)
    spread = float(np.sqrt(np.mean((known - centre) ** 2))) if n else 1.0
    scaled = (known - centre) / (spread or 1.0)
    if n < 6 or np.linalg.svd(scaled, compute_uv=False)[2] < 1e-3 * np.sqrt(n):
        raise SurveyError(
            f"cannot be placed by {n} control points",
            where=where,
            allowed="6 or more, not in one plane",
            hint="Show more control points in the image.",
        )
    homogeneous = np.column_stack([scaled, np.ones(n)])
    zero = np.zeros_like(homogeneous)
    system = np.concatenate(
        [
            np.column_stack([homogeneous, zero, -tangents[:, :1] * homogeneous]),
            np.column_stack([zero, homogeneous, -tangents[:, 1:] * homogeneous]),
        ]
    )
    projection = np.linalg.svd(system)[2][-1].reshape(3, 4)
    if np.mean(homogeneous @ projection[2]) < 0.0:  # points lie before the camera
        projection = -projection
    left, _, right = np.linalg.svd(projection[:, :3])
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    # With points near one plane the linear solution can be anything: then cameras are tried that
    # look about, held upright, on the head or on their sides.
    looks = Rotation.from_euler("yxz", list(product(*_LOOKS)), degrees=True).as_matrix() @ _LEVEL
    for trial in (rotation, *looks):
        place, found, residual = _refined(trial, tangents, scaled)
        if residual < _ACCEPTED:
            return centre + spread * place, found
    raise SurveyError(
        "cannot be placed: its control points do not fit",
        where=where,
        hint="Look for exchanged point names, and whether y runs downwards.",
    )


#: Headings, tilts and rolls of the trials, degrees, and a level camera that looks along Y.
_LOOKS = (range(0, 360, 45), (0, 40, -40), (0, 90, 180, 270))
_LEVEL = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
#: Root mean square residual, as an angle, of a camera that is in its place: control points may be
#: wrong by some centimetres.
_ACCEPTED = 0.02


def _refined(rotation: Array, tangents: Array, known: Array) -> tuple[Array, Array, float]:
    """Place and rotation by least squares, and the root mean square of the angles left."""
    rays = np.column_stack([tangents, np.ones(len(tangents))])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)

    def residuals(unknowns: Array) -> Array:
        # Unit vectors, not tangents: a point behind the camera is far off, not hidden.
        seen = (known - unknowns[:3]) @ (rotation_from_vector(unknowns[3:]) @ rotation).T
        return np.asarray(rays - seen / np.linalg.norm(seen, axis=1, keepdims=True)).ravel()

    start = np.concatenate([_placed(rotation, tangents, known), np.zeros(3)])
    best = least_squares(residuals, start, method="lm")
    residual = float(np.sqrt(2.0 * best.cost / len(known)))
    return best.x[:3], rotation_from_vector(best.x[3:]) @ rotation, residual


def _placed(rotation: Array, tangents: Array, known: Array) -> Array:
    """Place of a camera of known rotation: where the rays of the points meet best."""
    rays = np.column_stack([tangents, np.ones(len(tangents))]) @ rotation
    return intersection(known, rays / np.linalg.norm(rays, axis=1, keepdims=True))


def intersection(origins: Array, directions: Array) -> Array:
    """Point nearest to rays, shape (n, 3) each; the directions are unit vectors.

    Raises
    ------
    SurveyError
        If the rays are parallel.
    """
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    normal = across.sum(axis=0)
    if np.linalg.eigvalsh(normal)[0] < 1e-9:
        raise SurveyError("its rays are parallel", hint="Add a ray from another side.")
    return np.linalg.solve(normal, np.einsum("nij,nj->i", across, origins))
