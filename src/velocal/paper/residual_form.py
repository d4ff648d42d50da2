"""The paper's own form of the residual, with Table I, for vertical planes only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
