"""Panels outdoors: planes through fog and people, before and after, and what goes wrong."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support.chain import study_world
from support.world import changed, without_errors

from velocal.errors import ConfigError, SurveyError, VelocalError
from velocal.evaluation.candidates import with_sets
from velocal.evaluation.panels import Panels, fit_panels, panel_rows
from velocal.evaluation.planes_in_data import Cloud, PlaneLimits
from velocal.paper import outdoor
from velocal.recording.recording import open_recording
from velocal.reporting.figures import panels as panels_figure
from velocal.reporting.style import save
from velocal.scanner.beam import Beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.simulation import capture, truth
from velocal.simulation.outdoor import Person, outdoor_scene
from velocal.study.planes import Panel, PanelFit

SCANNER = "HDL-32E"
BOXES = {
    "left": Panel(across_m=(-1.8, -0.2), up_m=(-1.3, 1.4)),
    "right": Panel(across_m=(0.2, 1.8), up_m=(-1.3, 1.4)),
}
FIT = {"depth_m": 0.6, "min_points": 100, "min_lasers": 3, "incidence_deg": 70}
ROTATIONS = 3


def seen(world, folder, scene="real1", scanner=SCANNER) -> Cloud:
    """Cloud of a recording that went through its bytes, with the factory's parameters."""
    around = outdoor_scene(world, scanner, scene, ROTATIONS / 10.0)
    path = folder / "recording.bin"
    path.write_bytes(b"".join(capture.records(world, scanner, around, "x", ROTATIONS)))
    beams = open_recording(path, scanner).returns("all").beams()
    return Cloud.from_beams(beams, truth.factory_parameters(world, scanner))


def fitted(cloud, distance_m=10.0, **fit):
    wanted = PanelFit(**(FIT | fit))
    panels = Panels(distance_m, np.deg2rad(8.0), BOXES, wanted.depth_m)
    return fit_panels(cloud, panels, PlaneLimits.from_fit(wanted), "sample 'x'")


@pytest.mark.parametrize("distance_m", [0.7, 3.0, 10.0])
@pytest.mark.parametrize("name", ["HDL-64E", "HDL-32E"])
def test_no_return_in_a_box_is_left_out_by_its_azimuth(name, distance_m):
    """Also with panels so near that the offsets of the lasers from the axis matter."""
    rng, n = np.random.default_rng(3), 100_000
    design = nominal(SCANNERS[name])
    alpha, hoff = rng.normal(0.0, 0.05, len(design)), rng.normal(0.0, 0.04, len(design))
    factory = design.corrected({"alpha": alpha, "hoff": hoff})
    distance, phi = rng.uniform(0.1, 15.0, n), rng.uniform(0.0, 8.0, n)
    every = Beams(distance, phi, rng.integers(0, len(design), n), 0.002)
    place = Panels(distance_m, np.deg2rad(8.0), BOXES, 0.6)
    some = place.possible(every, factory)
    assert len(some) < (0.4 if distance_m > 1.0 else 1.1) * n
    clouds = [Cloud.from_beams(beams, factory) for beams in (every, some)]
    for panel in BOXES:
        inside = [cloud.phi[place.rows(cloud.xyz, panel)] for cloud in clouds]
        assert len(inside[0]) > 50
        np.testing.assert_array_equal(*inside)


def with_kind(world, **changes):
    """The world with another fog, or other people, in its real scenes."""
    return changed(world, {f"outdoor/kinds/real/{name}": part for name, part in changes.items()})


CLEAR = {
    "fog": {"lost_per_m": 0.0, "early_per_m": 0.0, "noise": 0.0},
    "people": {"count": 0, "radius_m": 0.25, "height_m": 1.75, "speed_m_s": 1.3},
}


def test_true_parameters_see_flat_panels_through_fog_and_people(tmp_path):
    world = without_errors(study_world())
    thick = {
        "fog": {"lost_per_m": 0.02, "early_per_m": 0.02, "noise": 0.0},
        "people": {"count": 6, "radius_m": 0.25, "height_m": 1.75, "speed_m_s": 3.0},
    }
    true = truth.unit_truth(world, SCANNER).parameters
    points = {}
    for name, changes in (("clear", CLEAR), ("thick", thick)):
        cloud = seen(with_kind(world, **changes), tmp_path)
        planes = fitted(cloud)
        rows = panel_rows(cloud, planes, with_sets(cloud.parameters, {"true": true}))
        points[name] = sum(row["points"] for row in rows)
        for row in rows:
            # Ticks, and a relief of 1 mm on average, are all that is left with the truth.
            low, high = (0.02, 0.25) if row["parameter_set"] == "true" else (0.5, 4.0)
            assert low < row["rms_cm"] < high, (name, row)
            assert row["lasers"] >= 8
            assert row["distance_m"] == pytest.approx(10.1, abs=0.3)
    assert 0.1 < points["thick"] / points["clear"] < 0.8


