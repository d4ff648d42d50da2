"""Medians of a station drawn at random, with the truth: without packets, but with all errors.

The beams are fixed, a grid of angles on walls and floor. Every draw has its own true parameters and
errors of the observations, and a survey that is measured and adjusted anew.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.adjustment.stochastic import Stochastic, SurveyUncertainty
from velocal.arrays import Array
from velocal.geometry.planes import Plane
from velocal.geometry.rigid import RigidTransformation
from velocal.scanner.beam import laser_beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters
from velocal.simulation.scene import Surface, cast, site_surfaces
from velocal.simulation.survey import base_targets_true, field_book, true_targets
from velocal.simulation.truth import factory_parameters
from velocal.simulation.world import World
from velocal.study.world import Errors
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.station import Station
from velocal.survey.targets import Targets

#: Surveyed planes, in the order of the numbers of `Geometry.plane`.
PLANES = ("short_wall", "long_wall", "floor")
#: Limits of the study: distance of a beam from the edge of a plane (metres), and its incidence.
EDGE_M, INCIDENCE_RAD = 0.05, np.deg2rad(80.0)
#: Standard deviation of the median of n normal values, times the root of n.
MEDIAN_PER_MEAN = np.sqrt(np.pi / 2.0)


@dataclass(frozen=True)
class Geometry:
    """Beams of a station that meet surveyed planes.

    Attributes
    ----------
    world : World
    scanner, position : str
    factory : LaserParameters
        Where every adjustment starts.
    phi, laser_id, plane : ndarray, shape (n,)
        Rotational angle (radians), laser and plane of every beam; sorted by laser and angle.
    """

    world: World
    scanner: str
    position: str
    factory: LaserParameters
    phi: Array
    laser_id: NDArray[np.int64]
    plane: NDArray[np.int64]

    @property
    def errors(self) -> Errors:
        """Error model of the unit."""
        return self.world.scanner(self.scanner).errors


@dataclass(frozen=True)
class Draw:
    """Input of the adjustment in one run, and the truth.

    Attributes
    ----------
    observations : Observations
    survey : SurveyUncertainty or None
        None if pose and planes are exact.
    true : LaserParameters
    """

    observations: Observations
    survey: SurveyUncertainty | None
    true: LaserParameters


def geometry(
    world: World, scanner: str, position: str, *, step_deg: float = 0.9, every: int = 1
) -> Geometry:
    """Beams of the lasers every `step_deg` that meet walls or floor of the flat scene.

    Parameters
    ----------
    world : World
    scanner, position : str
    step_deg : float
        The default gives a tenth of the medians, so that runs are quick. It is about twice the
        length over which the fixed pattern is correlated, so that the correlation remains.
    every : int
        One laser of this number has beams; 1 for all lasers.
    """
    known, factory = SCANNERS[scanner], factory_parameters(world, scanner)
    angles = np.deg2rad(np.arange(0.0, 360.0 - 0.5 * step_deg, step_deg))
    laser = np.repeat(np.arange(known.n_lasers), len(angles))
    phi = np.tile(angles, known.n_lasers)
    surfaces = {name: replace(s, relief=None) for name, s in site_surfaces(world).items()}
    pose = world.pose(position)
    direction, origin = laser_beams(phi, laser, factory)
    direction, origin = direction @ pose.rotation.T, pose.apply(origin)
    length, plane = cast(surfaces, origin, direction)
    kept = (plane >= 0) & (plane < len(PLANES))
    kept &= (length >= world.scanner(scanner).min_range_m) & (laser % every == 0)
    for index, name in enumerate(PLANES):
        surface = surfaces[name]
        own = plane == index
        hit = origin[own] + length[own, None] * direction[own] - surface.corner
        for axis, extent in zip((surface.across, surface.up), surface.size, strict=True):
            kept[own] &= np.abs(hit @ axis - 0.5 * extent) <= 0.5 * extent - 2.0 * EDGE_M
        kept[own] &= np.abs(direction[own] @ surface.normal) >= np.cos(INCIDENCE_RAD)
    return Geometry(world, scanner, position, factory, phi[kept], laser[kept], plane[kept])


def true_parameters(
    rng: np.random.Generator, start: LaserParameters, stochastic: Stochastic, names: Sequence[str]
) -> LaserParameters:
    """Draw true parameters about the start from the prior of the stochastic model.

    Intervals that contain prior knowledge can only be right on average over the prior. With the
    errors of the world instead, the result would depend on the constants of the world.

    Parameters
    ----------
    rng : Generator
    start : LaserParameters
    stochastic : Stochastic
    names : sequence of str
        Parameters to draw.
    """
    return start.corrected(
        {
            name: rng.normal(0.0, stochastic.prior_std[name], len(start))
            for name in names
            if name != "scale"
        }
    )


def white_draws(
    at: Geometry, stochastic: Stochastic, names: Sequence[str], runs: int, seed: int
) -> Iterator[Draw]:
    """Draw runs with white noise of distance and angle as stated, and an exact survey.

    Parameters
    ----------
    at : Geometry
    stochastic : Stochastic
        Sizes of the noise, and prior of the true parameters.
    names : sequence of str
        Parameters that are drawn.
    runs, seed : int
    """
    surfaces = _flat(at.world)
    planes = [_plane_of(surface, at.world.pose(at.position)) for surface in surfaces]
    for run in range(runs):
        rng = _rng(seed, run)
        true = true_parameters(rng, at.factory, stochastic, names)
        length = _ranges(at, true, surfaces)
        n = len(length)
        distance = length - true.dl[at.laser_id] + rng.normal(0.0, stochastic.noise_std_m, n)
        phi = at.phi + rng.normal(0.0, stochastic.angle_std_rad, n)
        yield Draw(_observations(at, distance, phi, planes), None, true)


def full_draws(
    at: Geometry,
    stochastic: Stochastic,
    names: Sequence[str],
    runs: int,
    seed: int,
    *,
    rotations: int = 100,
    scenes: int = 25,
) -> Iterator[Draw]:
    """Draw runs with all errors of the world.

    The errors are a fixed pattern correlated along azimuth with a size per laser, range scale,
    shift and drift, noise of the medians, and angle steps. Base targets and wall targets are
    measured anew in every run. The common mean of the shifts at a position is left out, as it does
    not scatter.

    Parameters
    ----------
    at : Geometry
    stochastic : Stochastic
        Size of the angle steps, and prior of the true parameters.
    names : sequence of str
        Parameters that are drawn.
    runs, seed : int
    rotations : int
        Number of shots of a median.
    scenes : int
        Number of reliefs of walls and floor; the runs take them in turn.
    """
    errors, n_lasers = at.errors, len(at.factory)
    factors = _pattern_factors(at)
    worlds = [
        at.world.model_copy(update={"seed": int(s)})
        for s in _rng(seed, 0, 1).integers(2**31, size=scenes)
    ]
    sites = [site_surfaces(world) for world in worlds]
    reliefs = [[site[name] for name in PLANES] for site in sites]
    targets = [true_targets(world, world.site.targets, "targets").xyz for world in worlds]
    design = _design(at)
    for run in range(runs):
        rng = _rng(seed, run, 2)
        true = true_parameters(rng, at.factory, stochastic, names)
        scene = run % scenes
        station = _survey(at, rng, targets[scene], design)
        length = _ranges(at, true, reliefs[scene])
        size = np.exp(rng.normal(0.0, errors.pattern_log, n_lasers)) * errors.pattern_median_cm
        shift = (
            rng.normal(0.0, errors.shift_cm, n_lasers)
            + rng.normal(0.0, errors.drift_laser_cm, n_lasers)
            + rng.normal(0.0, errors.drift_common_cm)
            + rng.normal(0.0, errors.drift_window_cm, n_lasers)
        )
        shot = np.exp(rng.normal(0.0, errors.noise_log, n_lasers)) * errors.noise_median_cm
        median = shot * MEDIAN_PER_MEAN / np.sqrt(rotations)
        scale = rng.normal(0.0, errors.range_scale_cm_per_m * 1e-2, n_lasers)
        pattern = np.concatenate([f @ rng.standard_normal(len(f)) for f in factors])
        laser = at.laser_id
        distance = length * (1.0 + scale[laser]) - true.dl[laser]
        distance += (shift[laser] + size[laser] * pattern) * 1e-2
        distance += median[laser] * 1e-2 * rng.standard_normal(len(laser))
        phi = at.phi + rng.normal(0.0, stochastic.angle_std_rad, len(laser))
        planes = [patch.plane for patch in station.patches]
        yield Draw(_observations(at, distance, phi, planes), station.uncertainty(), true)


def exact(at: Geometry) -> Observations:
    """Observations without any error, at the factory's parameters and on flat planes."""
    surfaces = _flat(at.world)
    planes = [_plane_of(surface, at.world.pose(at.position)) for surface in surfaces]
    distance = _ranges(at, at.factory, surfaces) - at.factory.dl[at.laser_id]
    return _observations(at, distance, at.phi, planes)


