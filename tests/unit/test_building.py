"""The simulated building: what beams meet, and recordings of scenes other than the field."""

from pathlib import Path

import numpy as np
import pytest
from support.building import CONTENT, ROOM, WORLD
from support.world import changed

from velocal.errors import ConfigError
from velocal.simulation import building, capture
from velocal.simulation.scene import cast
from velocal.study.model import validated
from velocal.study.world import WorldFile

ROOT = Path(__file__).resolve().parents[2]
SMALL = changed(WORLD, {"building": ROOM})


def ranges(origin, *directions, of=SMALL):
    """Range and surface of beams from a place of the room."""
    faces = building.surfaces(of)
    unit = np.array(directions, dtype=float)
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    length, index = cast(faces, np.tile(np.array(origin, dtype=float), (len(unit), 1)), unit)
    return length, [[*faces][i] if i >= 0 else None for i in index]


def test_beams_meet_walls_floor_and_ceiling():
    length, name = ranges((2, 1.5, 1), (-1, 0, 0), (0, -1, 0), (0, 0, -1), (0, 0, 1))
    np.testing.assert_allclose(length, [2.0, 1.5, 1.0, 1.5])
    assert name == ["west back", "south back", "floor", "ceiling"]


def test_beams_pass_doors_and_windows_and_meet_their_reveals():
    length, name = ranges(
        (2, 1.5, 1), (1, 0, 0), (1, 0, 0.6), (0, 1, 0), (0, 1.55, -0.2), (2.1, -0.5, 0)
    )
    assert name == [None, "east front", None, "north sill 1", "east left 1"]
    assert np.isinf(length[[0, 2]]).all()
    np.testing.assert_allclose(length[1], np.hypot(2.0, 1.2))
    np.testing.assert_allclose(length[3], np.hypot(1.55, 0.2))
    np.testing.assert_allclose(length[4], np.hypot(2.1, 0.5))


def test_pillars_hide_what_is_behind():
    length, name = ranges((2, 0.5, 1), (-1, 0, 0))
    assert name == ["pillar end"]
    np.testing.assert_allclose(length, 0.8)


@pytest.mark.parametrize("position", WORLD.building.positions)
def test_faces_left_out_of_a_scene_are_not_seen_from_there(position):
    scene = building.scene(WORLD, position)
    everything = building.surfaces(WORLD)
    assert len(scene.surfaces) < len(everything)
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(4000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    origin = scene.pose.translation + rng.uniform(-0.05, 0.05, direction.shape)
    seen, _ = cast(scene.surfaces, origin, direction)
    expected, _ = cast(everything, origin, direction)
    np.testing.assert_array_equal(seen, expected)
    assert len(scene.reflectance) == len(scene.surfaces)


def test_floor_reflects_less_than_walls():
    scene = building.scene(SMALL, "A")
    named = dict(zip(scene.surfaces, scene.reflectance, strict=True))
    assert named["floor"] == 30
    assert named["west back"] == 60


def test_base_targets_stand_at_every_position():
    groups = building.base_targets(WORLD)
    assert [part.group[0] for part in groups] == list(WORLD.building.positions)
    for part, where in zip(groups, WORLD.building.positions.values(), strict=True):
        centre = part.xyz.mean(axis=0) - [where.x_m, where.y_m, where.z_m]
        assert np.abs(centre).max() < 0.05


def test_a_short_recording_is_that_of_all_azimuths():
    boxes = {name: ROOM["boxes"][name] for name in ("west", "south")}
    corner = changed(WORLD, {"building": {**ROOM, "scanner": "HDL-32E", "boxes": boxes}})
    scene = building.scene(corner, "A")
    short = b"".join(capture.records(corner, "HDL-32E", scene, "A", 1))
    shots = capture.shots_at(corner, "HDL-32E", scene)
    assert b"".join(capture.records(corner, "HDL-32E", scene, "A", 1, shots=shots)) == short


def test_errors_name_what_there_is():
    with pytest.raises(ConfigError, match=r"no position 'B'.*A"):
        building.scene(SMALL, "B")
    with pytest.raises(ConfigError, match="no building"):
        building.scene(changed(WORLD, {"building": None}), "A")


def test_schema_knows_the_building():
    validated(WorldFile, {**CONTENT, "building": ROOM}, "world")
    with pytest.raises(ConfigError, match=r"unknown key 'building\.floors'"):
        validated(WorldFile, {**CONTENT, "building": {**ROOM, "floors": 2}}, "world")