def test_returns_of_fog_and_people_are_there_and_left_out(tmp_path):
    world = without_errors(study_world())
    clear, thick = (
        seen(with_kind(world, **changes), tmp_path)
        for changes in (CLEAR, CLEAR | {"fog": CLEAR["fog"] | {"early_per_m": 0.02}})
    )
    near = [int(np.sum(np.linalg.norm(cloud.xyz, axis=1) < 2.0)) for cloud in (clear, thick)]
    assert near[1] > near[0] + 100
    rms = [np.std(plane.s) for cloud in (clear, thick) for plane in fitted(cloud)]
    assert rms[2:] == pytest.approx(rms[:2], rel=0.05)


def test_the_near_far_constant_is_what_limits_the_gain(tmp_path):
    """A set that is right at 3 m is right at 25 m only where errors do not depend on range."""
    flat = with_kind(without_errors(study_world()), **CLEAR)
    ratios = {}
    for scale in (0.0, 0.11):
        world = changed(flat, {"scanners/HDL-64E/errors/range_scale_cm_per_m": scale})
        true = truth.unit_truth(world, "HDL-64E")
        near = true.parameters.corrected({"dl": -3.0 * true.range_scale})
        cloud = seen(world, tmp_path, "real5", "HDL-64E")
        candidates = with_sets(cloud.parameters, {"near": near})
        rows = panel_rows(cloud, fitted(cloud, 25.0), candidates)
        rms = {row["role"]: row["rms_cm"] for row in rows if row["panel"] == "left"}
        ratios[scale] = rms["set"] / rms["factory"]
    assert ratios[0.0] < 0.2
    # In the mean over units as much comes in as is taken out; four lasers scatter about that.
    assert ratios[0.11] > max(0.4, 3.0 * ratios[0.0])


@pytest.mark.parametrize(
    ("distance_m", "fit", "message"),
    [(17.0, {}, "0 points of 0 lasers"), (10.0, {"min_lasers": 30}, "30 lasers, or more")],
)
def test_no_panel_where_it_is_said_to_be(tmp_path, distance_m, fit, message):
    cloud = seen(with_kind(study_world(), **CLEAR), tmp_path)
    with pytest.raises(SurveyError) as error:
        fitted(cloud, distance_m, **fit)
    assert message in str(error.value)
    assert f"panel 'left' at {distance_m:g} m, 8 deg" in str(error.value)
    assert "Hint: Look at the sample's distance_m" in str(error.value)


def test_a_scene_that_is_not_there():
    with pytest.raises(ConfigError, match="no scene 'real99'") as error:
        outdoor_scene(study_world(), SCANNER, "real99", 1.0)
    assert "ideal1" in str(error.value)
    with pytest.raises(ConfigError, match="the world has no `outdoor`"):
        outdoor_scene(changed(study_world(), {"outdoor": None}), SCANNER, "real1", 1.0)


def test_a_person_is_met_in_front():
    person = Person(np.array([0.0, 5.0]), np.array([1.0, 0.0]), 0.25, -1.5, 0.25)
    time, azimuth = np.zeros(3), np.array([0.0, np.pi, 0.2])
    np.testing.assert_allclose(person.range(time, azimuth), [4.75, np.inf, np.inf])
    # A second later the person has walked a metre to the right.
    later = person.range(np.ones(1), np.array([np.arctan2(1.0, 5.0)]))
    np.testing.assert_allclose(later, [np.hypot(1.0, 5.0) - 0.25])


def rows_of(sample, factory, kind="ideal", scanner="HDL-64E", **sets):
    heading = {"kind": kind, "scanner": scanner, "sample": sample}
    candidates = [("factory", "", factory), *(("set", name, rms) for name, rms in sets.items())]
    return [
        heading
        | {"panel": panel, "role": role, "parameter_set": name, "distance_m": 10.0,
           "incidence_deg": 5.0, "points": 500, "trimmed": 3, "lasers": lasers,
           "rms_cm": value + more, "pooled_rms_cm": value}
        for panel, lasers, more in (("left", 9, -0.1), ("right", 8, 0.1))
        for role, name, value in candidates
    ]  # fmt: skip


