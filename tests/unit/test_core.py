"""The Gauss-Newton iteration: convergence, its guard, and how it ends otherwise."""

import numpy as np
import pytest

from velocal.adjustment.core import HALVINGS, gauss_newton


class Roots:
    """Misclosure f(x) - y of one parameter for every block; `slope` may be a wrong derivative."""

    def __init__(self, function, slope, y):
        self.function, self.slope, self.y = function, slope, y
        self.evaluated = [[] for _ in y]

    def at(self, block, x):
        self.evaluated[block].append(float(x[0]))
        return x, self.function(x[0]) - self.y[block]

    def corrections(self, blocks, states):
        return [-np.array([w / self.slope(x[0])]) for x, w in states]

    def objective(self, here, there):
        return float(there[1] ** 2)


def solved(problem, starts, **settings):
    return gauss_newton(problem, np.array(starts, dtype=float)[:, None], np.ones(1), **settings)


def test_blocks_converge_each_on_its_own():
    problem = Roots(np.exp, np.exp, [1.0, np.e, 20.0])
    found = solved(problem, [0.0, 0.5, 2.5], tolerance=1e-12)
    values = [found[block].x[0] for block in range(3)]
    np.testing.assert_allclose(values, [0.0, 1.0, np.log(20.0)], atol=1e-12)
    assert all(block.converged and block.message == "converged" for block in found.values())
    # The first starts at its solution; only the others are evaluated further.
    assert found[0].iterations == 1
    assert found[2].iterations > 3
    assert len(problem.evaluated[0]) == 2
    assert len(problem.evaluated[2]) == found[2].iterations + 1
    # The state is that of the final parameters.
    assert all(block.state[0] is block.x for block in found.values())


def test_only_the_named_blocks_are_adjusted():
    problem = Roots(np.exp, np.exp, [1.0, np.e, 20.0])
    assert list(solved(problem, [0.0, 0.5, 2.5], blocks=[2])) == [2]
    assert problem.evaluated[:2] == [[], []]


def test_a_step_that_raises_the_sum_is_halved():
    """Newton's steps for arctan diverge from beyond 1.39; halved ones do not."""
    problem = Roots(np.arctan, lambda x: 1.0 / (1.0 + x**2), [0.0])
    found = solved(problem, [2.0])[0]
    assert found.converged
    assert found.x[0] == pytest.approx(0.0, abs=1e-12)
    first, full, half = problem.evaluated[0][:3]
    assert abs(full) > first
    assert half - first == pytest.approx((full - first) / 2)
    # Accepted parameters never raise the sum of squares.
    assert abs(half) < first


def test_an_iteration_that_no_step_helps_says_so():
    """A derivative of the wrong sign: every step leads away."""
    problem = Roots(np.exp, lambda x: -np.exp(x), [1.0])
    found = solved(problem, [1.0])[0]
    assert not found.converged
    assert found.message == "stalled: no step lowers the sum of squares"
    assert found.x[0] == 1.0
    assert found.state[0][0] == 1.0
    assert len(problem.evaluated[0]) == 1 + HALVINGS


def test_the_number_of_linearisations_is_limited():
    problem = Roots(lambda x: x**3, lambda x: 3.0 * x**2, [0.0])
    found = solved(problem, [1.0], max_iterations=4)[0]
    assert not found.converged
    assert found.iterations == 4
    assert found.message == "not converged after 4 linearisations"
    assert found.x[0] == pytest.approx((2.0 / 3.0) ** 4)


def test_a_change_is_compared_with_the_parameter_or_its_size():
    problem = Roots(lambda x: x**3, lambda x: 3.0 * x**2, [0.0])
    # Every step is a third of the parameter, and so small only beside a size of one.
    found = solved(problem, [1.0], tolerance=0.01, max_iterations=100)[0]
    assert found.converged
    assert found.iterations == 1 + np.ceil(np.log(0.03) / np.log(2.0 / 3.0))
