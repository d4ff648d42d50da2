"""Whether a matrix can be a covariance."""

from __future__ import annotations

import numpy as np

from velocal.arrays import Array

#: Roundings of a matrix that was adjusted, written and read, as a share of its diagonal.
ROUNDING = 1e-8


def covariance_fault(matrix: Array, size: int | None = None) -> str | None:
    """Say why a matrix is no covariance.

    A covariance is square, finite, symmetric and positive semidefinite. The last two are judged on
    the correlations, so that the units of the rows do not matter.

    Parameters
    ----------
    matrix : ndarray
    size : int, optional
        Number of rows and columns; any if None.

    Returns
    -------
    str or None
        None if it is one.
    """
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        return f"it has the shape {matrix.shape}"
    if size is not None and len(matrix) != size:
        return f"it has {len(matrix)} rows, not {size}"
    if matrix.dtype.kind not in "fiu":
        return "not all of its values are numbers"
    if not np.isfinite(matrix).all():
        return "not all of its values are finite"
    variance = np.diag(matrix)
    if (variance < 0.0).any():
        return f"the variance in row {int(np.argmin(variance)) + 1} is negative"
    # A value that is known exactly has no covariance with another.
    scale = np.where(variance > 0.0, np.sqrt(variance), 1.0)
    correlation = matrix / np.outer(scale, scale)
    if (np.abs(correlation - correlation.T) > ROUNDING).any():
        return "it is not symmetric"
    if len(matrix) and np.linalg.eigvalsh(correlation)[0] < -ROUNDING * len(matrix):
        return "it is not positive semidefinite"
    return None
