"""Outdoor scenes: two drywall panels ahead of the scanner, with fog and people between them.

A scene has a kind, which has the constants, and a number, which selects the distance: real3 is
the third scene of the kind real. Fog and people are no surfaces: they change single shots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.geometry.rigid import RigidTransformation, rotation_from_vector
from velocal.scanner.models import SCANNERS
from velocal.simulation.scene import Scene, Surface, draw_relief
from velocal.simulation.truth import UnitTruth, position_errors, unit_truth
from velocal.simulation.world import World
from velocal.study.world import OutdoorWorld, PanelWorld, People

#: Half the width of the simulated square of ground, metres.
GROUND_M = 150.0
#: Intensity of the returns of the ground and of the two panels.
REFLECTANCE = (30.0, 75.0, 75.0)


@dataclass(frozen=True)
class Person:
    """A person who walks at constant velocity: an upright cylinder in the frame of the scanner.

    Attributes
    ----------
    start, velocity : ndarray, shape (2,)
        Place at time zero, metres, and velocity, metres per second.
    radius_m, bottom_m, top_m : float
        Radius, and heights of feet and head.
    """

    start: Array
    velocity: Array
    radius_m: float
    bottom_m: float
    top_m: float

    def range(self, time_s: Array, azimuth: Array) -> Array:
        """Horizontal range at which beams meet the person; infinite where they do not."""
        centre = self.start + time_s[:, None] * self.velocity
        ahead = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
        along = np.einsum("ni,ni->n", centre, ahead)
        aside = centre[:, 0] * ahead[:, 1] - centre[:, 1] * ahead[:, 0]
        depth = self.radius_m**2 - aside**2
        met = (depth > 0) & (along > self.radius_m)
        return np.where(met, along - np.sqrt(np.maximum(depth, 0.0)), np.inf)


@dataclass(frozen=True)
class Air:
    """Fog and people between a scanner and the panels.

    Attributes
    ----------
    truth : UnitTruth
        Of the scanner; it gives the raw distance to a person.
    tick_m : float
        One tick of the raw distance of the scanner, metres.
    people : sequence of Person
    lost_per_m, early_per_m : float
        Rates per metre of range at which shots are lost in fog, and at which fog reflects them
        before they reach a surface.
    noise : float
        Noise that fog adds, as a share of the noise of a shot.
    """

    truth: UnitTruth
    tick_m: float
    people: Sequence[Person]
    lost_per_m: float
    early_per_m: float
    noise: float

    def __call__(
        self,
        rng: np.random.Generator,
        time_s: Array,
        angle: Array,
        ideal: NDArray[np.float32],
    ) -> NDArray[np.float32]:
        """Change the raw distances of firings.

        Parameters
        ----------
        rng : Generator
        time_s, angle : ndarray, shape (n,)
            Time since the start of the recording, and azimuth of the head (radians).
        ideal : ndarray of float32, shape (n, lasers)
            Raw distances without noise, ticks; NaN for none.

        Returns
        -------
        ndarray of float32, shape (n, lasers)
            Ticks.
        """
        ticks = ideal.copy()
        for person in self.people:
            self._walk(person, time_s, angle, ticks)
        if not (self.lost_per_m or self.early_per_m or self.noise):
            return ticks
        length = np.nan_to_num(ticks).astype(np.float64) * self.tick_m
        laser = np.broadcast_to(np.arange(ticks.shape[1]), ticks.shape)
        noise = self.noise / self.tick_m * self.truth.noise(length, laser).astype(np.float32)
        ticks += noise * rng.standard_normal(ticks.shape, dtype=np.float32)
        chance = rng.random(ticks.shape, dtype=np.float32)
        early = chance < -np.expm1(-self.early_per_m * length)
        # Fog that reflects enough light is near: the square of a uniform share of the range.
        ticks[early] *= rng.random(int(early.sum()), dtype=np.float32) ** 2
        ticks[1.0 - chance < -np.expm1(-self.lost_per_m * length)] = np.nan
        return ticks

    def _walk(
        self, person: Person, time_s: Array, angle: Array, ticks: NDArray[np.float32]
    ) -> None:
        """Shorten the raw distances of shots that meet a person before they meet a surface."""
        parameters = self.truth.parameters
        # Only firings of which some laser may meet the person.
        centre = person.start + time_s[:, None] * person.velocity
        off = np.mod(angle - np.arctan2(centre[:, 0], centre[:, 1]) + np.pi, 2.0 * np.pi) - np.pi
        reach = 2.0 * person.radius_m / np.hypot(*centre.T) + np.max(np.abs(parameters.alpha))
        near = np.flatnonzero(np.abs(off) < reach)
        for laser in range(len(parameters)):
            flat = person.range(time_s[near], angle[near] - parameters.alpha[laser])
            v = parameters.v[laser]
            with np.errstate(invalid="ignore"):
                height = parameters.voff[laser] + flat * np.tan(v)
            met = np.isfinite(flat) & (height > person.bottom_m) & (height < person.top_m)
            raw = self.truth.raw(flat[met] / np.cos(v), np.full(np.count_nonzero(met), laser))
            rows = near[met]
            ticks[rows, laser] = np.fmin(ticks[rows, laser], raw / self.tick_m)


def outdoor_scene(world: World, scanner: str, name: str, duration_s: float) -> Scene:
    """Build a scene around a scanner.

    Parameters
    ----------
    world : World
    scanner, name : str
        Name of the scanner, which has its own tilt and its own people in the scene, and of the
        scene.
    duration_s : float
        Length of the recording, within which people cross the panels.

    Raises
    ------
    ConfigError
        If the world has no such scene.
    """
    kind, distance_m = world.scene(name)
    outdoor = cast(OutdoorWorld, world.outdoor)
    rng = world.rng("outdoor", scanner, name)
    tilt = np.deg2rad([*rng.normal(0.0, outdoor.tilt_deg, 2), 0.0])
    turn = np.array([0.0, 0.0, np.deg2rad(outdoor.azimuth_deg)])
    pose = RigidTransformation(
        rotation_from_vector(tilt) @ rotation_from_vector(turn),
        np.array([0.0, 0.0, outdoor.base_height_m]),
        np.zeros((6, 6)),
    )
    surfaces = {"ground": _ground(), **_panels(world, outdoor.panel, name, distance_m)}
    people = _people(rng, kind.people, outdoor, distance_m, duration_s)
    air = Air(
        truth=unit_truth(world, scanner),
        tick_m=SCANNERS[scanner].distance_tick_m,
        people=people,
        lost_per_m=kind.fog.lost_per_m,
        early_per_m=kind.fog.early_per_m,
        noise=kind.fog.noise,
    )
    errors = outdoor.position_share * position_errors(world, scanner, name)
    return Scene(surfaces, np.array(REFLECTANCE), pose, errors, air)


def _ground() -> Surface:
    ex, ey, ez = np.eye(3)
    corner = np.array([-GROUND_M, -GROUND_M, 0.0])
    return Surface("ground", corner, ex, ey, ez, (2.0 * GROUND_M, 2.0 * GROUND_M))


def _panels(world: World, panel: PanelWorld, name: str, distance_m: float) -> dict[str, Surface]:
    """Two upright panels side by side, each turned by a small angle; the same for every scanner."""
    width, height, gap = panel.width_m, panel.height_m, panel.gap_m
    up = np.array([0.0, 0.0, 1.0])
    panels = {}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        rng = world.rng("panel", name, side)
        turned = rng.normal(0.0, np.deg2rad(panel.turned_deg))
        across = np.array([np.cos(turned), np.sin(turned), 0.0])
        middle = np.array([sign * 0.5 * (width + gap), distance_m, panel.bottom_m])
        relief = draw_relief(rng, (width, height), panel.flatness)
        normal = np.cross(up, across) * -1.0
        panels[side] = Surface(
            side, middle - 0.5 * width * across, across, up, normal, (width, height), relief
        )
    return panels


def _people(
    rng: np.random.Generator,
    constants: People,
    outdoor: OutdoorWorld,
    distance_m: float,
    duration_s: float,
) -> list[Person]:
    """People who cross the way to the panels at some time of the recording."""
    azimuth = np.deg2rad(outdoor.azimuth_deg)
    ahead = np.array([np.sin(azimuth), np.cos(azimuth)])
    aside = np.array([ahead[1], -ahead[0]])
    people = []
    for _ in range(constants.count):
        place = rng.uniform(0.2, 0.9) * distance_m * ahead
        velocity = constants.speed_m_s * rng.choice([-1.0, 1.0]) * aside
        crossing = rng.uniform(0.0, duration_s)
        people.append(
            Person(
                place - crossing * velocity,
                velocity,
                constants.radius_m,
                -outdoor.base_height_m,
                constants.height_m - outdoor.base_height_m,
            )
        )
    return people
