"""Assignment of returns to planes: the plane that a beam meets first."""

import numpy as np
import pytest

from velocal import arrays
from velocal.geometry.planes import Patch, Plane
from velocal.reduction.assignment import (
    NO_PLANE,
    Limits,
    assign,
    assigned_and_expected,
    assigned_rows,
)
from velocal.scanner.beam import Beams
from velocal.scanner.parameters import LaserParameters

#: The largest difference of ranges admits both planes of a pair, which are 0.1 m apart.
LIMITS = Limits(distance_m=0.2, edge_m=0.0, incidence_rad=np.deg2rad(80.0))


def ahead(name, y, aside=0.0):
    """Square patch of 2 m across the Y axis, `y` metres ahead and `aside` metres to the right."""
    corners = np.array([[aside + x, y, z] for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    return Patch(name, Plane(np.array([0.0, 1.0, 0.0]), -y, np.zeros((4, 4))), corners)


def plane_hit(patches, distance_m):
    """Index of the patch that is assigned to one horizontal beam along Y."""
    zero = LaserParameters(*np.zeros((5, 1)))
    beams = Beams(np.array([distance_m]), np.zeros(1), np.zeros(1, dtype=int), 0.002)
    return int(assign(beams, zero, patches, LIMITS)[0])


@pytest.mark.parametrize("distance_m", [2.95, 3.0, 3.05, 3.1])
def test_the_first_of_two_planes_behind_each_other_is_hit(distance_m):
    """Neither the order of the planes matters, nor which of them the range is nearer to."""
    near, far = ahead("near", 3.0), ahead("far", 3.1)
    assert plane_hit([near, far], distance_m) == 0
    assert plane_hit([far, near], distance_m) == 1


def test_a_plane_is_hit_past_the_edge_of_a_nearer_one():
    beside, far = ahead("near", 3.0, aside=1.5), ahead("far", 3.1)
    assert plane_hit([beside, far], 3.05) == 1
    assert plane_hit([far, beside], 3.05) == 0
    assert plane_hit([beside], 3.05) == NO_PLANE


def test_expected_are_the_returns_that_meet_a_plane_whatever_they_measured():
    """Two lasers sweep over two planes; one of them measures 0.4 m too short."""
    patches = [ahead("near", 4.0), ahead("behind", 4.1, aside=0.5)]
    phi = np.tile(np.linspace(-0.6, 0.6, 61), 2)
    laser = np.repeat([0, 1], 61)
    distance = 4.0 / np.cos(phi) - np.where(laser, 0.4, 0.0)
    beams = Beams(distance, np.mod(phi, 2.0 * np.pi), laser, 0.002)
    nothing = np.zeros(2)
    parameters = LaserParameters(nothing, nothing, nothing, nothing, nothing)
    rows, expected = assigned_and_expected(beams, parameters, patches, Limits())
    same = assigned_rows(beams, parameters, patches, Limits())
    for name, column in same.items():
        np.testing.assert_array_equal(rows[name], column)
    anything = assigned_rows(beams, parameters, patches, Limits(distance_m=np.inf))
    np.testing.assert_array_equal(expected, np.bincount(anything["laser_id"], minlength=2))
    assert set(rows["laser_id"]) == {0}
    assert expected[0] == expected[1] > 20


@pytest.mark.parametrize("n", [0, 10, 25])
def test_returns_are_assigned_the_same_in_blocks(monkeypatch, n):
    phi = np.linspace(-0.6, 0.6, n)
    beams = Beams(4.0 / np.cos(phi), phi, np.zeros(n, dtype=int), 0.002)
    patches, zero = [ahead("near", 4.0)], LaserParameters(*np.zeros((5, 1)))
    whole = assign(beams, zero, patches, LIMITS)
    assert (whole != NO_PLANE).any() == (n > 0)
    monkeypatch.setattr(arrays, "BLOCK", 10)
    np.testing.assert_array_equal(assign(beams, zero, patches, LIMITS), whole)
