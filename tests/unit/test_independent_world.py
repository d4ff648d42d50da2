"""The second world agrees with the project's equations; its errors are as large as stated."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from velocal.calibration.dialects import DIALECTS
from velocal.scanner.models import SCANNERS
from velocal.simulation import independent
from velocal.simulation.independent.plan import SURFACES, Noise, Plan, SurveyErrors, UnitErrors
from velocal.simulation.independent.shots import along
from velocal.simulation.independent.site import surface_of
from velocal.simulation.independent.trial import draw

SILENT = Noise(shot_cm=0.0, pattern_cm=0.0, shift_cm=0.0, drift_cm=0.0, azimuth_deg=0.0)
#: Zero would make the covariances singular.
TINY = 1e-6
EXACT = SurveyErrors(base_m=0.3, scanner_mm=TINY, site_mm=TINY, wall_mm=TINY, flatness_mm=0.0)
FORBIDDEN = (
    "velocal.scanner.beam",
    "velocal.adjustment.functional",
    "velocal.geometry",
    "velocal.simulation.",
)


def test_imports_no_model_of_the_project():
    modules = list(Path(independent.__path__[0]).glob("*.py"))
    assert len(modules) > 3
    trees = [ast.parse(module.read_text(encoding="utf-8")) for module in modules]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    names = {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    own = {name for name in names if name.startswith(independent.__name__)}
    assert own
    assert not [name for name in names - own if name.startswith(FORBIDDEN)]


@pytest.mark.parametrize("scanner", ["HDL-64E", "HDL-32E", "VLP-16"])
def test_without_errors_the_truth_has_no_misclosures(scanner):
    plan = Plan(
        scanner=scanner,
        stations=2,
        tilt_deg=20.0,
        windows=1,
        every=20,
        surfaces=tuple(SURFACES),
        unit=UnitErrors(hoff_mm=3.0, voff_mm=3.0),
        noise=SILENT,
        survey=EXACT,
    )
    trial = draw(plan, 3)
    windows = [window for station in trial.stations for window in station.windows]
    half_tick = SCANNERS[scanner].distance_tick_m / 4.0
    for data in [*windows, *trial.unseen]:
        assert len(data.phi) > 100
        # Distances are rounded to half ticks; the survey is good to some nanometres.
        assert np.max(np.abs(data.misclosure(trial.true))) < half_tick + 1e-6
        assert np.max(np.abs(data.misclosure(trial.factory))) > 0.01
    seen = np.unique(np.concatenate([window.plane for window in windows]))
    assert list(seen) == list(range(len(SURFACES)))


def test_shots_lie_where_the_equations_put_them():
    trial = draw(Plan(every=50, windows=1), 5)
    laser = np.arange(64)
    phi = np.linspace(0.0, 6.0, 64)
    raw, points, direction = trial.shots(12.0, phi, laser)
    found = DIALECTS["paper"].points(raw, phi, laser, trial.true)
    assert np.allclose(found, points, rtol=0.0, atol=1e-12)
    assert np.allclose(np.linalg.norm(direction, axis=1), 1.0)


def test_a_seed_decides_everything():
    plan = Plan(scanner="VLP-16", windows=1, every=10)
    one, again, other = draw(plan, 7), draw(plan, 7), draw(plan, 8)
    first, second = one.stations[0].windows[0], again.stations[0].windows[0]
    assert np.array_equal(first.distance_m, second.distance_m)
    assert np.array_equal(first.normal, second.normal)
    assert not np.array_equal(one.true.dl, other.true.dl)


def test_unit_errors_are_as_large_as_stated():
    unit = UnitErrors(alpha_mean_deg=0.3, hoff_mm=3.0)
    trials = [draw(Plan(windows=1, every=200, unit=unit), seed) for seed in range(6)]

    def errors(name):
        return np.concatenate([getattr(t.true, name) - getattr(t.factory, name) for t in trials])

    # 6 x 64 values: the standard deviation of an estimated one is 3.6 % of it.
    assert np.std(errors("dl")) == pytest.approx(0.019, rel=0.15)
    assert np.rad2deg(np.std(errors("v"))) == pytest.approx(0.1, rel=0.15)
    assert np.rad2deg(np.mean(errors("alpha"))) == pytest.approx(0.3, abs=0.02)
    assert np.std(errors("hoff")) == pytest.approx(0.003, rel=0.15)
    assert not errors("voff").any()


@pytest.mark.parametrize("gaussian", [False, True])
def test_pattern_has_its_correlation(gaussian):
    noise = replace(SILENT, pattern_deg=2.0, pattern_gaussian=gaussian)
    rows = along(3600, 0.1, noise, np.random.default_rng(0), 200)
    lag = np.mean(rows * np.roll(rows, 20, axis=1))  # over 2 deg
    assert np.mean(rows**2) == pytest.approx(1.0, abs=0.03)
    assert lag == pytest.approx(np.exp(-0.25 if gaussian else -1.0), abs=0.03)


def test_poses_scatter_as_their_covariance_says():
    # The base of all draws stands at nearly the same place; headings scatter by some degrees.
    plan = Plan(scanner="VLP-16", windows=1, every=100, survey=SurveyErrors(wall_targets=4))
    squares = []
    for seed in range(40):
        station = draw(plan, seed).stations[0].survey
        squares.append(station.variance_factor)
        std = np.rad2deg(np.sqrt(np.diag(station.pose.covariance)[:3]))
        assert 0.2 < std.max() < 0.5  # as the issue says of such a survey
    # Chi-square of 12 degrees of freedom, mean of 40: a standard deviation of 0.065.
    assert np.mean(squares) == pytest.approx(1.0, abs=0.2)


def test_relief_is_as_large_as_stated():
    surface = surface_of(np.random.default_rng(1), "long", 2.0)
    a, b = np.random.default_rng(2).uniform(0.0, surface.extent, (4000, 2)).T
    assert np.std(surface.relief(a, b)) == pytest.approx(2e-3, rel=0.1)


def test_two_point_file_is_right_far_and_wrong_near():
    trial = draw(Plan(windows=1, every=100, unit=UnitErrors(two_point_cm=2.0)), 1)
    for name in ("dist_correction_x", "dist_correction_y"):
        wrong = trial.true.carried[name] - trial.factory.carried[name]
        assert np.std(wrong) == pytest.approx(0.02, rel=0.3)
    assert np.array_equal(trial.true.dl, trial.factory.dl)
    everyone = slice(None)
    assert np.allclose(trial.correction(80.0, everyone), trial.factory.dl)
    near = trial.correction(2.4, everyone)
    assert np.allclose(near, trial.true.carried["dist_correction_x"], rtol=0.0, atol=1e-12)
