"""Beams of a unit at a site, and the medians of the distances that it measures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.arrays import Array
from velocal.scanner.models import AZIMUTH_TICK_DEG, Scanner
from velocal.scanner.parameters import LaserParameters
from velocal.simulation.independent.plan import Noise, Plan
from velocal.simulation.independent.site import Pose, Surface
from velocal.survey.station import Station

#: Far point of a factory's two-point calibration, metres.
FAR_M = 25.04
#: Beams count that meet a surface this far inside its edges, and at most at this incidence.
MARGIN_M, INCIDENCE = 0.12, np.cos(np.deg2rad(79.0))
#: Standard deviation of the median of n normal values, times the root of n.
_MEDIAN = np.sqrt(np.pi / 2.0)
_DEG, _CM, _MM = np.pi / 180.0, 1e-2, 1e-3


def correction(
    true: LaserParameters,
    slope: Array,
    length: Array | float,
    laser: NDArray[np.integer] | slice,
) -> Array:
    """True distance correction at a range; see `trial.Trial.correction`."""
    return np.asarray(true.dl[laser] + slope[laser] * np.minimum(np.subtract(length, FAR_M), 0.0))


def rays(phi: Array, laser: NDArray[np.integer], true: LaserParameters) -> tuple[Array, Array]:
    """Origins and unit directions of beams in the scanner frame.

    In the plane of X + iY, the head turns clockwise: a laser that looks along Y at azimuth zero is
    turned by ``exp(-i (phi - alpha))``, together with its origin, which lies to the left.

    Parameters
    ----------
    phi : ndarray, shape (n,)
        Rotational angles, radians.
    laser : ndarray of int, shape (n,)
    true : LaserParameters

    Returns
    -------
    origin, direction : ndarray, shape (n, 3)
        Metres.
    """
    turn = np.exp(-1j * (phi - true.alpha[laser]))
    ahead = 1j * np.cos(true.v[laser]) * turn
    aside = -true.hoff[laser] * turn
    origin = np.column_stack([aside.real, aside.imag, true.voff[laser]])
    return origin, np.column_stack([ahead.real, ahead.imag, np.sin(true.v[laser])])


def along(n: int, step_deg: float, noise: Noise, rng: np.random.Generator, rows: int) -> Array:
    """Random functions of unit variance on a full turn.

    Parameters
    ----------
    n : int
        Steps of the turn.
    step_deg : float
    noise : Noise
        Length and form of the correlation.
    rng : Generator
    rows : int
        Number of functions.

    Returns
    -------
    ndarray, shape (rows, n)
    """
    apart = np.minimum(np.arange(n), n - np.arange(n)) * step_deg / noise.pattern_deg
    correlation = np.exp(-(apart**2) / 4.0) if noise.pattern_gaussian else np.exp(-apart)
    power = np.sqrt(np.maximum(np.fft.rfft(correlation).real, 0.0))
    white = np.fft.rfft(rng.standard_normal((rows, n)), axis=1)
    return np.asarray(np.fft.irfft(white * power, n=n, axis=1))


class Shots:
    """Medians of distances of one unit at one site.

    Parameters
    ----------
    plan : Plan
    scanner : Scanner
    true : LaserParameters
    slope : ndarray, shape (lasers,)
        See `trial.Trial`.
    surfaces : list of Surface
        In the order of `Plan.surfaces`.
    rng : Generator
        For what belongs to the unit: sizes of its noise and its errors on surfaces.
    """

    def __init__(
        self,
        plan: Plan,
        scanner: Scanner,
        true: LaserParameters,
        slope: Array,
        surfaces: list[Surface],
        rng: np.random.Generator,
    ) -> None:
        noise, n = plan.errors, scanner.n_lasers
        self.plan, self.noise, self.true, self.slope = plan, noise, true, slope
        self.surfaces, self.tick_m = surfaces, scanner.distance_tick_m
        self.step_deg = scanner.azimuth_bin_ticks * AZIMUTH_TICK_DEG
        self.shot = noise.shot_cm * _CM * np.exp(rng.normal(0.0, 0.3, n))
        self.size = noise.pattern_cm * _CM * np.exp(rng.normal(0.0, noise.pattern_log, n))
        self.near = noise.near_cm * _CM * rng.standard_normal(n)
        shape = n, len(surfaces)
        moved = rng.uniform(0.0, 1.0, shape) < noise.surface_share
        size = rng.uniform(*noise.surface_mm, shape) * _MM * rng.choice([-1.0, 1.0], shape)
        self.of_surface = np.where(moved, size, 0.0)

    def windows(
        self, rng: np.random.Generator, pose: Pose, survey: Station | None, count: int
    ) -> list[Observations]:
        """Measure the medians of every window at a station.

        Parameters
        ----------
        rng : Generator
        pose : Pose
        survey : Station or None
            Its planes; the true ones if None.
        count : int
            Number of windows.
        """
        noise, n_lasers = self.noise, len(self.true)
        steps = round(360.0 / self.step_deg)
        bins = np.arange(0, steps, self.plan.every)
        pattern = self.size[:, None] * along(steps, self.step_deg, noise, rng, n_lasers)
        shift = rng.normal(0.0, noise.shift_cm * _CM, n_lasers)
        laser = np.repeat(np.arange(n_lasers), len(bins))
        cell = np.tile(bins, n_lasers)
        phi: Array = np.asarray((cell + 0.5) * self.step_deg * _DEG, dtype=np.float64)
        length, surface = self._cast(pose, phi, laser)
        hit = surface >= 0
        phi, length, cell = phi[hit], length[hit], cell[hit]
        laser, surface = laser[hit], surface[hit]
        raw = length - correction(self.true, self.slope, length, laser)
        raw += pattern[laser, cell] + shift[laser] + self.of_surface[laser, surface]
        raw += self.near[laser] / (1.0 + np.exp((length - 2.0) / 0.25))
        return [self._median(rng, pose, survey, raw, phi, laser, surface) for _ in range(count)]

    def _median(
        self,
        rng: np.random.Generator,
        pose: Pose,
        survey: Station | None,
        raw: Array,
        phi: Array,
        laser: NDArray[np.integer],
        surface: NDArray[np.integer],
    ) -> Observations:
        noise, n = self.noise, len(raw)
        drift = rng.normal(0.0, noise.drift_cm * _CM, len(self.true))
        median = self.shot * _MEDIAN / np.sqrt(self.plan.shots)
        distance = raw + drift[laser] + median[laser] * rng.standard_normal(n)
        # The median of an even number of ticks is a multiple of half a tick.
        distance = np.round(2.0 * distance / self.tick_m) * 0.5 * self.tick_m
        rows = {
            "distance_m": distance,
            "phi_rad": phi + noise.azimuth_deg * _DEG * rng.standard_normal(n),
            "laser_id": laser,
            "plane": surface,
        }
        if survey is not None:
            return survey.observations(rows)
        normals = np.array([each.normal for each in self.surfaces]) @ pose.axes
        offsets = [each.normal @ (pose.at - each.corner) for each in self.surfaces]
        return Observations(
            distance,
            rows["phi_rad"],
            laser,
            normals[surface],
            np.array(offsets)[surface],
            surface,
        )

    def _cast(
        self, pose: Pose, phi: Array, laser: NDArray[np.integer]
    ) -> tuple[Array, NDArray[np.int64]]:
        """Range to the first surface that each beam meets, and its number; -1 where none counts."""
        origin, direction = rays(phi, laser, self.true)
        origin, direction = pose.to_site(origin), pose.turned(direction)
        nearest, number = np.full(len(phi), np.inf), np.full(len(phi), -1)
        counts = np.zeros(len(phi), dtype=bool)
        for index, surface in enumerate(self.surfaces):
            towards = direction @ surface.normal
            with np.errstate(divide="ignore", invalid="ignore"):
                length = (surface.corner - origin) @ surface.normal / towards
            near = np.flatnonzero((length > 0.3) & (length < nearest))
            for _ in range(2):  # the second time at the place where the relief is met
                place = origin[near] + length[near, None] * direction[near] - surface.corner
                a, b = (place @ surface.axes.T).T
                flat = (surface.corner - origin[near]) @ surface.normal / towards[near]
                length[near] = flat + surface.relief(a, b) / towards[near]
            wide, high = surface.extent
            inside = (a >= 0.0) & (a <= wide) & (b >= 0.0) & (b <= high)
            within = (a >= MARGIN_M) & (a <= wide - MARGIN_M)
            within &= (b >= MARGIN_M) & (b <= high - MARGIN_M)
            within &= np.abs(towards[near]) >= INCIDENCE
            near = near[inside]
            nearest[near], number[near], counts[near] = length[near], index, within[inside]
        return nearest, np.where(counts, number, -1)
