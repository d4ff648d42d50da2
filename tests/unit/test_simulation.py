"""The simulated world: what leaves it is what a scanner would send."""

import struct

import numpy as np
import pytest
from support.chain import study_world
from support.world import changed, without_errors

from velocal.errors import ConfigError
from velocal.packets.data import view
from velocal.recording.identify import candidates
from velocal.recording.scan import inspect
from velocal.simulation import capture, survey, truth
from velocal.simulation.scene import cast, site_surfaces


def recording(world, scanner="HDL-32E", position="P5", sample="x", rotations=3):
    return b"".join(capture.records(world, scanner, position, sample, rotations))


@pytest.mark.parametrize(("scanner", "position"), [("HDL-64E", "P2"), ("HDL-32E", "P5")])
def test_records_are_those_of_the_scanner(tmp_path, scanner, position):
    path = tmp_path / "x.bin"
    path.write_bytes(recording(study_world(), scanner, position))
    found = inspect(path)
    assert found.ledger.unaccounted_bytes == 0
    assert not found.ledger.rejected
    assert found.index.complete.sum() >= 3
    assert candidates(found)[0].name == scanner
    assert found.azimuth_multiple == (9 if scanner == "HDL-64E" else 1)
    assert found.index.rate_hz() == pytest.approx(10.0, rel=0.01)


def test_network_headers_are_valid():
    record = recording(study_world())[:1248]
    assert record[12:14] == b"\x08\x00"
    words = struct.unpack(">10H", record[14:34])
    total = sum(words)
    assert (total & 0xFFFF) + (total >> 16) == 0xFFFF
    assert struct.unpack(">H", record[16:18])[0] == 1234
    assert struct.unpack(">HHH", record[34:40]) == (2368, 2368, 1214)


def test_one_seed_one_recording_and_streams_of_their_own():
    world = study_world()
    assert recording(world) == recording(world)
    assert recording(world) != recording(world, sample="y")
    assert recording(world) != recording(changed(world, {"seed": 1}))
    more = changed(world, {"positions/P9": world.plain()["positions"]["P5"]})
    assert recording(world) == recording(more)


@pytest.mark.parametrize("rotations", [36, 330, 3000])
def test_windows_have_the_times_of_the_experiment(rotations):
    """Beginning, middle and end are the first, middle and last 10 s of five minutes."""
    world, length_s = study_world(), rotations / 10.0
    window_s = min(10.0, length_s / 3.0)
    within = np.linspace(0.0, window_s, 50, endpoint=False)
    for start, expected in (
        (0.0, 0.0),
        ((length_s - window_s) / 2.0, 145.0),
        (length_s - window_s, 290.0),
    ):
        times = world.represented_s(start + within, length_s)
        np.testing.assert_allclose(times, expected + 10.0 * within / window_s, atol=1e-9)


@pytest.mark.parametrize("length_s", [300.0, 420.0])
def test_a_recording_of_the_full_length_represents_itself(length_s):
    times = np.linspace(0.0, length_s, 100, endpoint=False)
    np.testing.assert_allclose(study_world().represented_s(times, length_s), times)


def test_distances_and_status_bytes_follow_the_temperature():
    """One centimetre per kelvin: packets of a third differ by the temperature of their part."""
    cold = changed(
        without_errors(study_world()),
        {
            "warmth/time_constant_s": 60.0,
            "warmth/samples": {"x": {"halogen": False, "start_k": 20.0}},
        },
    )
    warm = changed(cold, {"scanners/HDL-64E/errors/thermal_cm_per_k": 1.0})
    raw, status = [], []
    for world in (cold, warm):
        content = np.frombuffer(recording(world, "HDL-64E", "P2", rotations=2), dtype=np.uint8)
        packets = view(content.reshape(-1, 1248)[:, 42:].copy())
        raw.append(packets["blocks"]["channels"]["distance"].astype(float))
        status.append(packets["status"])
    both = (raw[0] > 0) & (raw[1] > 0)
    thirds = np.array_split(np.arange(len(both)), 3)
    found = [np.mean((raw[1] - raw[0])[part][both[part]]) * 0.2 for part in thirds]
    # Means of 20 K exp(-t / 60 s) over 0 to 10, 145 to 155 and 290 to 300 s.
    assert found == pytest.approx([18.42, 1.64, 0.15], abs=0.05)
    temperature = status[1][status[1][:, 0] == ord("T"), 1]
    assert temperature.max() == 46 + 20
    assert temperature.min() == 46


def test_windows_longer_than_the_experiment_are_refused():
    with pytest.raises(ConfigError, match="three windows of 101 s are longer than 300 s"):
        changed(study_world(), {"warmth/window_s": 101})


