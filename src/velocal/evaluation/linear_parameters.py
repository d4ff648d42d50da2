"""The linear model of a laser: six parameters in which every point is linear.

With the raw distance r and the rotational angle phi, a point of a laser is

    x = P sin phi + Q cos phi,    y = P cos phi - Q sin phi,    z = R
    P = a r + e,                  Q = b r + f,                  R = c r + g

which are equations (2) and (3) of the paper written in other parameters: (a, b, c) is the direction
of the beam times the range scale, and (e, f, g) holds dl and both offsets. The distance of a point
from a plane is then linear in the parameters, and one system of equations gives them without a
start and without iteration. After Chen and Chien (2012).
"""

from __future__ import annotations

import numpy as np

from velocal.adjustment.observations import Observations
from velocal.adjustment.stochastic import Stochastic
from velocal.arrays import Array
from velocal.scanner.parameters import LaserParameters

#: What the six parameters are converted to, in the order of the columns of the corrections.
NAMES = ("dl", "alpha", "v", "voff", "hoff", "scale")


def from_beam(parameters: LaserParameters, scale: Array | None = None) -> Array:
    """Linear parameters of the lasers, shape (lasers, 6): a, b, c (1), e, f, g (m).

    Parameters
    ----------
    parameters : LaserParameters
    scale : ndarray, shape (lasers,), optional
        Range scales; zero if omitted.
    """
    cosine, sine = np.cos(parameters.alpha), np.sin(parameters.alpha)
    level, up = np.cos(parameters.v), np.sin(parameters.v)
    direction = np.stack([level * cosine, -level * sine, up], axis=1)
    offset = np.stack([-parameters.hoff * sine, -parameters.hoff * cosine, parameters.voff], axis=1)
    stretched = direction * (1.0 if scale is None else 1.0 + scale[:, None])
    return np.hstack([stretched, parameters.dl[:, None] * direction + offset])


def to_beam(linear: Array) -> tuple[LaserParameters, Array]:
    """Beam parameters and range scales (lasers,) of linear parameters; inverse of `from_beam`."""
    a, b, c, e, f, g = linear.T
    level = np.hypot(a, b)
    alpha, v = np.arctan2(-b, a), np.arctan2(c, level)
    cosine, sine = np.cos(alpha), np.sin(alpha)
    dl = (e * cosine - f * sine) / np.cos(v)
    parameters = LaserParameters(
        dl=dl, alpha=alpha, v=v, voff=g - dl * np.sin(v), hoff=-(e * sine + f * cosine)
    )
    return parameters, np.hypot(level, c) - 1.0


def adjust(data: Observations, initial: LaserParameters, stochastic: Stochastic) -> Array:
    """Adjust the six linear parameters of every laser in one step.

    The sum of the squared distances of the points from the planes, at right angles to these, is
    minimal. A direction of the parameters that the data determine less well than the prior keeps
    the initial value: three planes do not determine all six parameters of a laser.

    Parameters
    ----------
    data : Observations
    initial : LaserParameters
        Where weak directions stay.
    stochastic : Stochastic
        With a prior for dl, alpha and v: that of dl holds for e, f and g, the larger one of the
        angles for a, b and c.

    Returns
    -------
    ndarray, shape (lasers, 6)
        Corrections of the beam parameters `NAMES`; zero for a laser without observations.
    """
    prior = dict(zip(("dl", "alpha", "v"), stochastic.prior_of(("dl", "alpha", "v")), strict=True))
    prior_std = np.repeat([max(prior["alpha"], prior["v"]), prior["dl"]], 3)
    linear = from_beam(initial)
    sine, cosine = np.sin(data.phi), np.cos(data.phi)
    normal = data.normal
    by_point = np.stack(
        [
            normal[:, 0] * sine + normal[:, 1] * cosine,
            normal[:, 0] * cosine - normal[:, 1] * sine,
            normal[:, 2],
        ],
        axis=1,
    )
    design = np.hstack([by_point * data.distance_m[:, None], by_point]) * prior_std
    for laser in np.unique(data.laser_id):
        own = data.laser_id == laser
        distance = design[own] @ (linear[laser] / prior_std) + data.offset[own]
        left, values, right = np.linalg.svd(design[own], full_matrices=False)
        kept = values > stochastic.noise_std_m
        step = right[kept].T @ ((left[:, kept].T @ distance) / values[kept])
        linear[laser] -= step * prior_std
    found, scale = to_beam(linear)
    return np.stack(
        [*(getattr(found, name) - getattr(initial, name) for name in NAMES[:-1]), scale], axis=1
    )
