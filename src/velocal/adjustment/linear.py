"""Linearised systems, one or a stack of them, and their solution by singular values.

Where the weights are known beforehand, an orthogonal rotation reduces a system to u + 1 rows with
the same solution. All reduced systems have one shape, so that many are solved at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array


@dataclass(frozen=True)
class System:
    """A functional model linearised at the current parameters, or a stack of several of them.

    Attributes
    ----------
    matrix : ndarray, shape (n, u)
        Design matrix A.
    w : ndarray, shape (n,)
        Misclosures.
    sigma_misclosure : ndarray, shape (n,)
        A-priori standard deviation of every misclosure.
    prior_std : ndarray, shape (u,)
        A-priori standard deviation of the corrections; infinite for none.
    shift : ndarray, shape (u,)
        Current minus initial parameters.
    size : int, or None
        Number of rows before the reduction; None where the system is not reduced.
    rotation, row_weight : ndarray, shape (n, u + 1), (n,), or None
        The reduction, where it is kept: reduced rows are ``rotation.T @ (row_weight * rows)``.
    """

    matrix: Array
    w: Array
    sigma_misclosure: Array
    prior_std: Array
    shift: Array
    size: int | NDArray[np.integer] | None = None
    rotation: Array | None = None
    row_weight: Array | None = None


@dataclass(frozen=True)
class Step:
    """Solution of a linearised system, or of a stack of them.

    Attributes
    ----------
    delta : ndarray, shape (u,)
        Corrections of the current parameters.
    influence : ndarray, shape (u, n)
        Change of the parameters by the misclosures: errors e of w move them by
        ``-influence @ e``.
    cofactor : ndarray, shape (u, u)
        Covariance of the parameters for misclosures of covariance diag(sigma_misclosure^2), or of
        unit variance for solvers that give all rows the same weight.
    prior_part : ndarray, shape (u, u)
        Covariance of the parameters from prior errors of what the data do not determine; zero
        where they determine everything.
    estimable : ndarray, shape (u, u)
        Projector on the estimable space, in units of the column scale.
    basis : ndarray, shape (u, k)
        Space of the corrections, in their units; columns beyond its rank are zero.
    singular_values : ndarray
        Of the scaled matrix; zero where left out.
    left : ndarray, shape (n, k)
        Root of the hat matrix, in units of the weighted rows.
    row_weight : ndarray, shape (n,), or None
        Additional weights of a robust solver; None where all rows have the same.
    """

    delta: Array
    influence: Array
    cofactor: Array
    prior_part: Array
    estimable: Array
    basis: Array
    singular_values: Array
    left: Array
    row_weight: Array | None = None

    @property
    def rank(self) -> int:
        """Number of combinations of parameters that the data determine."""
        return int(np.rint(np.trace(self.estimable)))

    @property
    def leverage(self) -> Array:
        """Diagonal of the hat matrix, shape (n,); one minus it are the redundancy numbers."""
        return np.asarray((self.left**2).sum(axis=-1))

    def unreduced(self, system: System) -> Step:
        """Return the solution for all rows of a reduced system that has kept its rotation."""
        if system.rotation is None or system.row_weight is None:
            return self
        influence = (self.influence @ system.rotation.T) * system.row_weight
        return replace(self, influence=influence, left=system.rotation @ self.left)


def rotated(system: System, row_weight: Array, sigma_misclosure: float, *, keep: bool) -> System:
    """Weight the rows of a system and rotate them into a triangle of u + 1 rows.

    Parameters
    ----------
    system : System
        With n rows.
    row_weight : ndarray, shape (n,)
        Factor of every row.
    sigma_misclosure : float
        Standard deviation of the new rows, the same for all.
    keep : bool
        Whether to keep the rotation, which takes as much time as the triangle.

    Returns
    -------
    System
        Of the same solution and the same sum of squares.
    """
    n, u = system.matrix.shape
    rows = np.empty((u + 1, n))
    np.multiply(system.matrix.T, row_weight, out=rows[:u])
    np.multiply(system.w, row_weight, out=rows[u])
    rotation, triangle = None, np.zeros((u + 1, u + 1))
    if keep:
        rotation = np.zeros((n, u + 1))
        rotation[:, : min(n, u + 1)], triangle[:n] = np.linalg.qr(rows.T)
    else:
        # The upper triangle of the raw form. (The other modes of NumPy copy all rows.)
        raw = np.linalg.qr(rows.T, mode="raw")[0].T[: u + 1]
        triangle[:n] = np.where(np.arange(len(raw))[:, None] <= np.arange(u + 1), raw, 0.0)
    return System(
        triangle[:, :u],
        triangle[:, u],
        np.full(u + 1, sigma_misclosure),
        system.prior_std,
        system.shift,
        n,
        rotation,
        row_weight,
    )


def across(matrix: Array) -> Array:
    """Transposed matrix, or stack of matrices."""
    return np.swapaxes(matrix, -1, -2)


def decomposed(
    system: System,
    row_weight: Array,
    scale: Array,
    floor: Array | float,
    basis: Array | None,
) -> Step:
    """Least-squares solution by singular values, restricted to a space of corrections.

    Parameters
    ----------
    system : System
        One linearised system, or a stack of them.
    row_weight : ndarray, shape (n,)
        Factor of every row: the inverse of a standard deviation, or one.
    scale : ndarray, shape (u,)
        Units of the corrections in which the rank is decided.
    floor : ndarray or float
        Singular values below this are left out, as are those below machine precision.
    basis : ndarray, shape (u, k), or None
        Space of the corrections that an earlier linearisation decided on. None: the directions
        whose singular values are large enough are found, and form the basis.

    Returns
    -------
    Step
        Without `row_weight`, which only robust solvers set.
    """
    weighted = system.matrix * row_weight[..., None]
    n, u = weighted.shape[-2:]
    size = np.asarray(n if system.size is None else system.size)[..., None]
    # The triangle has the singular values of the whole: the many rows are used only once.
    rotation, weighted = np.linalg.qr(weighted) if n > 3 * u else (None, weighted)
    if basis is None:
        _, singular, right = np.linalg.svd(weighted * scale[..., None, :], full_matrices=False)
        eps = _largest(singular) * np.maximum(size, u) * np.finfo(float).eps
        found = singular > np.maximum(eps, np.asarray(floor)[..., None])
        # Rows of zeros that fill up a reduced system do not add to the rank.
        found &= np.arange(singular.shape[-1]) < size
        basis = scale[..., None] * across(right * found[..., None])
    rank = np.count_nonzero(np.any(basis != 0.0, axis=-2), axis=-1)[..., None]
    left, singular, right = np.linalg.svd(weighted @ basis, full_matrices=False)
    # A direction of a given basis may have become empty.
    kept = singular > _largest(singular) * np.finfo(float).eps ** 2
    kept &= np.arange(singular.shape[-1]) < rank
    singular, left = np.where(kept, singular, 0.0), np.where(kept[..., None, :], left, 0.0)
    if rotation is not None:
        left = rotation @ left
    inverse = np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
    root = basis @ (across(right) * inverse[..., None, :])
    influence = (root @ across(left)) * row_weight[..., None, :]
    estimable = np.broadcast_to(np.eye(u), (*weighted.shape[:-2], u, u))
    prior_part = np.zeros(estimable.shape)
    if np.any(rank < u):
        # Prior errors of what the data do not determine remain, and enter what is determined
        # through the influence G: (I - G A) of them.
        known = np.where(np.isfinite(system.prior_std), system.prior_std, 0.0)
        left_over = (estimable - influence @ system.matrix) * known
        short = rank[..., None] < u
        prior_part = np.where(short, left_over @ across(left_over), prior_part)
        orthonormal = np.linalg.qr(basis / scale[..., None])[0]
        orthonormal = orthonormal * (np.arange(basis.shape[-1]) < rank)[..., None, :]
        estimable = np.where(short, orthonormal @ across(orthonormal), estimable)
    return Step(
        delta=-(influence @ system.w[..., None])[..., 0],
        influence=influence,
        cofactor=root @ across(root),
        prior_part=prior_part,
        estimable=estimable,
        basis=basis,
        singular_values=singular,
        left=left,
    )


def _largest(singular: Array) -> Array:
    return np.asarray(singular.max(axis=-1, keepdims=True, initial=0.0))