def _rng(*key: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(key[0], spawn_key=key[1:]))


def _flat(world: World) -> list[Surface]:
    surfaces = site_surfaces(world)
    return [replace(surfaces[name], relief=None) for name in PLANES]


def _plane_of(surface: Surface, pose: RigidTransformation) -> Plane:
    """Exact plane of a flat surface in the scanner frame; the normal away from the scanner."""
    normal = -surface.normal @ pose.rotation
    offset = -float(normal @ pose.inverse().apply(surface.corner))
    return Plane(normal, offset, np.zeros((4, 4)))


def _ranges(at: Geometry, true: LaserParameters, surfaces: Sequence[Surface]) -> Array:
    """Range to the surface of every beam, with its relief; the surfaces have no edges."""
    direction, origin = laser_beams(at.phi, at.laser_id, true)
    pose = at.world.pose(at.position)
    direction, origin = direction @ pose.rotation.T, pose.apply(origin)
    length = np.empty(len(at.phi))
    for index, surface in enumerate(surfaces):
        own = at.plane == index
        towards = direction[own] @ surface.normal
        flat = (surface.corner - origin[own]) @ surface.normal / towards
        if surface.relief is not None:
            hit = origin[own] + flat[:, None] * direction[own] - surface.corner
            flat = flat + surface.relief(hit @ surface.across, hit @ surface.up) / towards
        length[own] = flat
    return length


