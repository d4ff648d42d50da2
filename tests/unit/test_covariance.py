"""What can be a covariance, in any units."""

import numpy as np
import pytest

from velocal.geometry.covariance import covariance_fault

rng = np.random.default_rng(0)
#: Rows in metres, radians and millionths of a metre.
UNITS = np.array([1.0, 1e-4, 1e-6, 1e3])


def scaled(matrix):
    return matrix * np.outer(UNITS, UNITS)


@pytest.mark.parametrize("rank", [1, 2, 4])
def test_covariances(rank):
    factor = rng.normal(size=(4, rank))
    assert covariance_fault(scaled(factor @ factor.T), 4) is None


def test_a_value_that_is_known_exactly():
    assert covariance_fault(np.diag([1.0, 0.0])) is None
    assert covariance_fault(np.zeros((3, 3))) is None
    assert "semidefinite" in covariance_fault(np.array([[1.0, 0.5], [0.5, 0.0]]))


def test_one_eigenvalue_below_zero():
    """The matrix is turned: no variance in it is negative."""
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    for least, fault in ((0.0, None), (-1e-3, "it is not positive semidefinite")):
        matrix = turn @ np.diag([least, 1.0, 1.0, 1.0]) @ turn.T
        assert covariance_fault(scaled((matrix + matrix.T) / 2)) == fault


@pytest.mark.parametrize(
    ("matrix", "fault"),
    [
        (np.eye(3)[:2], "shape"),
        (np.eye(3), "3 rows, not 4"),
        (np.diag([1.0, 1.0, 1.0, np.nan]), "finite"),
        (np.diag([1.0, 1.0, -1e-9, 1.0]), "variance in row 3 is negative"),
        (scaled(np.eye(4) + np.diag([1e-3, 0, 0], 1)), "not symmetric"),
        (np.array(1.0), "shape"),
    ],
)
def test_faults(matrix, fault):
    assert fault in covariance_fault(matrix, 4)
