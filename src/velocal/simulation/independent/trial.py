"""One example of a calibration with its truth.

Beams, rigid motion, surfaces and errors are written in this folder once more and in another way
(complex numbers, a correlation by its spectrum, bumps for the relief), so that an error in the
project's own models cannot hide itself. Only containers, the nominal geometry of the scanners, and
the adjustment of the survey come from the project: the survey passes through `Station.adjust`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.arrays import Array
from velocal.scanner.models import SCANNERS, Scanner
from velocal.scanner.parameters import NEAR_POINT, TWO_POINT, LaserParameters
from velocal.simulation.independent.plan import PLACES, UNSEEN, Plan, UnitErrors
from velocal.simulation.independent.shots import FAR_M, Shots, correction, rays
from velocal.simulation.independent.site import (
    base_targets,
    pose_at,
    surface_of,
    survey_of,
    wall_targets,
)
from velocal.survey.station import Station

#: Near points of a factory's two-point calibration along X and Y, metres.
NEAR_M = (2.4, 1.93)
#: Standard deviation of the true correction at the near point minus that at the far one, as in real
#: files.
TWO_POINT_CM = 3.0
_DEG, _CM, _MM = np.pi / 180.0, 1e-2, 1e-3


@dataclass(frozen=True)
class Recorded:
    """What a user has of one station.

    Attributes
    ----------
    survey : Station
        As the project adjusts it from the coordinates of the targets.
    windows : tuple of Observations
        Medians of every window, with the surveyed planes.
    """

    survey: Station
    windows: tuple[Observations, ...]


@dataclass(frozen=True)
class Trial:
    """One example of a calibration, with its truth.

    Attributes
    ----------
    scanner : str
    factory, true : LaserParameters
        The file of the factory, and the truth. With a two-point correction, `true` has the true
        corrections at the points of the factory.
    slope : ndarray, shape (n,)
        Change of the true distance correction with the range, below the far point.
    stations : tuple of Recorded
    unseen : tuple of Observations
        Medians at stations that were not calibrated on, with the true planes.
    spread : mapping of str to float
        True standard deviations of what an adjustment has to guess, by name: dl, alpha, v, scale,
        voff, hoff (metres, radians, 1).
    """

    scanner: str
    factory: LaserParameters
    true: LaserParameters
    slope: Array
    stations: tuple[Recorded, ...]
    unseen: tuple[Observations, ...]
    spread: Mapping[str, float]

    def correction(self, length: Array | float, laser: NDArray[np.integer] | slice) -> Array:
        """True distance correction at a range.

        Parameters
        ----------
        length : ndarray, shape (n,), or float
            True ranges, metres.
        laser : ndarray of int, shape (n,), or slice

        Returns
        -------
        ndarray, shape (n,)
            Metres.
        """
        return correction(self.true, self.slope, length, laser)

    def shots(
        self, length: float, phi: Array, laser: NDArray[np.integer]
    ) -> tuple[Array, Array, Array]:
        """Shots without noise at a range: raw distances, true points, directions of the beams.

        Parameters
        ----------
        length : float
            True range, metres.
        phi : ndarray, shape (n,)
            Rotational angles, radians.
        laser : ndarray of int, shape (n,)

        Returns
        -------
        raw : ndarray, shape (n,)
            Metres.
        points, directions : ndarray, shape (n, 3)
            Scanner frame.
        """
        origin, direction = rays(phi, laser, self.true)
        raw = length - self.correction(length, laser)
        return raw, origin + length * direction, direction


def draw(plan: Plan, seed: int) -> Trial:
    """Make one example of a plan.

    Parameters
    ----------
    plan : Plan
    seed : int
        Every seed is another unit, another survey and other noise.

    Returns
    -------
    Trial
        With `UNSEEN` stations beside those of the plan.
    """
    rng = np.random.default_rng([seed, 20151])
    scanner = SCANNERS[plan.scanner]
    factory, true, slope = _unit(rng, scanner, plan.unit)
    surfaces = [surface_of(rng, name, plan.survey.flatness_mm) for name in plan.surfaces]
    shots = Shots(plan, scanner, true, slope, surfaces, rng)
    walls = wall_targets(rng, surfaces, plan.survey)
    on_base = base_targets(plan.survey)
    sheet = on_base + rng.normal(0.0, plan.survey.scanner_mm * _MM, on_base.shape)
    stations = []
    for number in range(plan.stations):
        pose = pose_at(rng, PLACES[number], plan.tilt_deg, number)
        survey = survey_of(rng, plan, pose, walls, sheet, f"S{number + 1}")
        stations.append(Recorded(survey, tuple(shots.windows(rng, pose, survey, plan.windows))))
    unseen = []
    for place in PLACES[-UNSEEN:]:
        pose = pose_at(rng, place, 0.0, 0)
        unseen += shots.windows(rng, pose, None, 1)
    # The near points of the file are applied before the adjustment. What they are wrong by is
    # linear in the range, and the unknown is its value at range zero.
    at_zero = plan.unit.two_point_cm * FAR_M / (FAR_M - NEAR_M[0])
    spread = {
        "dl": (at_zero or plan.unit.dl_cm) * _CM,
        "alpha": plan.unit.alpha_deg * _DEG,
        "v": plan.unit.v_deg * _DEG,
        "scale": 0.0,
        "voff": plan.unit.voff_mm * _MM,
        "hoff": plan.unit.hoff_mm * _MM,
    }
    return Trial(plan.scanner, factory, true, slope, tuple(stations), tuple(unseen), spread)


def _unit(
    rng: np.random.Generator, scanner: Scanner, errors: UnitErrors
) -> tuple[LaserParameters, LaserParameters, Array]:
    """Factory file, truth, and slope of the true distance correction."""
    n = scanner.n_lasers

    def around(mean: float, std: float) -> Array:
        return mean + std * rng.standard_normal(n)

    own_file = scanner.has_factory_file
    factory = LaserParameters(
        dl=around(1.2, 0.05) if own_file else np.zeros(n),
        alpha=scanner.rotational_rad + (around(0.4, 0.12) if own_file else 0.0) * _DEG,
        v=scanner.vertical_rad + (around(-0.1, 0.13) if own_file else 0.0) * _DEG,
        voff=scanner.vertical_offset_m + np.zeros(n),
        hoff=scanner.horizontal_offset_m + np.zeros(n),
        carried={TWO_POINT: np.zeros(n)},
    )
    true = replace(
        factory,
        dl=factory.dl + around(errors.dl_mean_cm, errors.dl_cm) * _CM,
        alpha=factory.alpha + around(errors.alpha_mean_deg, errors.alpha_deg) * _DEG,
        v=factory.v + around(errors.v_mean_deg, errors.v_deg) * _DEG,
        voff=factory.voff + around(0.0, errors.voff_mm) * _MM,
        hoff=factory.hoff + around(0.0, errors.hoff_mm) * _MM,
    )
    if not errors.two_point_cm:
        return factory, true, np.zeros(n)
    # The true correction is linear in the range up to the far point.
    slope = around(0.0, TWO_POINT_CM * _CM) / (FAR_M - NEAR_M[0])
    wrong = around(errors.dl_mean_cm, errors.two_point_cm) * _CM
    true = replace(true, dl=factory.dl)
    near = {
        name: factory.dl + slope * (at - FAR_M) for name, at in zip(NEAR_POINT, NEAR_M, strict=True)
    }
    on = {TWO_POINT: np.ones(n)}
    file = replace(factory, carried=on | {name: value - wrong for name, value in near.items()})
    return file, replace(true, carried=on | near), slope
