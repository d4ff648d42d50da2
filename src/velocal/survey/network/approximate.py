"""Approximate values for the adjustment of a network: instruments, cameras and points."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.geometry.rigid import closed_form, rotation_from_vector
from velocal.survey.network.model import Unknowns
from velocal.survey.network.structure import Structure


def approximate_unknowns(network: Structure) -> Unknowns:
    """Place set-ups by the control points that they observe, then the other points by the set-ups.

    Raises
    ------
    SurveyError
        If a set-up observes too few control points, or the rays to a point are parallel.
    """
    n, polar, images = len(network.control.name), network.polar, network.images
    points = np.full((len(network.points), 3), np.nan)
    points[:n] = network.control.xyz
    complete = np.isfinite(polar.value).all(axis=1)
    instruments, cameras, rotations = [], [], []
    for number, name in enumerate(network.instruments):
        own = complete & (network.polar_setup == number) & (network.polar_point < n)
        place, zero = resected_instrument(
            polar.value[own], points[network.polar_point[own]],
            where=f"{network.where}, set-up {name!r}",
        )  # fmt: skip
        instruments.append([*place, zero])
    for number, name in enumerate(network.cameras):
        own = (network.image_setup == number) & (network.image_point < n)
        place, rotation = resected_camera(
            images.value[own], points[network.image_point[own]],
            where=f"{network.where}, image {name!r}",
        )  # fmt: skip
        cameras.append(place)
        rotations.append(rotation)
    found = Unknowns(
        points,
        np.array(instruments).reshape(-1, 4),
        np.array(cameras).reshape(-1, 3),
        np.array(rotations).reshape(-1, 3, 3),
    )
    angles = np.isfinite(polar.value[:, :2]).all(axis=1)
    instrument = found.instruments[network.polar_setup[angles]]
    direction, zenith = polar.value[angles, 0], polar.value[angles, 1]
    towards = np.column_stack([images.value, np.ones(len(images.value))])
    towards = np.einsum("nji,nj->ni", found.rotations[network.image_setup], towards)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    point = np.concatenate([network.polar_point[angles], network.image_point])
    origin = np.concatenate([instrument[:, :3], found.cameras[network.image_setup]])
    ray = np.concatenate([unit_vectors(direction + instrument[:, 3], zenith), towards])
    for number in range(n, len(points)):
        own = point == number
        try:
            points[number] = intersection(origin[own], ray[own])
        except SurveyError as error:
            raise SurveyError(
                f"point {network.points[number]!r}: {error.what}",
                where=network.where,
                hint=error.hint,
            ) from None
    return found


def unit_vectors(direction: Array, zenith: Array) -> Array:
    """Unit vectors of directions (clockwise from Y) and zenith angles, radians, shape (n, 3)."""
    flat = np.sin(zenith)
    return np.column_stack([flat * np.sin(direction), flat * np.cos(direction), np.cos(zenith)])


def resected_instrument(polar: Array, known: Array, *, where: str) -> tuple[Array, float]:
    """Place of a levelled total station, and the azimuth of its direction zero.

    Parameters
    ----------
    polar : ndarray, shape (n, 3)
        Direction, zenith angle (radians) and slope distance (metres) to known points.
    known : ndarray, shape (n, 3)
        Their approximate coordinates, metres.
    where : str
        Name of the set-up, for errors.

    Returns
    -------
    place : ndarray, shape (3,)
        Metres.
    zero : float
        Azimuth of direction zero, radians.

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
            hint="Observe three or more control points with their distances.",
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
        From the site frame into the camera frame, whose third axis looks forward.

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
    # With points near one plane the linear solution can be wrong by any amount. Therefore cameras
    # are tried that look in all directions, held upright, upside down or on their sides.
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
#: Largest root mean square residual, as an angle, of an accepted camera: approximate coordinates of
#: control points may be wrong by some centimetres.
_ACCEPTED = 0.02


def _refined(rotation: Array, tangents: Array, known: Array) -> tuple[Array, Array, float]:
    """Place and rotation by least squares, and the root mean square of the residual angles."""
    rays = np.column_stack([tangents, np.ones(len(tangents))])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)

    def residuals(unknowns: Array) -> Array:
        # Unit vectors, not tangents: a point behind the camera has a large residual.
        seen = (known - unknowns[:3]) @ (rotation_from_vector(unknowns[3:]) @ rotation).T
        return np.asarray(rays - seen / np.linalg.norm(seen, axis=1, keepdims=True)).ravel()

    start = np.concatenate([_placed(rotation, tangents, known), np.zeros(3)])
    best = least_squares(residuals, start, method="lm")
    residual = float(np.sqrt(2.0 * best.cost / len(known)))
    return best.x[:3], rotation_from_vector(best.x[3:]) @ rotation, residual


def _placed(rotation: Array, tangents: Array, known: Array) -> Array:
    """Place of a camera of known rotation: the point nearest to the rays of the points."""
    rays = np.column_stack([tangents, np.ones(len(tangents))]) @ rotation
    return intersection(known, rays / np.linalg.norm(rays, axis=1, keepdims=True))


def intersection(origins: Array, directions: Array) -> Array:
    """Point nearest to rays.

    Parameters
    ----------
    origins : ndarray, shape (n, 3)
        A point on every ray, metres.
    directions : ndarray, shape (n, 3)
        Unit vectors.

    Returns
    -------
    ndarray, shape (3,)

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
