"""Maps: points of several positions in one frame, sections of walls, and their figure."""

from dataclasses import replace
from pathlib import Path

import draw_map
import map_building
import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from support.building import ROOM, WORLD, stated
from support.world import changed, without_errors

from velocal.calibration.files import formats
from velocal.errors import VelocalError
from velocal.evaluation import interior_map
from velocal.geometry.rigid import RigidTransformation
from velocal.io import schemas, storage
from velocal.reporting import captions
from velocal.reporting.figures import interior_map as map_figure
from velocal.scanner.beam import Beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.simulation import building, capture
from velocal.simulation.survey import base_targets_true
from velocal.simulation.truth import factory_parameters, unit_truth
from velocal.study.figures import MapFigure
from velocal.study.planes import Box
from velocal.study.reading import read_yaml
from velocal.survey.targets import Targets, write_targets

ROOT = Path(__file__).resolve().parents[2]
SELECTION = MapFigure(
    kind="map",
    scanner="HDL-64E",
    set="true",
    sections={
        "west": Box(x_m=[-0.19, 0.19], y_m=[0.3, 2.7], z_m=[0.4, 0.6]),
        "south": Box(x_m=[1.4, 3.8], y_m=[-0.19, 0.19], z_m=[0.4, 0.6]),
    },
)
BOX = Box(x_m=[0.0, 5.0], y_m=[1.7, 2.3], z_m=[0.9, 1.1])


def wall(rng, n=20_000, std=0.03, slope=0.01):
    """Points of a wall along X at Y = 2, turned a little, rough by `std`."""
    x = rng.uniform(-1.0, 6.0, n)
    y = 2.0 + slope * (x - 2.5) + rng.normal(0.0, std, n)
    return np.column_stack([x, y, rng.uniform(0.0, 2.0, n)])


def test_thickness_is_that_about_the_walls_own_line():
    rng = np.random.default_rng(3)
    xyz = {"factory": wall(rng)}
    xyz["refined"] = xyz["factory"].copy()
    turned = 2.1 - 0.02 * xyz["refined"][:, 0]
    xyz["refined"][:, 1] = turned + rng.normal(0.0, 0.01, len(turned))
    part = interior_map.section(xyz, BOX, "wall")
    np.testing.assert_allclose(part.thickness("factory"), 0.03, rtol=0.05)
    np.testing.assert_allclose(part.thickness("refined"), 0.01, rtol=0.05)
    chosen = xyz["factory"][part.rows]
    assert (chosen[:, 0] >= 0.0).all()
    assert (chosen[:, 0] <= 5.0).all()
    assert (np.abs(chosen[:, 2] - 1.0) <= 0.1).all()
    assert 0.8 < len(part.rows) / (20_000 * 5 / 7 * 0.1) < 1.2


@pytest.mark.parametrize("name", ["HDL-64E", "VLP-32C"])
def test_ranges_are_counted_in_the_ticks_of_the_scanner(name):
    scanner = SCANNERS[name]
    returns = {
        "laser_id": np.arange(4),
        "azimuth": np.full(4, 9000),
        "distance": np.array([2500, 0, 5, 1]),
    }
    flat = replace(nominal(scanner), voff=np.zeros(scanner.n_lasers))
    pose = RigidTransformation(np.eye(3), np.zeros(3), np.zeros((6, 6)))
    beams = Beams.from_ticks(returns, scanner, 10.0)[returns["distance"] > 0]
    found = interior_map.rows(0, beams, [flat, flat], pose)
    length = np.linalg.norm([found[f"{axis}_factory_m"] for axis in "xyz"], axis=0)
    expected = np.hypot(returns["distance"][[0, 2, 3]] * scanner.distance_tick_m,
                        flat.hoff[[0, 2, 3]])  # fmt: skip
    np.testing.assert_allclose(length, expected)


