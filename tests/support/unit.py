"""Stations of a unit in memory: truth, observations with all errors of the world, and survey."""

import numpy as np

from tests.support.building import WORLD
from velocal.adjustment.stochastic import Stochastic
from velocal.adjustment.unit.station import UnitStation
from velocal.simulation.draws import PLANES, full_draws, geometry

DEG = np.pi / 180.0


def unit_draws(scanner, position, runs, seed, *, step_deg=2.0, every=1):
    """Draw a station several times: its factory parameters, and (station, truth) of every run."""
    at = geometry(WORLD, scanner, position, step_deg=step_deg, every=every)
    errors = at.errors
    stochastic = Stochastic(
        noise_std_m=0.01,
        prior_std={
            "dl": errors.dl_cm * 1e-2,
            "alpha": errors.alpha_deg * DEG,
            "v": errors.v_deg * DEG,
        },
        angle_std_rad=0.026 * DEG,
    )
    draws = full_draws(at, stochastic, ("dl", "alpha", "v"), runs, seed, scenes=3)
    return at.factory, [
        (UnitStation(position, draw.observations, draw.survey, PLANES), draw.true) for draw in draws
    ]


def errors_of(result, true, factory):
    """Corrections minus true corrections, shape (lasers, 3)."""
    names = ("dl", "alpha", "v")
    wanted = np.column_stack([getattr(true, n) - getattr(factory, n) for n in names])
    return result.calibration.corrections - wanted, wanted
