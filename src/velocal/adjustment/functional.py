"""Functional model: the distance s along the beam to the plane, and its derivatives.

The plane is ``n . X + d = 0`` with a unit normal: a wall, a floor or a tilted plane. The paper's
form with the angle beta of its Table I, which holds for vertical planes only, is a reference in
`velocal.paper.residual_form`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import PARAMETERS, UNITS, LaserParameters

Array = NDArray[np.float64]

#: Laser of every row, or the one of all rows.
Lasers = NDArray[np.integer] | int
#: What can be adjusted: the scanner's parameters, and a range scale per laser, which multiplies
#: the raw distance and which no driver's file can hold.
ADJUSTABLE = (*PARAMETERS, "scale")
#: Unit of each.
ADJUSTABLE_UNITS = {**UNITS, "scale": "1"}


def split(
    x: Array, names: Sequence[str], initial: LaserParameters
) -> tuple[LaserParameters, Array | None]:
    """Parameters that corrections lead to, and the range scale, which drivers do not know.

    Parameters
    ----------
    x : ndarray, shape (lasers, u)
        Corrections.
    names : sequence of str
        What they correct, out of `ADJUSTABLE`.
    initial : LaserParameters
        What they are added to.

    Returns
    -------
    parameters : LaserParameters
    scale : ndarray, shape (lasers,), or None
        None where no range scale is among the names.
    """
    change = dict(zip(names, x.T, strict=True))
    scale = change.pop("scale", None)
    return initial.corrected(change), scale


def scaled(distance_m: Array, laser_id: Lasers, scale: Array | None) -> Array:
    """Raw distances with the range scale of their laser, metres, shape (n,)."""
    return distance_m if scale is None else distance_m * (1 + scale[laser_id])


def misclosure(
    distance_m: Array,
    phi: Array,
    laser_id: NDArray[np.integer],
    parameters: LaserParameters,
    normal: Array,
    offset: Array,
    scale: Array | None = None,
) -> Array:
    """Distance s along the beam from plane to point; equation (5) for any plane.

    Parameters
    ----------
    distance_m, phi, laser_id : ndarray, shape (n,)
        Raw distance (metres), rotational angle (radians), laser of every return.
    parameters : LaserParameters
        Of all lasers.
    normal : ndarray, shape (n, 3)
        Unit normal of the plane that each return hit, scanner frame.
    offset : ndarray, shape (n,)
        Its offset, metres.
    scale : ndarray, shape (lasers,), optional
        Range scale of every laser; none if omitted.

    Returns
    -------
    ndarray, shape (n,)
        Metres; positive where the point lies behind the plane (measured too long).
    """
    direction, origin = laser_beams(phi, laser_id, parameters)
    towards = np.einsum("ni,ni->n", direction, normal)
    length = scaled(distance_m, laser_id, scale) + parameters.dl[laser_id]
    return np.asarray(length + (np.einsum("ni,ni->n", origin, normal) + offset) / towards)


def design(
    distance_m: Array,
    phi: Array,
    laser_id: Lasers,
    parameters: LaserParameters,
    normal: Array,
    offset: Array,
    scale: Array | None = None,
) -> tuple[Array, Array]:
    """Misclosure s and its derivatives by the five parameters and the range scale.

    Parameters
    ----------
    distance_m, phi : ndarray, shape (n,)
        Raw distance (metres) and rotational angle (radians) of every return.
    laser_id : ndarray of int, shape (n,), or int
        Laser of every return, or the one of all of them, which takes less time.
    parameters, normal, offset, scale
        As for `misclosure`.

    Returns
    -------
    s : ndarray, shape (n,)
        Metres.
    matrix : ndarray, shape (n, 6)
        ds by dl, alpha, v, voff, hoff and range scale, in the order of `ADJUSTABLE`; the
        derivative by the rotational angle phi is minus that by alpha, that by the raw distance 1.

    Notes
    -----
    With G = n.u, e and q the horizontal unit vectors along and across the beam, and L - s the
    range to the plane::

        ds/d(dl) = 1                      ds/d(alpha) = -((L - s) n.u_phi + hoff n.e) / G
        ds/dv = (L - s) n.u_v / G         ds/d(voff) = n_z / G      ds/d(hoff) = n.q / G
        ds/d(scale) = l
    """
    theta = phi - parameters.alpha[laser_id]
    # Sines and cosines of the few lasers first, then one for every return.
    hoff = parameters.hoff[laser_id]
    sine_v, cosine_v = np.sin(parameters.v)[laser_id], np.cos(parameters.v)[laser_id]
    sine, cosine = np.sin(theta), np.cos(theta)
    n_x, n_y, n_z = normal.T
    along = n_x * sine + n_y * cosine  # n.e
    across = n_y * sine - n_x * cosine  # n.q
    inverse = 1.0 / (cosine_v * along + sine_v * n_z)  # 1 / G
    # The same as in `misclosure`; n.o is formed from products that the derivatives need too.
    to_plane = -(hoff * across + parameters.voff[laser_id] * n_z + offset) * inverse
    s = scaled(distance_m, laser_id, scale) + parameters.dl[laser_id] - to_plane
    # u_phi is -q cos v: the derivative of the direction by the rotational angle.
    matrix = np.empty((len(ADJUSTABLE), len(phi)))
    matrix[0] = 1.0
    matrix[1] = (to_plane * across * cosine_v - hoff * along) * inverse
    matrix[2] = to_plane * (cosine_v * n_z - sine_v * along) * inverse
    matrix[3] = n_z * inverse
    matrix[4] = across * inverse
    matrix[5] = distance_m
    return s, matrix.T