def summarised(rows):
    return outdoor.summarise(pd.DataFrame(rows))


@pytest.mark.parametrize("best", ["set1", "before", "after", "window"])
def test_summary_means_and_the_best_set(best):
    rows = rows_of("a", 3.0, **{best: 2.0, "set2": 1.0})
    rows += rows_of("b", 2.0, **{best: 1.0, "set2": 3.0})
    rows += rows_of("c", 1.3, "real", "HDL-32E", set1=1.1)
    samples, means = summarised(rows)
    assert list(samples["sample"]) == ["a"] * 3 + ["b"] * 3 + ["c"] * 2
    assert list(samples["shown"]) == ["before", "after", ""] * 2 + ["before", "after"]
    assert set(samples["points"]) == {1000}
    assert set(samples["lasers"]) == {8}
    shown = means[means["shown"] == "after"]
    assert list(shown["parameter_set"]) == [best, "set1"]
    assert list(shown["samples"]) == [2, 1]
    facts = {row["item"]: row["value"] for row in outdoor.facts(means)}
    assert facts == pytest.approx(
        {
            "outdoor_ideal_before_64": 2.5,
            "outdoor_ideal_after_64": 1.5,
            "outdoor_real_before_32": 1.3,
            "outdoor_real_after_32": 1.1,
        }
    )
    side_by_side = outdoor.before_and_after(means, ["kind", "scanner"])
    assert side_by_side["before_cm"].tolist() == pytest.approx([2.5, 1.3])
    assert side_by_side["after_cm"].tolist() == pytest.approx([1.5, 1.1])
    assert side_by_side["parameter_set"].tolist() == [best, "set1"]
    with pytest.raises(VelocalError, match="rows per parameter set"):
        summarised(rows + rows_of("d", 2.0, **{best: 1.0}))
    with pytest.raises(VelocalError, match="no parameter set"):
        summarised(rows_of("d", 2.0))


def test_figures_have_one_scale_and_the_same_bytes(tmp_path):
    rows = rows_of("a", 3.0, set1=2.0) + rows_of("c", 5.0, "real", "HDL-32E", set1=1.0, set2=9.0)
    samples, _ = summarised(rows)
    top = panels_figure.top_cm(samples, 2.0)
    assert top == pytest.approx(5.4)
    written = []
    for name in ("one", "two"):
        numbers = panels_figure.numbers(samples, "ideal", "HDL-64E")
        figure = panels_figure.draw(
            numbers, "ideal", "HDL-64E", top_cm=top, sigma_cm=2.0, simulated=True
        )
        assert figure.axes[0].get_ylim()[1] == pytest.approx(5.4)
        save(figure, tmp_path / f"{name}.svg", tmp_path / f"{name}.png")
        written.append((tmp_path / f"{name}.svg").read_bytes())
    assert written[0] == written[1]


@pytest.mark.parametrize("scanner", ["HDL-32E", "VLP-32C"])
def test_fog_and_people_have_the_tick_of_the_scanner(scanner):
    """A VLP-32C sends distances in ticks of 4 mm."""
    world = with_kind(study_world(), **CLEAR)
    world = changed(world, {"scanners": {scanner: world.plain()["scanners"]["HDL-32E"]}})
    air = outdoor_scene(world, scanner, "real1", 1.0).between
    n, tick = 200, SCANNERS[scanner].distance_tick_m
    wall = np.full((n, SCANNERS[scanner].n_lasers), 10.0 / tick, dtype=np.float32)
    person = Person(np.array([0.0, 5.0]), np.zeros(2), 0.25, -3.0, 3.0)
    crossed = replace(air, people=[person])(
        np.random.default_rng(0), np.zeros(n), np.zeros(n), wall
    )
    level = int(np.argmin(np.abs(air.truth.parameters.v)))
    parameters = air.truth.parameters
    flat = person.range(np.zeros(1), -parameters.alpha[level : level + 1])[0]
    expected = flat / np.cos(parameters.v[level]) - parameters.dl[level]
    assert 4.7 < flat < 4.9
    assert crossed[0, level] * tick == pytest.approx(expected, abs=0.03)
    fog = replace(air, lost_per_m=0.1)(np.random.default_rng(0), np.zeros(n), np.zeros(n), wall)
    assert np.isnan(fog).mean() == pytest.approx(1.0 - np.exp(-1.0), abs=0.03)
