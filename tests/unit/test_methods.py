"""Methods of adjustment side by side: every method runs, joint planes, table, figure and files."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from compare_methods import main
from support.corner import FACTORY, TRUE, N, position
from support.station import write_station

from velocal.adjustment.joint import adjust_joint
from velocal.adjustment.observations import Observations, joined
from velocal.adjustment.stochastic import Stochastic, SurveyUncertainty
from velocal.adjustment.unit.station import UnitStation
from velocal.errors import VelocalError
from velocal.evaluation import linear_parameters, methods
from velocal.geometry.planes import Patch, Plane
from velocal.io import schemas, storage
from velocal.reporting.figures import methods as comparison
from velocal.scanner.beam import laser_beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import PARAMETERS
from velocal.study.adjustment import Adjustment

PRIOR = {"dl": 0.02, "alpha": 0.0035, "v": 0.0035, "scale": 1e-3}
STOCHASTIC = Stochastic(noise_std_m=0.01, prior_std=PRIOR)
NAMES = ("short", "long", "floor")


def surveyed(sample):
    """The sample with a survey that is accurate to 0.1 mm and 0.1 mrad."""
    uncertainty = SurveyUncertainty(
        translation=np.zeros(3),
        pose=np.eye(6) * 1e-8,
        planes=np.tile(np.eye(4) * 1e-8, (3, 1, 1)),
        flatness_m=np.zeros(3),
    )
    station = UnitStation(sample.position, sample.windows[0], uncertainty, NAMES)
    return replace(sample, station=station)


def samples(noise, count=1):
    rng = np.random.default_rng(8)

    def noisy(data):
        return replace(data, distance_m=data.distance_m + rng.normal(0.0, noise, len(data.phi)))

    first, second = position(0.4, (2.0, 3.0, 0.8)), position(-0.5, (3.5, 1.5, 0.8), 0.006)
    return tuple(
        [methods.SampleData(name, [noisy(data) for _ in range(2)]) for _ in range(count)]
        for name, data in (("P2", first), ("P1", second))
    )


@pytest.mark.parametrize("method", methods.METHODS, ids=lambda method: method.key)
def test_every_arm_runs(method):
    calibration, other = (list(map(surveyed, each)) for each in samples(0.003, 2))
    estimate = methods.run_method(method, calibration, other, FACTORY, STOCHASTIC)
    row = methods.evaluate(method, estimate, calibration, other, 0.02, TRUE)
    before = methods.evaluate(method, methods.Estimate(FACTORY), calibration, other, 0.02, TRUE)
    assert row["other_seen"] == method.joint
    if method.key != "factory":
        assert row["calibration_walls_rms_cm"] < before["calibration_walls_rms_cm"]
    if method.key in ("dl", "prior", "huber", "unit", "prior_joint", "planes_unknown"):
        assert row["other_rms_cm"] < 0.8 * before["other_rms_cm"]
        assert row["dl_error_cm"] < 0.5 * before["dl_error_cm"]
    untouched = {"alpha", "v"} - set(method.parameters)
    for name in untouched:
        assert np.array_equal(getattr(estimate.parameters, name), getattr(FACTORY, name))
    # Numbers without truth are the same, and no more.
    blind = methods.evaluate(method, estimate, calibration, other, 0.02)
    assert blind.items() <= row.items()
    assert not any("error" in name for name in blind)


def test_windows_of_joint_samples_must_match():
    calibration, other = samples(0.003)
    method = next(method for method in methods.METHODS if method.key == "prior_joint")
    short = [replace(other[0], windows=other[0].windows[:1])]
    with pytest.raises(VelocalError, match="windows per sample"):
        methods.run_method(method, calibration, short, FACTORY, STOCHASTIC)


def tilted(normal, distance):
    """A wall seen all around by all lasers, as far as it lies ahead."""
    unit = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    centre = np.arctan2(unit[0], unit[1])
    angle = np.tile(np.linspace(centre - 1.0, centre + 1.0, 80), N)
    laser = np.repeat(np.arange(N), 80)
    return angle, laser, np.tile(unit, (len(angle), 1)), np.full(len(angle), -float(distance))


def free_field(scale):
    """Planes of many directions and distances, so that v and scale part ways."""
    planes = [
        ((0, 1, 0.5), 3), ((1, 0.3, 0), 5), ((-1, 0.2, -0.6), 4), ((0.3, -1, 0.3), 8),
        ((0.2, 1, -0.7), 2), ((-0.6, -1, 0), 2.5),
    ]  # fmt: skip
    parts = []
    for number, plane in enumerate(planes):
        angle, laser, normal, offset = tilted(*plane)
        empty = Observations(np.zeros(len(angle)), angle, laser, normal, offset)
        distance = -empty.misclosure(TRUE) / (1.0 + scale[laser])
        parts.append(replace(empty, distance_m=distance, plane=np.full(len(angle), number)))
    return joined(parts)


def test_unknown_planes_and_lasers_come_back_up_to_the_datum():
    scale = np.random.default_rng(9).normal(0.0, 1e-3, N)
    scale -= scale.mean()
    true = free_field(scale)
    group = true.station_number
    # The planes start turned and moved; only the observations know where they are.
    start = true.normal + np.array([0.01, -0.008, 0.006])
    wrong = replace(
        true, normal=start / np.linalg.norm(start, axis=1)[:, None], offset=true.offset + 0.02
    )
    names = ("dl", "alpha", "v", "scale")
    tight = replace(STOCHASTIC, noise_std_m=1e-6)
    result = adjust_joint(wrong, group, FACTORY, names, tight)
    assert result.converged
    assert result.rank == result.unknowns == 4 * N + 3 * 6
    for column, expected in enumerate(
        (*(getattr(TRUE, n) - getattr(FACTORY, n) for n in names[:3]), scale)
    ):
        np.testing.assert_allclose(result.corrections[:, column], expected, atol=1e-8)
    first = np.unique(group, return_index=True)[1]
    np.testing.assert_allclose(result.normal, true.normal[first], atol=1e-8)
    np.testing.assert_allclose(result.offset, true.offset[first], atol=1e-7)


def test_a_common_turn_is_the_datum():
    turned = free_field(np.zeros(N))
    turned = replace(turned, phi=turned.phi + 0.01)
    tight = replace(STOCHASTIC, noise_std_m=1e-6)
    result = adjust_joint(turned, turned.station_number, FACTORY, ("dl", "alpha", "v"), tight)
    # All planes turn; the mean of alpha stays.
    np.testing.assert_allclose(result.corrections[:, 1], TRUE.alpha - FACTORY.alpha, atol=1e-8)
    np.testing.assert_allclose(
        np.arctan2(result.normal[0, 0], result.normal[0, 1]), 0.01, atol=1e-8
    )


def test_vertical_walls_alone_hold_what_they_cannot_tell():
    calibration, _ = samples(0.003)
    data = calibration[0].windows[0]
    walls = data.take(data.plane_number < 2)
    names = ("dl", "alpha", "v", "scale")
    result = adjust_joint(walls, walls.plane_number, FACTORY, names, STOCHASTIC)
    assert result.rank < result.unknowns
    assert np.max(np.abs(result.corrections[:, 2])) < 0.02
    with pytest.raises(VelocalError, match="no observations"):
        adjust_joint(
            walls.take(walls.plane_number > 5), np.empty(0, int), FACTORY, names, STOCHASTIC
        )


def test_a_laser_without_observations_stays_out_of_the_datum():
    true = free_field(np.zeros(N))
    data = true.take(true.laser_id != 2)
    names = ("dl", "alpha", "v", "scale")
    result = adjust_joint(data, data.station_number, FACTORY, names, STOCHASTIC)
    assert (result.corrections[2] == 0.0).all()
    seen = np.arange(N) != 2
    for column in (1, 3):
        np.testing.assert_allclose(result.corrections[seen, column].mean(), 0.0, atol=1e-9)


def test_weights_that_move_with_the_lasers_do_not_stop_the_joint_adjustment():
    """Angles make weights depend on the parameters: sums of other weights do not compare."""
    windows = [samples(0.02)[kind][0].windows[0] for kind in (0, 1)]
    data = joined(windows)
    group = np.unique(data.station_number * 3 + data.plane_number, return_inverse=True)[1]
    names = ("dl", "alpha", "v", "scale")
    angled = replace(STOCHASTIC, angle_std_rad=0.01, noise_std_m=0.002)
    result = adjust_joint(data, group, FACTORY, names, angled)
    assert result.converged
    assert result.iterations <= 10


@pytest.fixture(scope="module")
def numbers():
    calibration, other = (list(map(surveyed, each)) for each in samples(0.003))
    return pd.DataFrame(methods.compare(calibration, other, FACTORY, STOCHASTIC, 0.02, TRUE))


def test_table_and_verdict(numbers):
    text = comparison.markdown(numbers, "HDL-64E", simulated=True)
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len(lines) == 2 + len(methods.METHODS)
    assert len({line.count("|") for line in lines}) == 1
    assert "simulated" in text
    joint = next(line for line in lines if "positions jointly" in line)
    assert len(re.findall(r"\d\*", joint)) == 3
    worse = numbers.copy()
    worse.loc[worse["method"] == methods.DEFAULT, "other_walls_rms_cm"] *= 9.0
    assert "NOT better there" in comparison.verdict(worse)[0]
    blind = numbers.drop(columns=[*numbers.filter(like="error"), "v_far_off"])
    assert len(comparison.verdict(blind)) == 1
    assert (
        "Error" not in comparison.markdown(blind, "HDL-64E", simulated=False).split("Standard")[0]
    )
    assert len(comparison.draw(blind, "HDL-64E", simulated=False).axes) == 2
    assert comparison.section(None) is None


def test_figure_writes_what_is_too_far_to_draw(numbers):
    far = numbers.copy()
    far.loc[far["method"] == "paper", "other_rms_cm"] = 1234.0
    figure = comparison.draw(far, "HDL-64E", simulated=True)
    assert len(figure.axes) == 5
    assert any("1234" in text.get_text() for text in figure.axes[1].texts)
    assert figure.axes[1].get_xlim()[1] < 100.0


def test_script_writes_the_same_bytes_twice(tmp_path):
    assigned = []
    scanner = SCANNERS["VLP-16"]
    for name, data in (("a", position(0.4, (2.0, 3.0, 0.8))), ("b", position(0.0, (3, 2, 0.8)))):
        path = tmp_path / name / "middle.parquet"
        path.parent.mkdir()
        columns = {
            "laser_id": data.laser_id.astype(np.uint8), "plane": data.plane.astype(np.uint8),
            "phi_rad": data.phi, "distance_m": data.distance_m,
        }  # fmt: skip
        storage.write_table(path, schemas.ASSIGNED, columns)
        assigned.append(path)
        first = np.unique(data.plane, return_index=True)[1]
        patches = [
            Patch(
                NAMES[k],
                Plane(data.normal[row], float(data.offset[row]), np.zeros((4, 4))),
                np.zeros((4, 3)),
            )
            for k, row in enumerate(first)
        ]
        write_station(tmp_path / f"{name.upper()}.json", name.upper(), scanner.name, patches)
    adjustment = Adjustment.model_validate(
        {"method": "prior", "parameters": ["dl", "alpha", "v"], "noise_cm": 1.0,
         "prior": {"dl_cm": 2.0, "alpha_deg": 0.2, "v_deg": 0.2}}
    )  # fmt: skip
    seen = []
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        outputs = {k: tmp_path / folder / f"comparison.{k}" for k in ("csv", "md", "svg", "png")}
        main(
            assigned=assigned,
            surveys=[tmp_path / "A.json", tmp_path / "B.json"],
            calibration=None,
            truth=None,
            **outputs,
            samples=["a", "b"],
            positions=["A", "B"],
            calibrate_on=["a"],
            check_on=["b"],
            scanner=scanner.name,
            adjustment=adjustment,
            sigma_cm=2.0,
            simulated=False,
        )
        seen.append([path.read_bytes() for path in outputs.values()])
    assert seen[0] == seen[1]
    table = storage.read_csv(tmp_path / "one/comparison.csv")
    assert list(table["method"]) == [method.key for method in methods.METHODS]
    assert "v_error_deg" not in table


def test_linear_parameters_are_the_beam_parameters_written_otherwise():
    scale = np.random.default_rng(4).normal(0.0, 1e-3, N)
    parameters, found = linear_parameters.to_beam(linear_parameters.from_beam(TRUE, scale))
    np.testing.assert_allclose(found, scale, atol=1e-12)
    for name in PARAMETERS:
        np.testing.assert_allclose(getattr(parameters, name), getattr(TRUE, name), atol=1e-12)
    # A point is linear in them: that of the beam model at any angle and distance.
    phi, distance = np.full(N, 1.2), np.full(N, 3.4)
    laser = np.arange(N)
    direction, origin = laser_beams(phi, laser, TRUE)
    expected = (distance * (1.0 + scale) + TRUE.dl)[:, None] * direction + origin
    a, b, c, e, f, g = linear_parameters.from_beam(TRUE, scale).T
    p, q = a * distance + e, b * distance + f
    sine, cosine = np.sin(phi), np.cos(phi)
    point = np.stack([p * sine + q * cosine, p * cosine - q * sine, c * distance + g], axis=1)
    np.testing.assert_allclose(point, expected, atol=1e-12)


def test_one_linear_step_finds_what_planes_of_many_directions_determine():
    scale = np.random.default_rng(9).normal(0.0, 1e-3, N)
    tight = replace(STOCHASTIC, noise_std_m=1e-9)
    found = linear_parameters.adjust(free_field(scale), FACTORY, tight)
    expected = [getattr(TRUE, name) - getattr(FACTORY, name) for name in PARAMETERS]
    np.testing.assert_allclose(found, np.stack([*expected, scale], axis=1), atol=1e-8)
    # Three planes do not determine all: with the noise of the data the rest stays.
    calibration, _ = samples(0.003)
    few = linear_parameters.adjust(calibration[0].windows[0], FACTORY, STOCHASTIC)
    assert np.max(np.abs(few[:, 2])) < 0.01


def test_a_method_starts_where_it_says():
    calibration, other = samples(0.003)
    method = next(method for method in methods.METHODS if method.key == "nominal")
    design = FACTORY.corrected({"dl": np.full(N, -0.1), "v": np.full(N, 0.002)})
    weak = replace(STOCHASTIC, noise_std_m=1e3)
    stays = methods.run_method(method, calibration, other, FACTORY, weak, design)
    np.testing.assert_allclose(stays.parameters.dl, design.dl, atol=1e-6)
    found = methods.run_method(method, calibration, other, FACTORY, STOCHASTIC, design)
    assert np.sqrt(np.mean((found.parameters.dl - TRUE.dl) ** 2)) < 0.01