def test_the_pose_weights_each_frame_with_its_own_covariance():
    """A target whose X in the map is badly known must not move the pose along X.

    The scanner is turned by 90 degrees, so that X of the map is not X of the scanner.
    """
    name = ("a", "b", "c", "d")
    here = np.array([[0.2, 0.0, 0.1], [0.0, 0.2, 0.0], [-0.2, 0.0, 0.1], [0.0, -0.2, 0.0]])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    place = np.array([2.0, 1.5, 1.0])
    there = here @ quarter.T + place
    there[0, 0] += 0.01
    std = np.full((4, 3), 1e-4)
    std[0, 0] = 0.1
    in_map = Targets(name, ("A",) * 4, there, std)
    in_scanner = Targets(name, ("HDL-64E",) * 4, here, np.full((4, 3), 1e-4))
    pose = interior_map.scanner_pose(in_map, in_scanner, where="A")
    # With its own weight, 2e-6 of the others', the error of 1 cm moves the pose by some nanometres;
    # with the weight of the others it would move the pose by 2 mm.
    np.testing.assert_allclose(pose.translation, place, atol=1e-6)
    np.testing.assert_allclose(pose.rotation, quarter, atol=1e-6)


def test_a_wall_may_run_along_y():
    rng = np.random.default_rng(4)
    cloud = wall(rng)
    turned = cloud[:, [1, 0, 2]]
    box = Box(x_m=BOX.y_m, y_m=BOX.x_m, z_m=BOX.z_m)
    one = interior_map.section({"factory": cloud}, BOX, "wall")
    other = interior_map.section({"factory": turned}, box, "wall")
    assert one.thickness("factory") == other.thickness("factory")


def test_an_empty_section_is_named():
    with pytest.raises(VelocalError, match=r"section 'attic'.*0 points"):
        interior_map.section({"factory": np.zeros((50, 3))}, BOX, "attic")


def test_a_recording_without_a_complete_rotation_is_named():
    with pytest.raises(VelocalError, match=r"M1.bin: no rotation is complete"):
        interior_map.first_complete(np.array([False, False]), "M1.bin")
    assert interior_map.first_complete(np.array([False, True, True]), "M1.bin").tolist() == [1]


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """Recordings of a room without errors, mapped with the factory's and with true parameters."""
    folder = tmp_path_factory.mktemp("map")
    rooms = {**ROOM, "base_std_mm": 1e-6, "positions": {
        "A": {**ROOM["positions"]["A"], "tilt_x_deg": 0.4},
        "B": {**ROOM["positions"]["A"], "x_m": 2.5, "y_m": 1.2, "heading_deg": 70.0},
    }}  # fmt: skip
    perfect = changed(without_errors(WORLD), {"building": rooms})
    recordings = []
    for position in rooms["positions"]:
        recordings.append(folder / f"{position}.bin")
        scene = building.scene(perfect, position)
        blocks = capture.records(perfect, "HDL-64E", scene, position, 1)
        recordings[-1].write_bytes(b"".join(blocks))
    base = [folder / name for name in ("map.csv", "scanner.csv", "factory.csv", "true.csv")]
    points = folder / "points.parquet"
    write_targets(base[0], "position", stated(building.base_targets(perfect)))
    write_targets(base[1], "scanner", stated([base_targets_true(perfect, "HDL-64E")]))
    formats.write(base[2], factory_parameters(perfect, "HDL-64E"))
    formats.write(base[3], unit_truth(perfect, "HDL-64E").parameters)
    names = ("base_map", "base_scanner", "calibration", "refined")
    map_building.main(
        recordings=recordings, positions=list(rooms["positions"]), points=points,
        parameter_set="true", scanner="HDL-64E", **dict(zip(names, base, strict=True)),
    )  # fmt: skip
    return points