def test_distances_are_those_of_the_scene():
    """Without errors a raw distance is the range to the scene, less the correction, in ticks."""
    world = without_errors(study_world())
    packets = view(
        np.frombuffer(recording(world), dtype=np.uint8).reshape(-1, 1248)[:, 42:].copy()
    )[:200]
    azimuth = packets["blocks"]["azimuth"].reshape(-1)
    raw = packets["blocks"]["channels"]["distance"].reshape(-1, 32)
    true, pose = truth.unit_truth(world, "HDL-32E").parameters, world.pose("P5")
    surfaces = site_surfaces(world)
    for laser in (0, 9, 31):
        theta = np.deg2rad(azimuth / 100) + 2 * np.pi * 10 * 1.152e-6 * laser - true.alpha[laser]
        v = true.v[laser]
        u = np.column_stack(
            [np.cos(v) * np.sin(theta), np.cos(v) * np.cos(theta), np.full(len(theta), np.sin(v))]
        )
        origin = pose.translation + pose.rotation @ np.array([0.0, 0.0, true.voff[laser]])
        length, _ = cast(surfaces, np.tile(origin, (len(u), 1)), u @ pose.rotation.T)
        expected = (length - true.dl[laser]) / 0.002
        seen = raw[:, laser] > 0
        assert seen.mean() > 0.99
        difference = np.abs(raw[:, laser] - expected)[seen]
        # Half a tick of rounding; the true angle is good to 0.005 deg, edges of walls apart.
        assert np.quantile(difference, 0.95) < 1.5


def test_relief_is_as_printed():
    for name in ("short_wall", "long_wall"):
        flatness = getattr(study_world().site.flatness, name)
        surface = site_surfaces(study_world())[name]
        a, b = (x.ravel() for x in np.meshgrid(*(np.linspace(0, e, 300) for e in surface.size)))
        height = surface.relief(a, b) * 1e3
        plane = np.column_stack([np.ones_like(a), a, b])
        height = np.abs(height - plane @ np.linalg.lstsq(plane, height)[0])
        # The bump that reaches the largest deviation moves the best plane itself a little.
        assert height.max() == pytest.approx(flatness.max_mm, rel=0.1)
        assert height.mean() == pytest.approx(flatness.mean_mm, rel=0.15)


def test_observations_are_as_good_as_stated():
    world = study_world()
    true, noisy = (survey.field_book(world, noise=noise) for noise in (False, True))
    assert len(true.planes) == 372
    assert len(true.control.name) == 23
    for exact, measured in (
        (true.polar, noisy.polar),
        (true.images, noisy.images),
        *((part, noisy.base_polar[name]) for name, part in true.base_polar.items()),
    ):
        assert measured.target == exact.target
        error = (measured.value - exact.value) / exact.std
        error = error[np.isfinite(error)]
        assert np.std(error) == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * len(error)))
        assert abs(np.mean(error)) < 4.0 / np.sqrt(len(error))


def test_base_targets_are_intersected_not_measured():
    """The paper has directions only: no sight to a base has a distance."""
    for polar in survey.field_book(study_world()).base_polar.values():
        base = np.array([name.startswith("B") for name in polar.target])
        assert base.any()
        np.testing.assert_array_equal(np.isfinite(polar.value[:, 2]), ~base)


def test_targets_in_one_image_only_are_not_measured():
    """In this world one target of the floor is in one image only."""
    world = study_world().model_copy(update={"seed": 120})
    book = survey.field_book(world)
    names, count = np.unique(book.images.target, return_counts=True)
    assert count.min() >= 2
    assert set(book.planes) <= set(names)
    assert (
        len(book.planes) >= len(survey.true_targets(world, world.site.targets, "targets").name) - 1
    )
    assert len(survey.field_book(study_world()).planes) == len(book.planes) + 1


def test_a_new_position_changes_no_observation_of_others():
    world = study_world()
    content = world.plain()
    setups = {"P9": [[3, 3, 1], [2, 3, 1]], **content["survey"]["setups"]}
    place = content["positions"]["P5"]
    more = changed(world, {"positions/P9": place, "survey/setups": setups})
    one, other = survey.field_book(world), survey.field_book(more)
    np.testing.assert_array_equal(one.images.value, other.images.value)
    np.testing.assert_array_equal(one.polar.value, other.polar.value)
    for name, polar in one.base_polar.items():
        np.testing.assert_array_equal(polar.value, other.base_polar[name].value)


def test_unknown_scanner():
    with pytest.raises(ConfigError, match="allowed: HDL-64E, HDL-32E"):
        study_world().scanner("VLP-16")
