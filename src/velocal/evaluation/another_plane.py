"""What one more plane or room would bring to a calibration without a survey, before it is recorded.

The points of the new planes are simulated with the parameters and the noise that the adjustment
found, and the unit is adjusted again: the standard deviations are those that it would state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.adjustment.unit.model import relief
from velocal.adjustment.unit.noise import correlation
from velocal.adjustment.unit.result import UnitCalibration
from velocal.adjustment.unit.settings import UnitSettings
from velocal.arrays import Array
from velocal.evaluation.planes_in_data import Cloud, plane_of
from velocal.evaluation.unsurveyed import FLATNESS_M, Seen, adjust_unsurveyed, relative_std
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
    scale_from_data : float
        The same of the range scale, which planes at other distances decide; it is not corrected.
        NaN where there is a far point.
    """

    planes: str
    lasers: int
    dl_mm: float
    alpha_deg: float
    v_deg: float
    alpha_from_data: float
    v_from_data: float
    scale_from_data: float


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
            new = _shifted(new, unit, np.random.default_rng([_SEED, number, 1]))
            found.append(_expected(name, adjust_unsurveyed([*used, new], settings)))
    return tuple(found)


def with_another_room(
    recordings: Sequence[Seen], unit: UnitCalibration, settings: UnitSettings, room: Observations
) -> Expected:
    """Tell what a recording in another room would bring, from the geometry of the room alone.

    Parameters
    ----------
    recordings, unit, settings
        As for `with_another_plane`.
    room : Observations
        Which beams would meet which plane, in the scanner frame; the distances are not used.

    Returns
    -------
    Expected
    """
    used = [each for each in recordings if each.planes]
    rng = np.random.default_rng([_SEED, len(used)])
    met = _Met(room.phi, room.laser_id, room.normal, room.offset, room.plane_number)
    new = _measured(used[0], unit, met, rng, even=False)
    if new is None:
        return _expected("and another room", unit)
    new = _shifted(new, unit, rng)
    settings = replace(settings, integration_points=1)
    return _expected("and another room", adjust_unsurveyed([*used, new], settings))


def _expected(name: str, unit: UnitCalibration) -> Expected:
    scale = unit.range_scale
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
        float("nan") if scale is None else float(np.median(scale.determined[seen])),
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


@dataclass(frozen=True)
class _Met:
    """Beams and the planes that they meet: angle, laser, normal, offset and number of the plane."""

    phi: Array
    laser: NDArray[np.integer]
    normal: Array
    offset: Array
    plane: NDArray[np.integer]


def _simulated(
    like: Seen, unit: UnitCalibration, normal: Array, distance: float, rng: np.random.Generator
) -> Seen | None:
    """A recording of one more plane; None if fewer than two lasers meet it."""
    middle = 0.0 if abs(normal[2]) > 1.0 - _UPRIGHT else float(np.arctan2(normal[0], normal[1]))
    phi = middle + np.arange(-_HALF_RAD, _HALF_RAD, _step(like.cloud))
    seen = np.flatnonzero(unit.calibration.observed)
    n = len(phi) * len(seen)
    met = _Met(
        np.tile(phi, len(seen)),
        np.repeat(seen, len(phi)),
        np.tile(normal, (n, 1)),
        np.full(n, -distance),
        np.zeros(n, dtype=np.int64),
    )
    # The unevenness of a single plane would decide too much of what is learnt of all.
    return _measured(like, unit, met, rng, even=True)


def _shifted(new: Seen, unit: UnitCalibration, rng: np.random.Generator) -> Seen:
    """The same with the shift that the distances of a laser have from recording to recording."""
    shift = rng.normal(0.0, unit.sigma("sigma_shift"), len(unit.calibration))
    beams = replace(new.cloud, distance_m=new.cloud.distance_m + shift[new.cloud.laser_id])
    cloud = Cloud.from_beams(beams, new.cloud.parameters)
    planes = tuple(plane_of(each.name, cloud, each.rows) for each in new.planes)
    return replace(new, cloud=cloud, planes=planes)


def _measured(
    like: Seen, unit: UnitCalibration, met: _Met, rng: np.random.Generator, *, even: bool
) -> Seen | None:
    """What the unit would measure; None if fewer than two lasers meet a plane.

    Planes are even, or as uneven as those that the unit was adjusted on.
    """
    cloud, parameters = like.cloud, unit.calibration.adjusted
    direction, origin = laser_beams(met.phi, met.laser, parameters)
    towards = np.einsum("ni,ni->n", direction, met.normal)
    meets = np.abs(towards) > _INCIDENCE
    length = np.full(len(met.laser), np.nan)
    to_plane = met.offset + np.einsum("ni,ni->n", origin, met.normal)
    length[meets] = -to_plane[meets] / towards[meets]
    raw = length - parameters.dl[met.laser]
    for plane in () if even else np.unique(met.plane[meets]):
        own = np.flatnonzero(meets & (met.plane == plane))
        raw[own] += (
            _unevenness(unit, origin[own] + length[own, None] * direction[own], rng)
            / (towards[own])
        )
        raw[own] += rng.normal(0.0, unit.sigma("sigma_plane"), len(parameters))[met.laser[own]]
    for laser in np.unique(met.laser):
        own = np.flatnonzero(met.laser == laser)
        raw[own] += _noise(unit, met.phi[own], rng)
    keep = np.isfinite(raw) & (length > 0.0) & unit.calibration.observed[met.laser]
    if len(np.unique(met.laser[keep])) < 2:
        return None
    angle = np.mod(met.phi[keep], 2.0 * np.pi)
    new = Cloud.from_beams(Beams(raw[keep], angle, met.laser[keep], cloud.tick_m), cloud.parameters)
    plane = met.plane[keep]
    planes = [np.flatnonzero(plane == number) for number in np.unique(plane)]
    found = (plane_of(f"new {number}", new, rows) for number, rows in enumerate(planes))
    return Seen("one more recording", new, tuple(found))


def _unevenness(unit: UnitCalibration, point: Array, rng: np.random.Generator) -> Array:
    """Deviations from a plane, as large and as long as the adjustment takes them to be, metres."""
    usual = UnitSettings()
    basis = relief(point, usual.relief_knots_m, usual.relief_length_m)
    learnt = [one.value for one in unit.population if one.name == "sigma_relief"]
    size = FLATNESS_M * (learnt[0] if learnt else 1.0)
    return np.asarray(size * basis @ rng.standard_normal(basis.shape[1]))


def _step(cloud: Cloud) -> float:
    """Distance of the medians of a laser along azimuth, radians."""
    busiest = np.bincount(cloud.laser_id).argmax()
    steps = np.diff(np.sort(cloud.phi[cloud.laser_id == busiest]))
    return float(max(np.median(steps), np.deg2rad(0.05)))


def _noise(unit: UnitCalibration, phi: Array, rng: np.random.Generator) -> Array:
    """Pattern along azimuth and white noise of one laser, as large as the median laser has them."""
    seen = unit.calibration.observed
    tau, omega = (np.nanmedian(each[seen]) for each in (unit.noise.tau, unit.noise.omega))
    covariance = correlation(phi, unit.noise.length_rad) + 1e-9 * np.eye(len(phi))
    pattern = np.linalg.cholesky(covariance) @ rng.standard_normal(len(phi))
    return np.asarray(tau * pattern + omega * rng.standard_normal(len(phi)))