def test_true_parameters_give_back_the_room(mapped):
    columns, facts = storage.read_table(mapped, schemas.MAP)
    assert facts["positions"] == ["A", "B"]
    assert facts["set"] == "true"
    np.testing.assert_allclose(facts["scanners_m"], [[2.0, 1.5, 1.0], [2.5, 1.2, 1.0]], atol=1e-4)
    for number in (0, 1):
        shots = np.count_nonzero(columns["position"] == number)
        assert 90_000 < shots < 134_000  # a rotation of 2083 firings, without door and window
    for name, box in SELECTION.sections.items():
        part = interior_map.section(interior_map.clouds(columns), box, name)
        # Ticks of 2 mm, and encoder steps of 0.09 deg.
        assert part.thickness("refined") < 0.002
        assert part.thickness("factory") > 0.01
        run, across = (1, 0) if name == "west" else (0, 1)
        at = interior_map.clouds(columns)["refined"][part.rows]
        assert abs(at[:, across].mean()) < 0.001
        assert np.ptp(at[:, run]) > 2.0


def test_summary_and_figure(mapped, tmp_path, monkeypatch):
    def draw(name):
        files = [tmp_path / f"{name}.{suffix}" for suffix in ("svg", "png", "csv", "summary.csv")]
        outputs = dict(zip(("svg", "png", "csv", "summary"), files, strict=True))
        draw_map.main(points=mapped, **outputs, selection=SELECTION, simulated=True)
        return [path.read_bytes() for path in files], files

    first, files = draw("first")
    monkeypatch.setitem(mpl.rcParams, "savefig.dpi", 30)
    second, _ = draw("second")
    assert first == second
    summary = pd.read_csv(files[3]).set_index("item")["value"]
    columns, _ = storage.read_table(mapped, schemas.MAP)
    assert summary["map_points"] == len(columns["laser_id"])
    assert summary["map_positions"] == 2
    numbers = pd.read_csv(files[2])
    assert len(numbers) == summary["west_points"]
    for state in interior_map.STATES:
        rms = np.sqrt(np.mean(numbers[f"across_{state}_cm"] ** 2))
        np.testing.assert_allclose(rms, summary[f"west_{state}_rms_cm"], atol=2e-3)
        assert f"{rms:.2f}" in captions.caption(SELECTION, numbers)
    assert set(numbers["position"]) == {"A", "B"}
    assert numbers["laser"].between(1, 64).all()


def test_sections_share_axes_before_and_after(mapped):
    columns, facts = storage.read_table(mapped, schemas.MAP)
    xyz = interior_map.clouds(columns)
    part = interior_map.section(xyz, SELECTION.sections["west"], "west")
    numbers = map_figure.section_table(part, columns, facts["positions"])
    scanners = dict(zip(facts["positions"], facts["scanners_m"], strict=True))
    figure = map_figure.draw_map(xyz["refined"], scanners, numbers, SELECTION, simulated=False)
    oblique, _, before, after = figure.axes  # the second is the scale of colours
    assert before.get_ylim() == after.get_ylim()
    assert before.get_xlim() == after.get_xlim()
    assert before.get_title(loc="left") != after.get_title(loc="left")
    assert oblique.get_aspect() == 1.0
    assert oblique.get_xlabel() == "X [m]"


def test_the_nearer_point_hides_the_farther():
    # The first two fall on one place of the picture: a metre up is half a metre back.
    xyz = np.array([[1.0, 2.0, 1.0], [1.0, 2.5, 0.0], [3.0, 4.0, 0.0]])
    colours = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]], np.uint8)
    for order in ([0, 1, 2], [2, 1, 0]):
        picture, (left, right, bottom, top) = map_figure.raster(xyz[order], colours[order])
        assert picture[..., 3].astype(bool).sum() == 8
        assert not picture[..., 1].any()
        row, column = np.argwhere(picture[..., 0])[0]
        height, width = picture.shape[:2]
        np.testing.assert_allclose(left + column * (right - left) / width, 1.0, atol=0.013)
        np.testing.assert_allclose(bottom + row * (top - bottom) / height, 2.5, atol=0.013)


def test_the_study_maps_what_its_building_has():
    config = read_yaml(ROOT / "config/config.yaml")["figures"]["28"]
    width, depth = WORLD.building.size_m
    assert config["scanner"] == WORLD.building.scanner
    for box in config["sections"].values():
        assert -0.3 <= min(box["x_m"]) < max(box["x_m"]) <= width + 0.3
        assert -0.3 <= min(box["y_m"]) < max(box["y_m"]) <= depth + 0.3
