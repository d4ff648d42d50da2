"""Survey files and stations."""

import numpy as np
import pytest
from support.adjustment import adjust_laser

from velocal.adjustment.observations import Observations
from velocal.adjustment.solvers import WithPrior
from velocal.adjustment.stochastic import Stochastic
from velocal.errors import StorageError, SurveyError
from velocal.geometry.planes import Patch, Plane, fit_plane
from velocal.geometry.rigid import RigidTransformation, rotation_from_vector
from velocal.io import storage
from velocal.scanner.beam import laser_beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.survey.station import Station, SurveyedPlane, read_station
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


CORNERS = np.array([[0.3, 0, 0], [-0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.2]])
SHIFT = np.array([0.0, 1.0, 0.5])


def base(names, xyz, group="b", std=1e-3):
    xyz = np.asarray(xyz, dtype=float)
    return Targets(tuple(names), (group,) * len(names), xyz, np.full(xyz.shape, std))


def wall():
    a, b = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(0, 2, 4))
    xyz = np.column_stack([a.ravel(), np.full(a.size, 3.0), b.ravel()])
    return base([f"t{i}" for i in range(a.size)], xyz, "wall")


def test_station_and_its_file(tmp_path):
    station = Station.adjust(
        wall(), base("abcd", CORNERS, "HDL-32E"), base("dcba", (CORNERS + SHIFT)[::-1], "P5"),
        ["wall"], where="x",
    )  # fmt: skip
    assert (station.position, station.scanner) == ("P5", "HDL-32E")
    np.testing.assert_allclose(station.pose.translation, [0, -1, -0.5], atol=1e-9)
    patch = station.patches[0]
    np.testing.assert_allclose(patch.plane.normal, [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(patch.plane.offset, -2.0, atol=1e-9)
    path = tmp_path / "P5.json"
    storage.write_json(path, station.to_json())
    again = read_station(path)
    assert storage.finite(again.to_json()) == storage.read_json(path)
    np.testing.assert_array_equal(again.patches[0].corners, patch.corners)
    for name in ("translation", "pose", "planes", "flatness_m"):
        found, expected = (getattr(s.uncertainty(), name) for s in (again, station))
        np.testing.assert_array_equal(found, expected)
    inside = patch.contains(np.array([[0.0, 2.0, 0.5], [0.0, 2.0, 1.6], [1.2, 2.0, 0.5]]))
    assert inside.tolist() == [True, False, False]


def test_file_that_is_no_station(tmp_path):
    path = tmp_path / "P5.json"
    storage.write_json(path, {"position": "P5", "scanner": "HDL-32E", "planes": []})
    with pytest.raises(StorageError, match=r"P5.json: is not the survey of a position: 'pose'"):
        read_station(path)


def rotation_vector(rotation):
    """Rotation vector of a small rotation."""
    odd = (rotation - rotation.T) / 2.0
    return np.array([odd[2, 1], odd[0, 2], odd[1, 0]])


def test_pose_has_the_covariances_of_both_frames_in_their_places():
    """Errors of one coordinate of the scanner frame against central differences of the pose."""
    turn = rotation_from_vector(np.array([0.0, 0.0, np.pi / 2.0]))
    in_scanner, in_site = base("abcd", CORNERS), base("abcd", CORNERS @ turn.T + SHIFT)
    # Large errors along X of the scanner, and along Z of the site.
    std_scanner = np.tile([5e-3, 1e-4, 1e-4], (4, 1))
    std_site = np.tile([2e-4, 2e-4, 3e-3], (4, 1))

    def pose(scanner_xyz, site_xyz):
        return Station.adjust(
            wall(),
            Targets(in_scanner.name, in_scanner.group, scanner_xyz, std_scanner),
            Targets(in_site.name, in_site.group, site_xyz, std_site),
            ["wall"],
            where="x",
        ).pose

    known = pose(in_scanner.xyz, in_site.xyz)
    expected, h = np.zeros((6, 6)), 1e-6
    for frame, std in enumerate((std_scanner, std_site)):
        for row, axis in np.ndindex(4, 3):
            ends = []
            for sign in (1.0, -1.0):
                xyz = [in_scanner.xyz.copy(), in_site.xyz.copy()]
                xyz[frame][row, axis] += sign * h
                moved = pose(*xyz)
                w = rotation_vector(moved.rotation @ known.rotation.T)
                ends.append(np.concatenate([w, moved.translation]))
            derivative = (ends[0] - ends[1]) / (2.0 * h)
            expected += std[row, axis] ** 2 * np.outer(derivative, derivative)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(known.covariance / scale, expected / scale, atol=1e-4)


def test_uncertainty_of_a_pose_reaches_a_laser_by_rotation_and_translation():
    """Covariance of a laser from its station, against readjustments with a moved pose."""
    turn = rotation_from_vector(np.array([0.02, -0.01, 0.4]))
    site = [wall(), Targets(wall().name, ("floor",) * 20, wall().xyz[:, [0, 2, 1]] * [3, 3, 0],
                            wall().std)]  # fmt: skip
    targets = Targets(
        tuple(f"{p.group[0]}_{n}" for p in site for n in p.name),
        tuple(g for p in site for g in p.group),
        np.concatenate([p.xyz for p in site]),
        np.concatenate([p.std for p in site]),
    )
    station = Station.adjust(
        targets, base("abcd", CORNERS), base("abcd", CORNERS @ turn.T + [0.3, 0.2, 0.9]),
        ["wall", "floor"], where="x",
    )  # fmt: skip
    laser, start = 10, nominal(SCANNERS["HDL-32E"])
    phi = np.linspace(-0.4, 0.4, 41)
    number = np.arange(len(phi)) % 2
    direction, origin = laser_beams(phi, np.full(len(phi), laser), start)

    def planes(pose):
        """Normals and offsets of the planes of the site at the pose."""
        unmoved = np.linalg.inv(station.pose.plane_matrix())
        rows = [np.append(p.plane.normal, p.plane.offset) for p in station.patches]
        return np.array([pose.plane_matrix() @ unmoved @ row for row in rows])

    own = planes(station.pose)[number]
    distance = -(np.sum(origin * own[:, :3], axis=1) + own[:, 3]) / np.sum(
        direction * own[:, :3], axis=1
    )
    names = ("dl", "alpha")
    stochastic = Stochastic(
        noise_std_m=0.01,
        prior_std={"dl": 0.05, "alpha": np.deg2rad(0.5)},
        survey=(station.uncertainty(),),
    )

    def adjusted(pose):
        moved = planes(pose)[number]
        data = Observations(
            distance - start.dl[laser], phi, np.full(len(phi), laser), moved[:, :3], moved[:, 3],
            number,
        )  # fmt: skip
        return adjust_laser(data, laser, start, names, WithPrior(), stochastic)

    h, columns = 1e-5, []
    for axis in range(6):
        ends = []
        for sign in (1.0, -1.0):
            step = sign * h * np.eye(6)[axis]
            moved = RigidTransformation(
                rotation_from_vector(step[:3]) @ station.pose.rotation,
                station.pose.translation + step[3:],
                np.zeros((6, 6)),
            )
            ends.append(adjusted(moved).corrections)
        columns.append((ends[0] - ends[1]) / (2.0 * h))
    jacobian = np.array(columns).T
    expected = jacobian @ station.pose.covariance @ jacobian.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    found = adjusted(station.pose).parts["pose"]
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-3)


def surveyed(targets, variance_factor, flatness_mean_m=0.001):
    plane = Plane(np.array([0.0, 1.0, 0.0]), -3.0, np.zeros((4, 4)))
    patch = Patch("wall", plane, np.zeros((3, 3)))
    return SurveyedPlane(patch, targets, flatness_mean_m, flatness_mean_m, variance_factor)


@pytest.mark.parametrize("factor", [None, float("nan"), 0.7])
def test_targets_that_show_no_flatness(factor):
    content = surveyed(3, 1.0).to_json() | {"variance_factor": factor}
    assert SurveyedPlane.from_json(content).flatness_std_m == 0.0


@pytest.mark.parametrize("n", [5, 10, 60])
def test_flatness_is_not_lessened_by_the_fit(n):
    rng, found = np.random.default_rng(5), []
    for _ in range(400):
        xy = rng.uniform(-1.0, 1.0, (n, 2))
        # 4 mm of the wall, 1 mm of the targets.
        z = rng.normal(0.0, np.hypot(0.004, 0.001), n)
        fit = fit_plane(np.column_stack([xy, z + 3.0]), np.full(n, 0.001))
        plane = surveyed(n, fit.variance_factor, fit.flatness_mean_m)
        found.append(plane.flatness_std_m**2)
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
    covariance = Targets(names, group, xyz, std, root @ root.T).plane_covariances()["wall"]
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
        Station.adjust(
            wall(), base("ab", np.eye(3)[:2]), base("ab", np.eye(3)[:2]), ["wall"], where="x"
        )
