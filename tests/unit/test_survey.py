"""Survey files and stations."""

import numpy as np
import pytest

from velocal.errors import SurveyError
from velocal.geometry.planes import fit_plane
from velocal.geometry.rigid import RigidTransformation
from velocal.survey.station import (
    adjust_station,
    as_dict,
    patches_of,
    plane_covariances,
    uncertainty_of,
)
from velocal.survey.targets import Targets, read_targets, write_targets

HEADER = "target,plane,x_m,y_m,z_m,std_x_mm,std_y_mm,std_z_mm\n"


def sheet(tmp_path, body, header=HEADER):
    path = tmp_path / "targets.csv"
    path.write_text(header + body)
    return path


def test_round_trip(tmp_path):
    targets = Targets(
        ("a", "b"), ("w", "w"), np.array([[1.0, 2, 3], [4, 5, 6]]), np.full((2, 3), 1e-3)
    )
    write_targets(tmp_path / "t.csv", "plane", [targets])
    found = read_targets(tmp_path / "t.csv", "plane")
    assert found.name == targets.name
    np.testing.assert_array_equal(found.xyz, targets.xyz)
    np.testing.assert_allclose(found.std, targets.std)


@pytest.mark.parametrize(
    ("body", "header", "message"),
    [
        ("a,w,1,2,x,1,1,1\n", HEADER, "row 2"),
        ("a,w,1,2,3,1,1,0\n", HEADER, "not positive"),
        ("a,w,1,2,3,1,1,1\na,w,1,2,3,1,1,1\n", HEADER, "occurs twice"),
        ("a,w,1,2,3,1,1\n", "target,plane,x_m,y_m,z_m,std_x_mm,std_y_mm\n", "std_z_mm"),
        ("a,w,1,2,3,1,1,1,9\n", HEADER.strip() + ",colour\n", "colour"),
    ],
)
def test_faults_are_named(tmp_path, body, header, message):
    with pytest.raises(SurveyError, match=message):
        read_targets(sheet(tmp_path, body, header), "plane")


def test_missing_file_and_group(tmp_path):
    with pytest.raises(SurveyError, match="cannot be read"):
        read_targets(tmp_path / "no.csv", "plane")
    targets = read_targets(sheet(tmp_path, "a,w,1,2,3,1,1,1\n"), "plane")
    with pytest.raises(SurveyError, match=r"no targets of 'v' \(allowed: w\)"):
        targets.of("v", where="x")


def base(names, xyz):
    xyz = np.asarray(xyz, dtype=float)
    return Targets(tuple(names), ("b",) * len(names), xyz, np.full(xyz.shape, 1e-3))


def wall():
    a, b = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(0, 2, 4))
    xyz = np.column_stack([a.ravel(), np.full(a.size, 3.0), b.ravel()])
    return Targets(
        tuple(f"t{i}" for i in range(a.size)), ("wall",) * a.size, xyz, np.full(xyz.shape, 1e-3)
    )


def test_station_and_its_file():
    corners = [[0.3, 0, 0], [-0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.2]]
    shifted = np.add(corners, [0.0, 1.0, 0.5])
    station = adjust_station(
        wall(), base("abcd", corners), base("dcba", shifted[::-1]), ["wall"], where="x"
    )
    np.testing.assert_allclose(station.pose.transformation.translation, [0, -1, -0.5], atol=1e-9)
    patch = station.patches[0]
    np.testing.assert_allclose(patch.plane.normal, [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(patch.plane.offset, -2.0, atol=1e-9)
    again = patches_of(as_dict(station))[0]
    np.testing.assert_array_equal(again.corners, patch.corners)
    inside = patch.contains(np.array([[0.0, 2.0, 0.5], [0.0, 2.0, 1.6], [1.2, 2.0, 0.5]]))
    assert inside.tolist() == [True, False, False]


def with_planes(**values):
    pose = {"translation_m": np.zeros(3), "covariance_rad_m": np.zeros((6, 6))}
    plane = {"covariance": np.zeros((4, 4)), "flatness_mean_m": 0.001, **values}
    return {"pose": pose, "planes": [plane]}


@pytest.mark.parametrize("factor", [None, float("nan"), 0.7])
def test_targets_that_show_no_flatness(factor):
    known = uncertainty_of(with_planes(targets=3, variance_factor=factor))
    assert known.flatness_m == 0.0


@pytest.mark.parametrize("n", [5, 10, 60])
def test_flatness_is_not_lessened_by_the_fit(n):
    rng, found = np.random.default_rng(5), []
    for _ in range(400):
        xy = rng.uniform(-1.0, 1.0, (n, 2))
        # 4 mm of the wall, 1 mm of the targets.
        z = rng.normal(0.0, np.hypot(0.004, 0.001), n)
        fit = fit_plane(np.column_stack([xy, z + 3.0]), np.full(n, 0.001))
        content = with_planes(
            targets=n, variance_factor=fit.variance_factor, flatness_mean_m=fit.flatness_mean_m
        )
        found.append(uncertainty_of(content).flatness_m[0] ** 2)
    assert np.sqrt(np.mean(found)) == pytest.approx(0.004, rel=0.1)


def test_covariance_of_planes_whose_targets_have_errors_in_common():
    """Drawn shifts, turns and single errors, fitted in another frame, against what is stated."""
    rng = np.random.default_rng(7)
    xyz = np.column_stack([rng.uniform(0.0, 5.0, 40), np.full(40, 3.0), rng.uniform(0.0, 2.0, 40)])
    # Single errors of 1 mm; all are shifted by 0.5 mm and turned about Z.
    common = np.tile(np.eye(3), (40, 1)) * 5e-4
    turn = np.cross([0.0, 0.0, 1.0], xyz).reshape(-1, 1) * 2e-4
    root = np.hstack([common, turn, np.eye(120) * 1e-3])
    names, group = tuple(map(str, range(40))), ("wall",) * 40
    std = np.sqrt(np.diag(root @ root.T)).reshape(-1, 3)
    covariance = plane_covariances(Targets(names, group, xyz, std, root @ root.T))["wall"]
    c, s = np.cos(0.4), np.sin(0.4)
    frame = RigidTransformation(
        np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, -0.5, 0.2]),
        np.zeros((6, 6)),
    )  # fmt: skip
    stated = frame.plane_matrix() @ covariance @ frame.plane_matrix().T
    weights = np.sqrt(np.mean(std**2, axis=1))
    found = []
    for _ in range(4000):
        moved = xyz + (root @ rng.standard_normal(root.shape[1])).reshape(-1, 3)
        plane = fit_plane(frame.apply(moved), weights).plane
        found.append([*plane.normal, plane.offset])
    seen = np.cov(np.array(found).T)
    scale = np.sqrt(np.outer(np.diag(seen), np.diag(seen)))
    np.testing.assert_allclose(seen / scale, stated / scale, atol=0.08)


def test_too_few_common_base_targets():
    with pytest.raises(SurveyError, match="2 targets in common"):
        adjust_station(
            wall(), base("ab", np.eye(3)[:2]), base("ab", np.eye(3)[:2]), ["wall"], where="x"
        )