def _observations(
    at: Geometry, distance: Array, phi: Array, planes: Sequence[Plane]
) -> Observations:
    normals = np.stack([plane.normal for plane in planes])
    offsets = np.array([plane.offset for plane in planes])
    return Observations(distance, phi, at.laser_id, normals[at.plane], offsets[at.plane], at.plane)


def _pattern_factors(at: Geometry) -> list[Array]:
    """Matrices F per laser: F z, with z of white noise, has the correlation of the fixed pattern.

    White noise smoothed by a Gaussian kernel of width k has the correlation exp(-d^2 / 4 k^2).
    """
    width = np.deg2rad(at.errors.pattern_kernel_deg)
    factors = []
    for laser in range(len(at.factory)):
        phi = at.phi[at.laser_id == laser]
        apart = np.mod(phi[:, None] - phi + np.pi, 2.0 * np.pi) - np.pi
        values, vectors = np.linalg.eigh(np.exp(-((apart / width) ** 2) / 4.0))
        factors.append(vectors * np.sqrt(np.maximum(values, 0.0)))
    return factors


@dataclass(frozen=True)
class _Design:
    """Targets of a position, and covariances of their survey with their matrix roots."""

    planes: Targets
    base_scanner: Targets
    base_site: Targets
    roots: tuple[Array, Array, Array]
    covariances: Mapping[str, Array]


def _design(at: Geometry) -> _Design:
    """Adjust the survey once, without errors: its covariances hold for all runs."""
    survey = adjust_field_book(field_book(at.world, noise=False), a_priori=True)
    parts = survey.planes, survey.base_scanner[at.scanner].targets, survey.base_site[at.position]
    roots = []
    for part in parts:
        values, vectors = np.linalg.eigh(part.covariance())
        roots.append(vectors * np.sqrt(np.maximum(values, 0.0)))
    return _Design(*parts, (roots[0], roots[1], roots[2]), survey.planes.plane_covariances())


def _survey(at: Geometry, rng: np.random.Generator, targets: Array, design: _Design) -> Station:
    """Survey of the position with new errors of all targets, and its adjustment."""
    base = base_targets_true(at.world, at.scanner).xyz
    parts = design.planes, design.base_scanner, design.base_site
    true = targets, base, at.world.pose(at.position).apply(base)
    planes, scanner, site = (
        replace(part, xyz=xyz + (root @ rng.standard_normal(len(root))).reshape(-1, 3))
        for part, xyz, root in zip(parts, true, design.roots, strict=True)
    )
    return Station.adjust(
        planes, scanner, site, PLANES, covariances=design.covariances, where="Monte Carlo"
    )
