"""Functional model: the distance s along the beam to the plane, and its derivatives.

The plane is ``n . X + d = 0`` with a unit normal: a wall, a floor or a tilted plane. The paper's
form with the angle beta of its Table I, which holds for vertical planes only, is a reference in
`velocal.paper.residual_form`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array, blocks
from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import PARAMETERS, UNITS, LaserParameters

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
    s = np.empty(len(phi))
    for rows in blocks(len(phi)):
        laser, facing = laser_id[rows], normal[rows]
        direction, origin = laser_beams(phi[rows], laser, parameters)
        towards = np.einsum("ni,ni->n", direction, facing)
        length = scaled(distance_m[rows], laser, scale) + parameters.dl[laser]
        s[rows] = length + (np.einsum("ni,ni->n", origin, facing) + offset[rows]) / towards
    return s


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
    # Sines and cosines of the vertical angles are computed for each laser, not for each return.
    beams = Towards(
        np.sin(theta),
        np.cos(theta),
        normal,
        offset,
        np.cos(parameters.v)[laser_id],
        np.sin(parameters.v)[laser_id],
        parameters.voff[laser_id],
        parameters.hoff[laser_id],
    )
    length = scaled(distance_m, laser_id, scale) + parameters.dl[laser_id]
    return length - beams.to_plane, beams.derivatives(distance_m)


class Towards:
    """Beams and the planes that they hit: what `design` needs to know of them.

    Attributes
    ----------
    to_plane : ndarray, shape (n,)
        Range from the origin of each beam to its plane, metres.

    Notes
    -----
    `sine` and `cosine` are those of the rotational angle minus alpha. What belongs to the laser
    is given for each beam, or once for all beams.
    """

    def __init__(
        self,
        sine: Array,
        cosine: Array,
        normal: Array,
        offset: Array,
        cosine_v: Array | float,
        sine_v: Array | float,
        voff: Array | float,
        hoff: Array | float,
    ) -> None:
        self._cosine_v, self._sine_v, self._hoff = cosine_v, sine_v, hoff
        n_x, n_y, self._n_z = normal.T
        self._along = n_x * sine + n_y * cosine  # n.e
        self._across = n_y * sine - n_x * cosine  # n.q
        self._inverse = 1.0 / (cosine_v * self._along + sine_v * self._n_z)  # 1 / G
        # The same as in `misclosure`; n.o is formed from products that the derivatives need too.
        self.to_plane = -(hoff * self._across + voff * self._n_z + offset) * self._inverse

    def derivatives(self, distance_m: Array) -> Array:
        """Derivatives of the misclosure, shape (n, 6); see `design`."""
        # u_phi is -q cos v: the derivative of the direction by the rotational angle.
        matrix = np.empty((len(ADJUSTABLE), len(distance_m)))
        matrix[0] = 1.0
        by_phi = self.to_plane * self._across * self._cosine_v - self._hoff * self._along
        np.multiply(by_phi, self._inverse, out=matrix[1])
        by_v = self._cosine_v * self._n_z - self._sine_v * self._along
        matrix[2] = self.to_plane * by_v * self._inverse
        np.multiply(self._n_z, self._inverse, out=matrix[3])
        np.multiply(self._across, self._inverse, out=matrix[4])
        matrix[5] = distance_m
        return matrix.T
