"""What one more plane would bring to a calibration without a survey, before anybody records it.

The points of the new plane are simulated with the parameters and the noise that the adjustment
found, and the unit is adjusted again: the standard deviations are those that it would state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.unit.result import UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.arrays import Array
from velocal.evaluation.planes_in_data import Cloud, plane_of
from velocal.evaluation.unsurveyed import Seen, adjust_unsurveyed, relative_std
from velocal.scanner.beam import Beams, laser_beams

#: Half of the azimuths at which the new plane is seen, and largest angle of incidence.
_HALF_RAD, _INCIDENCE = np.deg2rad(30.0), np.cos(np.deg2rad(70.0))
#: Height of the scanner above a new floor, metres, and lean of a leaning plane.
_HEIGHT_M, _LEAN = 1.5, np.deg2rad(30.0)
#: Normals that lie within this angle of the horizontal are those of walls.
_UPRIGHT = np.sin(np.deg2rad(20.0))
#: Seed of the simulated noise.
_SEED = 1


@dataclass(frozen=True)
class Expected:
    """Standard deviations that a calibration states, root mean square over the observed lasers.

    Attributes
    ----------
    planes : str
        What it is adjusted on.
    lasers : int
        Lasers that are observed.
    dl_mm, alpha_deg, v_deg : float
        Of the corrections relative to their mean over the lasers.
    alpha_from_data, v_from_data : float
        Share that the data decide, median over the lasers; an angle that is not adjusted has 0.
    """

    planes: str
    lasers: int
    dl_mm: float
    alpha_deg: float
    v_deg: float
    alpha_from_data: float
    v_from_data: float


def with_another_plane(
    recordings: Sequence[Seen], unit: UnitCalibration, settings: UnitSettings
) -> tuple[Expected, ...]:
    """Tell what a wall at right angles, a wall farther away, a floor or a leaning plane brings.

    Parameters
    ----------
    recordings : sequence of Seen
        All that the unit was adjusted on.
    unit : UnitCalibration
        Result of that.
    settings : UnitSettings
        As for that.

    Returns
    -------
    tuple of Expected
        First the calibration as it is, then with each of these planes in addition.
    """
    found = [_expected("as it is", unit)]
    used = [each for each in recordings if each.planes]
    settings = replace(settings, integration_points=1)
    for number, (name, plane) in enumerate(_candidates(used).items()):
        new = _simulated(used[0], unit, *plane, np.random.default_rng([_SEED, number]))
        if new is not None:
            found.append(_expected(name, adjust_unsurveyed([*used, new], settings)))
    return tuple(found)


def _expected(name: str, unit: UnitCalibration) -> Expected:
    seen = unit.calibration.observed
    dl, alpha, v = np.sqrt(np.mean(relative_std(unit)[seen] ** 2, axis=0))
    _, alpha_share, v_share = np.median(unit.determined[seen], axis=0)
    return Expected(
        name,
        int(seen.sum()),
        float(dl) * 1e3,
        float(np.rad2deg(alpha)),
        float(np.rad2deg(v)),
        float(alpha_share),
        float(v_share),
    )


def _candidates(recordings: Sequence[Seen]) -> Mapping[str, tuple[Array, float]]:
    """Normal, away from the scanner, and distance of every plane that is tried, by name."""
    planes = [plane for each in recordings for plane in each.planes]
    largest = max(planes, key=lambda plane: len(plane.rows)).fit.plane
    outward = largest.normal * -np.sign(largest.offset)
    distance = float(np.median([abs(plane.fit.plane.offset) for plane in planes]))
    level = np.array([outward[0], outward[1], 0.0])
    if abs(outward[2]) > 1.0 - _UPRIGHT:  # a floor: any wall is at right angles to it
        level = np.array([0.0, 1.0, 0.0])
    level /= np.linalg.norm(level)
    beside = np.array([level[1], -level[0], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return {
        "and a wall at right angles to the largest plane": (beside, distance),
        "and a wall at twice the distance": (level, 2.0 * distance),
        "and the floor": (-up, _HEIGHT_M),
        "and a plane that leans by 30 deg": (
            np.cos(_LEAN) * level - np.sin(_LEAN) * up,
            distance,
        ),
    }


def _simulated(
    like: Seen, unit: UnitCalibration, normal: Array, distance: float, rng: np.random.Generator
) -> Seen | None:
    """A recording of one more plane; None if fewer than two lasers meet it."""
    cloud, parameters = like.cloud, unit.calibration.adjusted
    middle = 0.0 if abs(normal[2]) > 1.0 - _UPRIGHT else float(np.arctan2(normal[0], normal[1]))
    phi = middle + np.arange(-_HALF_RAD, _HALF_RAD, _step(cloud))
    seen = np.flatnonzero(unit.calibration.observed)
    laser, angle = np.repeat(seen, len(phi)), np.tile(phi, len(seen))
    direction, origin = laser_beams(angle, laser, parameters)
    towards = direction @ normal
    meets = towards > _INCIDENCE
    length = np.full(len(laser), np.nan)
    length[meets] = (distance - origin[meets] @ normal) / towards[meets]
    noise = _noise(unit, phi, seen, rng)
    raw = length - parameters.dl[laser] + noise
    keep = np.isfinite(raw) & (length > 0.0)
    if len(np.unique(laser[keep])) < 2:
        return None
    beams = Beams(raw[keep], np.mod(angle[keep], 2.0 * np.pi), laser[keep], cloud.tick_m)
    new = Cloud.from_beams(beams, cloud.parameters)
    rows = np.arange(len(new.xyz))
    return Seen("one more plane", new, (plane_of("new", new, rows),))


def _step(cloud: Cloud) -> float:
    """Distance of the medians of a laser along azimuth, radians."""
    busiest = np.bincount(cloud.laser_id).argmax()
    steps = np.diff(np.sort(cloud.phi[cloud.laser_id == busiest]))
    return float(max(np.median(steps), np.deg2rad(0.05)))


def _noise(
    unit: UnitCalibration, phi: Array, lasers: NDArray[np.integer], rng: np.random.Generator
) -> Array:
    """Pattern along azimuth and white noise as the adjustment found them, laser by laser."""
    with np.errstate(invalid="ignore"):
        tau, omega = (np.nanmedian(each[lasers]) for each in (unit.noise.tau, unit.noise.omega))
    apart = np.sqrt(3.0) * np.abs(phi[:, None] - phi) / unit.noise.length_rad
    covariance = (1.0 + apart) * np.exp(-apart) + 1e-9 * np.eye(len(phi))
    pattern = np.linalg.cholesky(covariance) @ rng.standard_normal((len(phi), len(lasers)))
    white = rng.standard_normal((len(phi), len(lasers)))
    return np.asarray((tau * pattern + omega * white).T.ravel())
