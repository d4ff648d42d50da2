"""Functional model: the distance s along the beam to the plane, and its derivatives.

The plane is ``n . X + d = 0`` with a unit normal, so that any plane is served: walls, floor,
tilted ones. The paper's form with the angle beta of its Table I, which holds for vertical
planes only, stands beside it in `paper_form`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from velocal.beam_model import laser_beams
from velocal.parameters import PARAMETERS, ParameterSet

Array = NDArray[np.float64]


def misclosure(
    distance_m: Array,
    phi: Array,
    laser_id: NDArray[np.integer],
    parameters: ParameterSet,
    normal: Array,
    offset: Array,
) -> Array:
    """Distance s along the beam from plane to point; equation (5) for any plane.

    Parameters
    ----------
    distance_m, phi, laser_id : ndarray, shape (n,)
        Raw distance (metres), rotational angle (radians), laser of every return.
    parameters : ParameterSet
        Of all lasers.
    normal : ndarray, shape (n, 3)
        Unit normal of the plane that each return hit, scanner frame.
    offset : ndarray, shape (n,)
        Its offset, metres.

    Returns
    -------
    ndarray, shape (n,)
        Metres; positive where the point lies behind the plane (measured too long).
    """
    direction, origin = laser_beams(phi, laser_id, parameters)
    towards = np.einsum("ni,ni->n", direction, normal)
    length = distance_m + parameters.dl[laser_id]
    return np.asarray(length + (np.einsum("ni,ni->n", origin, normal) + offset) / towards)


def design(
    distance_m: Array,
    phi: Array,
    laser_id: NDArray[np.integer],
    parameters: ParameterSet,
    normal: Array,
    offset: Array,
) -> tuple[Array, Array]:
    """Misclosure s and its derivatives by the five parameters.

    Parameters are those of `misclosure`.

    Returns
    -------
    s : ndarray, shape (n,)
        Metres.
    matrix : ndarray, shape (n, 5)
        ds by dl, alpha, v, voff, hoff, in the order of `parameters.PARAMETERS`.

    Notes
    -----
    With G = n.u, e and q the horizontal unit vectors along and across the beam, and L - s the
    range to the plane::

        ds/d(dl) = 1                      ds/d(alpha) = -((L - s) n.u_phi + hoff n.e) / G
        ds/dv = (L - s) n.u_v / G         ds/d(voff) = n_z / G      ds/d(hoff) = n.q / G
    """
    theta = phi - parameters.alpha[laser_id]
    v, hoff = parameters.v[laser_id], parameters.hoff[laser_id]
    sine, cosine = np.sin(theta), np.cos(theta)
    along = normal[:, 0] * sine + normal[:, 1] * cosine  # n.e
    across = -normal[:, 0] * cosine + normal[:, 1] * sine  # n.q
    sine_v, cosine_v = np.sin(v), np.cos(v)
    g = cosine_v * along + sine_v * normal[:, 2]
    # u_phi is -q cos v: the derivative of the direction by the rotational angle.
    s = misclosure(distance_m, phi, laser_id, parameters, normal, offset)
    to_plane = distance_m + parameters.dl[laser_id] - s
    matrix = np.empty((len(phi), len(PARAMETERS)))
    matrix[:, 0] = 1.0
    matrix[:, 1] = -(to_plane * -across * cosine_v + hoff * along) / g
    matrix[:, 2] = to_plane * (-sine_v * along + cosine_v * normal[:, 2]) / g
    matrix[:, 3] = normal[:, 2] / g
    matrix[:, 4] = across / g
    return s, matrix


def beta(phi: Array, alpha: Array, omega: Array) -> Array:
    """Angle between beam and wall trace after the paper's Table I, radians.

    The printed table uses phi; phi - alpha is meant (see the errata). `omega` is the angle of the
    wall's trace with the Y axis, in [0, pi).
    """
    theta = np.mod(phi - alpha, 2.0 * np.pi)
    quarter = np.floor(theta / (0.5 * np.pi)).astype(int)
    flat = omega < 0.5 * np.pi
    difference = theta - omega
    first = np.select(
        [quarter == 0, quarter == 1, quarter == 2],
        [difference, difference, difference - np.pi],
        2.0 * np.pi - difference,
    )
    second = np.select(
        [quarter == 0, quarter == 1, quarter == 2],
        [np.pi + difference, difference, difference],
        np.pi - difference,
    )
    return np.where(flat, first, second)


def paper_form(points: Array, abc: Array, v: Array, beta_rad: Array) -> Array:
    """The paper's s for vertical planes: equations (4) and (5), D / (cos v |sin beta|).

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres, scanner frame.
    abc : ndarray, shape (3,)
        Coefficients of aX + bY + cZ + 1 = 0.
    v, beta_rad : ndarray, shape (n,)
        Vertical angle of the laser; angle between beam and wall.

    Returns
    -------
    ndarray, shape (n,)
        Metres; the sign is that of D.
    """
    distance = (points @ abc + 1.0) / np.linalg.norm(abc)
    return np.asarray(distance / (np.cos(v) * np.abs(np.sin(beta_rad))))
