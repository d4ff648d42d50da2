"""The adjustment of a unit, on units of the independent world, gives no set worse than the factory.

Its survey is as poor as the example sheets of a new study: the pose is known to some tenths of a
degree. `benchmarks/calibration.py` does the same for many draws and studies.
"""

import numpy as np
import pytest

from velocal.adjustment.observations import joined
from velocal.adjustment.unit.adjust import adjust_unit
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import UnitStation
from velocal.scanner.models import SCANNERS
from velocal.simulation.independent.plan import Plan
from velocal.simulation.independent.trial import Trial, draw

NAMES = ("dl", "alpha", "v")


def adjusted(trial: Trial):
    stations = [
        UnitStation(
            name=station.survey.position,
            observations=joined(station.windows),
            survey=station.survey.uncertainty(),
            plane_names=tuple(plane.patch.name for plane in station.survey.planes),
            pose=station.survey.pose,
        )
        for station in trial.stations
    ]
    settings = UnitSettings.recommended(SCANNERS[trial.scanner], factory=trial.factory)
    return adjust_unit(stations, trial.factory, settings)


def induced(trial: Trial, parameters) -> float:
    """What wrong parameters alone cause at the unseen stations, root mean square, metres."""
    difference = [d.misclosure(parameters) - d.misclosure(trial.true) for d in trial.unseen]
    return float(np.sqrt(np.mean(np.concatenate(difference) ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize("stations", [1, 2])
def test_unit_is_better_than_its_factory(stations):
    trial = draw(Plan(scanner="HDL-32E", stations=stations, windows=1, every=3), 11)
    result = adjusted(trial)
    found, at_factory = result.calibration, {o.name for o in result.common if o.at_factory}
    for column, name in enumerate(NAMES):
        error = getattr(found.adjusted, name) - getattr(trial.true, name)
        before = getattr(trial.factory, name) - getattr(trial.true, name)
        # v of the lasers that see walls only is hardly known: it may stay as it was.
        assert np.sqrt(np.mean(error**2)) < 1.05 * np.sqrt(np.mean(before**2)), name
        if name in at_factory and name != "dl":
            error = error - error.mean()
        # 95 % of 32 lasers are 30; errors of the pose, which they share, make this number scatter.
        assert np.sum(np.abs(error) <= 1.96 * found.std[:, column]) >= 25, name
    assert induced(trial, found.adjusted) < 0.5 * induced(trial, trial.factory)


@pytest.mark.slow
def test_a_pose_that_is_far_off_does_not_become_errors_of_the_lasers():
    """Terms of second order of such a pose were once read as errors of voff, and moved v."""
    trial = draw(Plan(scanner="HDL-32E", stations=2, windows=1), 1003)
    result = adjusted(trial)
    assert max(np.linalg.norm(station.pose[:3]) for station in result.stations) > np.deg2rad(0.5)
    found = result.calibration
    error, before = found.adjusted.v - trial.true.v, trial.factory.v - trial.true.v
    assert np.sqrt(np.mean(error**2)) < 1.05 * np.sqrt(np.mean(before**2))
    assert np.abs(error / found.std[:, NAMES.index("v")]).max() < 4.5
    assert induced(trial, found.adjusted) < 0.1 * induced(trial, trial.factory)
