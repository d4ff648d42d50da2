"""`velocal plan`: expected medians, standard deviations, candidates, sketches and studies."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from typer.testing import CliRunner

from velocal.cli import app
from velocal.errors import ConfigError, SurveyError, VelocalError
from velocal.evaluation.plan_task import of_sketch
from velocal.evaluation.planner import expected_medians, judge, plan_unit
from velocal.reporting.figures.planned import draw_lasers
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal
from velocal.study.sketch import TEMPLATE, Sketch, Stand, read_sketch
from velocal.survey.planned import pose_of, sketched_survey
from velocal.survey.targets import write_targets

VLP = SCANNERS["VLP-16"]
CONTENT = yaml.safe_load(TEMPLATE)


def sketch(**changes):
    return Sketch.model_validate({**CONTENT, **changes})


def task(**changes):
    """What is planned; a tenth of the azimuths and the most probable sizes, for speed."""
    found = of_sketch(sketch(**changes), Path())
    settings = replace(found.instrument.settings, integration_points=1)
    instrument = replace(found.instrument, settings=settings, bin_ticks=180)
    return replace(found, instrument=instrument)


def plan(*args, **options):
    done = CliRunner().invoke(app, ["plan", *map(str, args)], env={"COLUMNS": "200"}, **options)
    if isinstance(done.exception, VelocalError):
        raise done.exception
    return done


def test_origin_and_axes_of_a_stand():
    stand = Stand(x_m=1.0, y_m=2.0, height_m=0.5, heading_deg=90.0)
    pose = pose_of(stand, VLP)
    assert np.allclose(pose.translation, [1.0, 2.0, 0.5 + VLP.origin_height_m])
    assert np.allclose(pose.rotation @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])  # Y axis points to X
    leaning = pose_of(stand.model_copy(update={"tilt_deg": 30.0, "towards_deg": 90.0}), VLP)
    assert np.allclose(leaning.rotation[:, 2], [0.5, 0.0, np.sqrt(0.75)])  # its top leans to X


def test_beams_end_at_the_first_plane():
    walls = {
        "near": {"from_m": [-5.0, 3.0], "to_m": [5.0, 3.0], "top_m": 4.0},
        "behind": {"from_m": [-50.0, 6.0], "to_m": [50.0, 6.0], "top_m": 4.0},
    }
    given = sketch(walls=walls, surfaces={})
    stand = Stand(x_m=0.0, y_m=0.0, height_m=1.0)
    station = sketched_survey(given).station("P", stand, VLP)
    beams = expected_medians(nominal(VLP), station.patches, VLP, 20)
    xyz = station.pose.inverse().apply(beams.points(nominal(VLP)))
    near = np.abs(xyz[:, 0]) < 4.5
    assert near.sum() > 1000
    assert np.allclose(xyz[near, 1], 3.0, atol=1e-9)
    # Beside the wall in front, the one behind is met, as far as its angle allows.
    assert np.allclose(xyz[np.abs(xyz[:, 0]) > 11.0, 1], 6.0, atol=1e-9)


def test_walls_alone_leave_the_vertical_angles_to_the_factory():
    walls = task(surfaces={})
    only = plan_unit(walls.given, walls.instrument)
    assert len(only.weakly_determined("v")) == 16
    assert not len(only.weakly_determined("alpha"))
    both = task()
    with_floor = plan_unit(both.given, both.instrument)
    met = with_floor.medians[0, :, with_floor.planes.index("floor")] > 0
    assert 0 < met.sum() < 16
    assert np.all(with_floor.std[met, 2] < 0.8 * only.std[met, 2])


@pytest.mark.parametrize("more", ["planes", "station", "targets", "recordings"])
def test_more_never_makes_it_worse(more):
    stand = CONTENT["stations"]["P1"]
    ceiling = {"corners_m": [[0.0, 0.0, 2.5], [6.0, 0.0, 2.5], [6.0, 4.0, 2.5], [0.0, 4.0, 2.5]]}
    changes = {
        "planes": {"surfaces": {**CONTENT["surfaces"], "ceiling": ceiling}},
        "station": {"stations": {"P1": stand, "P2": CONTENT["candidates"]["tilted"]}},
        "targets": {"survey": {**CONTENT["survey"], "base_site_mm": 0.2, "base_scanner_mm": 0.2}},
        "recordings": {"recordings": 4},
    }
    before, after = task(), task(**changes[more])
    first = plan_unit(before.given, before.instrument)
    second = plan_unit(after.given, after.instrument)
    # With more windows the ratio is near 1, as the noise is a small part.
    assert np.all(np.median(second.std / first.std, axis=0) < 1.01)
    assert second.point_std_m < 1.001 * first.point_std_m


def test_candidates_are_ranked():
    wanted = task()
    blind = wanted.candidates[0].station
    nowhere = replace(blind, position="nowhere", planes=blind.planes[:1])
    away = nowhere.planes[0].patch
    far = replace(away, corners=away.corners + np.array([0.0, 0.0, 500.0]))
    nowhere = replace(nowhere, planes=(replace(nowhere.planes[0], patch=far),))
    candidates = (*wanted.candidates, replace(wanted.candidates[0], station=nowhere))
    ranked = judge(wanted.given, candidates, wanted.instrument)
    assert {each.name for each in ranked} == {"opposite", "high", "tilted", "nowhere"}
    # The tilted scanner sees the floor with more lasers, the high one with fewer.
    assert ranked[0].name == "tilted"
    assert ranked[-1].name == "nowhere"
    assert ranked[-1].plan is None
    scores = [each.score_m for each in ranked]
    assert scores == sorted(scores)
    alone = plan_unit(wanted.given, wanted.instrument)
    assert scores[0] < alone.point_std_m < ranked[0].alone.point_std_m * 2.0


def test_no_plane_is_one_clear_error():
    high = {**CONTENT["stations"]["P1"], "height_m": 300.0}
    wanted = task(stations={"P1": high})
    with pytest.raises(SurveyError, match=r"no laser meets a plane.*\n?.*Hint"):
        plan_unit(wanted.given, wanted.instrument)


def test_picture_has_a_row_per_plane():
    wanted = task()
    found = plan_unit(wanted.given, wanted.instrument)
    figure = draw_lasers(found, "VLP-16")
    labels = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert labels == ["P1: long wall", "P1: short wall", "P1: floor"]
    assert sum(len(line.get_xdata()) for line in figure.axes[1].lines) == 16


SMALL = {**CONTENT, "candidates": {}}


def test_command_prints_tables_and_writes_files(tmp_path):
    path = tmp_path / "room.yaml"
    path.write_text(yaml.safe_dump(SMALL), "utf-8")
    done = plan(path, "--out", tmp_path / "plan", "--json")
    assert done.exit_code == 0, done.output
    facts = json.loads(done.stdout)
    assert facts["stations"] == ["P1"]
    assert [each["name"] for each in facts["parameters"]] == ["dl", "alpha", "v"]
    assert len(facts["lasers"]["laser_id"]) == 16
    assert facts["best_candidate"] is None
    assert json.loads((tmp_path / "plan/plan.json").read_text("utf-8")) == facts
    table = pd.read_csv(tmp_path / "plan/lasers.csv")
    assert np.allclose(table["dl_std_mm"].median(), facts["parameters"][0]["median_std"])
    assert (tmp_path / "plan/plan.png").stat().st_size > 10_000
    assert (tmp_path / "plan/lasers.svg").read_text("utf-8").startswith("<?xml")
    with pytest.raises(VelocalError, match="exists already"):
        plan(path, "--out", tmp_path / "plan")


def test_template_is_a_sketch(tmp_path):
    path = tmp_path / "room.yaml"
    assert plan("--template", path).exit_code == 0
    assert set(read_sketch(path).candidates) == {"opposite", "high", "tilted"}
    with pytest.raises(VelocalError, match="exists already"):
        plan("--template", path)


def test_study_before_its_recordings_exist(tmp_path):
    """The same walls and stations in the survey files of a study give the same plan."""
    folder = tmp_path / "study"
    arguments = ["init", str(folder), "--scanner", "VLP-16", "--positions", "1"]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    settings = (folder / "config.yaml").read_text("utf-8")
    names = "long_wall, short_wall, floor"
    (folder / "config.yaml").write_text(settings.replace("wall1, wall2, floor", names), "utf-8")
    given = sketch(survey={**CONTENT["survey"], "flatness_mm": 0.0})
    survey = sketched_survey(given)
    site = pose_of(given.stations["P1"], VLP).apply(survey.base.xyz)
    base = replace(survey.base, xyz=site, group=("P1",) * len(site), std=np.full(site.shape, 1e-3))
    write_targets(folder / "survey/planes.csv", "plane", [survey.planes])
    write_targets(folder / "survey/base_scanner.csv", "scanner", [survey.base])
    write_targets(folder / "survey/base_field.csv", "position", [base])
    of_study = json.loads(plan(folder, "--json").stdout)
    path = tmp_path / "room.yaml"
    same = {**SMALL, "survey": {**CONTENT["survey"], "flatness_mm": 0.0}}
    path.write_text(yaml.safe_dump(same), "utf-8")
    of_room = json.loads(plan(path, "--json").stdout)
    assert of_study["planes"] == of_room["planes"]
    for one, other in zip(of_study["parameters"], of_room["parameters"], strict=True):
        assert one["median_std"] == pytest.approx(other["median_std"], rel=0.01)


FAULTS = {
    "unknown scanner": ({"scanner": "VLP-61"}, "Did you mean 'VLP-16'"),
    "unknown key": ({"wall": {}}, "Did you mean 'walls'"),
    "no surface": ({"walls": {}, "surfaces": {}}, "Give walls, surfaces or both"),
    "no station": ({"stations": {}, "candidates": {}}, "Give stations, candidates or both"),
    "upside down": (
        {"walls": {"w": {"from_m": [0, 0], "to_m": [1, 0], "top_m": -1.0}}},
        "0.1 or more",
    ),
    "far away": ({"stations": {"P": {"x_m": 1e6, "y_m": 0.0, "height_m": 1.0}}}, "10000"),
    "line": (
        {"surfaces": {"s": {"corners_m": [[0, 0, 0], [1, 0, 0], [2, 0, 0]]}}},
        "Give corners that span a surface",
    ),
    "bent": (
        {"surfaces": {"s": {"corners_m": [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 1]]}}},
        "m beside the plane of the others",
    ),
    "twice": ({"candidates": {"P1": CONTENT["stations"]["P1"]}}, "'P1' occurs twice"),
    "text": ({"recordings": "two"}, "recordings: 'two'"),
    "no size": ({"assume": {"pattern_mm": 0.0}}, "assume.pattern_mm"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_of_a_sketch(case, tmp_path):
    changes, told = FAULTS[case]
    path = tmp_path / "room.yaml"
    path.write_text(yaml.safe_dump({**CONTENT, **changes}), "utf-8")
    with pytest.raises(ConfigError) as error:
        plan(path)
    assert told in str(error.value)
    assert str(path) in str(error.value)


def test_faults_of_the_call(tmp_path):
    with pytest.raises(ConfigError, match="no such folder or file"):
        plan(tmp_path / "nothing.yaml")
    with pytest.raises(ConfigError, match="no configuration in this folder"):
        plan(tmp_path)
    path = tmp_path / "room.yaml"
    path.write_text(TEMPLATE, "utf-8")
    with pytest.raises(ConfigError, match="is for studies only"):
        plan(path, "--scanner", "VLP-16")
    assert plan().exit_code == 2
