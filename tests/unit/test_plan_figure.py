"""Plan of the test field: its numbers lie where the field is, its panels share their axes."""

from dataclasses import replace

import draw_plan
import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from support.building import WORLD, stated
from support.world import without_errors

from velocal.io import schemas, storage
from velocal.reporting import captions
from velocal.reporting.figures import plan as plan_figure
from velocal.scanner.beam import Beams
from velocal.scanner.models import SCANNERS
from velocal.simulation import capture, survey
from velocal.simulation.truth import unit_truth
from velocal.study.figures import PlanFigure
from velocal.study.reduction import AssignmentLimits
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.station import Station, read_station
from velocal.survey.targets import write_targets

PLANES = ["short_wall", "long_wall", "floor"]
LIMITS = AssignmentLimits(distance_cm=25, edge_cm=5, incidence_deg=80)
SELECTION = PlanFigure(kind="plan", scanner="HDL-32E", samples=["sa5", "sa6"])
PERFECT = without_errors(WORLD)


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    """Two positions of an HDL-32E without errors, as files: medians, surveys, targets."""
    folder = tmp_path_factory.mktemp("plan")
    surveyed = adjust_field_book(survey.field_book(PERFECT))
    write_targets(folder / "targets.csv", "plane", stated([surveyed.planes]))
    azimuths = np.arange(0, 36000, 40)
    medians, surveys = [], []
    for sample, position in (("sa5", "P5"), ("sa6", "P6")):
        ticks = capture.shots_at(PERFECT, "HDL-32E", position, azimuths).ticks
        azimuth, laser = np.nonzero(np.isfinite(ticks))
        columns = {"laser_id": laser, "azimuth": azimuth, "distance": ticks[azimuth, laser],
                   "spread": np.zeros(len(laser)), "count": np.full(len(laser), 100)}  # fmt: skip
        medians.append(folder / f"{sample}.parquet")
        storage.write_table(medians[-1], schemas.MEDIANS, columns, rotation_rate_hz=10.0)
        station = Station.adjust(
            surveyed.planes,
            surveyed.base_scanner["HDL-32E"].targets,
            surveyed.base_site[position],
            PLANES,
            where="survey",
        )
        surveys.append(folder / f"{position}.json")
        storage.write_json(surveys[-1], station.to_json())
    return medians, surveys, folder / "targets.csv"


@pytest.fixture(scope="module")
def numbers(views):
    """Numbers of both panels with the true parameters."""
    medians, surveys, targets = views
    surveyed = plan_targets(targets)
    parameters = unit_truth(PERFECT, "HDL-32E").parameters
    frames = []
    for path, station in zip(medians, map(read_station, surveys), strict=True):
        columns, facts = storage.read_table(path, schemas.MEDIANS)
        beams = Beams.from_ticks(columns, SCANNERS["HDL-32E"], facts["rotation_rate_hz"])
        frames.append(
            plan_figure.plan(path.stem, station, beams, parameters, surveyed, LIMITS.metric())
        )
    return pd.concat(frames, ignore_index=True)


def plan_targets(path):
    return draw_plan.read_targets(path, "plane")


def test_medians_lie_on_the_planes_of_the_field(numbers):
    on = numbers[numbers["kind"] == "median"]
    assert set(on["plane"]) == set(PLANES)
    for plane, axis in (("short_wall", "x_m"), ("long_wall", "y_m"), ("floor", "z_m")):
        assert on.loc[on["plane"] == plane, axis].abs().max() < 0.01
    off = numbers[numbers["kind"] == "other"]
    (x0, x1), (y0, y1) = WORLD.site.room_x_m, WORLD.site.room_y_m
    assert off["x_m"].between(x0 - 0.05, x1 + 0.05).all()
    assert off["y_m"].between(y0 - 0.05, y1 + 0.05).all()
    # The frame of a free network is off by the rounding of the sketch, a centimetre.
    assert off["z_m"].between(0.09, WORLD.site.wall_height_m + 0.01).all()


def test_scanners_stand_where_they_were_surveyed(numbers):
    for position in ("P5", "P6"):
        rows = numbers[numbers["position"] == position].set_index("kind")
        where = WORLD.positions[position]
        at = rows.loc["scanner", ["x_m", "y_m", "z_m"]].to_numpy(dtype=float)
        np.testing.assert_allclose(at, [where.x_m, where.y_m, where.z_m], atol=0.002)
        ahead = rows.loc["ahead", ["x_m", "y_m", "z_m"]].to_numpy(dtype=float) - at
        heading = np.rad2deg(np.arctan2(ahead[0], ahead[1]))
        np.testing.assert_allclose(heading, where.heading_deg, atol=0.5)


def test_medians_are_thinned_evenly_and_counted(numbers):
    for _, rows in numbers[numbers["kind"] == "median"].groupby(["position", "plane"]):
        of = rows["drawn_of"].iloc[0]
        step = -(-of // plan_figure.MEDIANS)
        assert len(rows) == -(-of // step) <= plan_figure.MEDIANS
    targets = numbers[(numbers["kind"] == "target") & (numbers["position"] == "P5")]
    assert len(targets) == sum(count for _, count in WORLD.site.targets)


def test_nothing_measured_still_makes_a_plan(views):
    medians, surveys, targets = views
    station = read_station(surveys[0])
    columns, _ = storage.read_table(medians[0], schemas.MEDIANS)
    beams = Beams.from_ticks(columns, SCANNERS["HDL-32E"], 10.0)[:0]
    rest = (
        beams, unit_truth(PERFECT, "HDL-32E").parameters, plan_targets(targets), LIMITS.metric(),
    )  # fmt: skip
    found = plan_figure.plan("sa5", station, *rest)
    assert not len(found[found["kind"] == "median"])
    plan_figure.draw_plan(found, SELECTION, simulated=False)
    turned = replace(station, pose=station.pose.inverse().inverse())
    again = plan_figure.plan("sa5", turned, *rest)
    pd.testing.assert_frame_equal(found, again)


def test_panels_share_axes_and_scale(numbers):
    figure = plan_figure.draw_plan(numbers, SELECTION, simulated=True)
    left, right = figure.axes
    assert left.get_xlim() == right.get_xlim()
    assert left.get_ylim() == right.get_ylim()
    assert left.get_aspect() == right.get_aspect() == 1.0
    assert (left.get_xlabel(), left.get_ylabel()) == ("X [m]", "Y [m]")
    assert [ax.get_title(loc="left")[:2] for ax in (left, right)] == ["P5", "P6"]
    assert "simulated recordings" in [text.get_text() for text in figure.texts]
    caption = captions.caption(SELECTION, numbers)
    assert "P5 (sample sa5), P6 (sample sa6)" in caption


def test_bytes_depend_on_nothing_but_the_data(views, tmp_path, monkeypatch):
    def draw(name):
        files = [tmp_path / f"{name}.{suffix}" for suffix in ("svg", "png", "csv")]
        names = ("medians", "surveys", "targets", "svg", "png", "csv")
        draw_plan.main(
            **dict(zip(names, (*views, *files), strict=True)), calibration=None,
            samples=SELECTION.samples, selection=SELECTION, limits=LIMITS, simulated=True,
        )  # fmt: skip
        return [path.read_bytes() for path in files]

    first = draw("first")
    monkeypatch.setitem(mpl.rcParams, "savefig.dpi", 30)
    assert draw("second") == first
    assert len(first[0]) < 1_000_000
