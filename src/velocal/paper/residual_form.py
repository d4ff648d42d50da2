"""The paper's own forms, as references: the residual with Table I, and the adjustment.

The residual holds for vertical planes only. Nothing else in the library uses this module.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from velocal.adjustment.linear import Step, System
from velocal.adjustment.solvers import PaperModel
from velocal.arrays import Array


def beta(phi: Array, alpha: Array, omega: Array) -> Array:
    """Angle between beam and wall trace after the paper's Table I, radians.

    The printed table uses phi; phi - alpha is meant (see the errata).

    Parameters
    ----------
    phi, alpha : ndarray, shape (n,)
        Rotational angle, and rotational angle correction of the laser, radians.
    omega : ndarray, shape (n,)
        Angle of the wall's trace with the Y axis, in [0, pi).

    Returns
    -------
    ndarray, shape (n,)
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


@dataclass(frozen=True, kw_only=True)
class PaperLiteral:
    """The paper's adjustment as printed, with the n x n pseudo-inverse: a reference for small n.

    `velocal.adjustment.solvers.PaperModel` is the same in a fast form; time and memory of this one
    grow with the third and second power of the number of rows.

    Attributes
    ----------
    cutoff : float
        Eigenvalues of N below this share of the largest are taken as zero; N squares the
        singular values, so that they are known to half the digits only.
    """

    cutoff: float = 1e-12

    def step(self, system: System, basis: Array | None = None) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        a = system.matrix
        p_inverse = np.diag(system.prior_std**2)
        n = a @ p_inverse @ a.T
        influence = p_inverse @ a.T @ np.linalg.pinv(n, rcond=self.cutoff, hermitian=True)
        values = np.linalg.eigvalsh(n)[::-1][: a.shape[1]]
        kept = values > self.cutoff * values[0]
        # The literal form gives corrections and influence; the rest of a `Step` is taken from the
        # fast form.
        scaled = np.linalg.svd(a * system.prior_std, full_matrices=False)[2][kept]
        fast = PaperModel(truncate_at=None).step(system, system.prior_std[:, None] * scaled.T)
        # Of least P-norm are the whole corrections since the initial parameters, not the last step.
        rest = system.w - a @ system.shift
        return replace(
            fast,
            delta=-(influence @ rest) - system.shift,
            influence=influence,
            cofactor=influence @ influence.T,
            singular_values=np.sqrt(np.maximum(values, 0.0)),
        )

    def objective(self, system: System) -> float:
        """Sum of squared misclosures."""
        return float(system.w @ system.w)

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """Return the system: this is the form with all its rows."""
        return system
