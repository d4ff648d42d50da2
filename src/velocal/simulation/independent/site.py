"""Walls and floor with their relief, poses of the scanner in front of them, and their survey."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from velocal.arrays import Array
from velocal.simulation.independent.plan import SURFACES, Plan, SurveyErrors
from velocal.survey.station import Station
from velocal.survey.targets import Targets

#: Targets on walls and floor lie this far inside the edges.
TARGET_MARGIN_M = 0.05
_DEG, _MM = np.pi / 180.0, 1e-3


@dataclass(frozen=True)
class Surface:
    """A rectangle with a relief.

    Attributes
    ----------
    name : str
    corner : ndarray, shape (3,)
        Site frame, metres.
    sides : ndarray, shape (2, 3)
        Two orthogonal sides, from the corner on, metres.
    heights : ndarray, shape (i, j)
        Relief above the plane on a grid along the sides, metres.
    """

    name: str
    corner: Array
    sides: Array
    heights: Array

    @property
    def extent(self) -> Array:
        """Lengths of both sides, metres."""
        return np.asarray(np.linalg.norm(self.sides, axis=1))

    @property
    def axes(self) -> Array:
        """Unit vectors along the sides, shape (2, 3)."""
        return np.asarray(self.sides / self.extent[:, None])

    @property
    def normal(self) -> Array:
        """Unit normal."""
        return np.cross(*self.axes)

    def relief(self, a: Array, b: Array) -> Array:
        """Height above the plane at coordinates along the sides, metres, linear in the grid."""
        cells = np.array(self.heights.shape) - 1
        at = np.clip(np.column_stack([a, b]) / self.extent, 0.0, 1.0) * cells
        i, j = np.minimum(at.astype(int), cells - 1).T
        p, q = at.T - (i, j)
        low = self.heights[i, j] * (1.0 - p) + self.heights[i + 1, j] * p
        high = self.heights[i, j + 1] * (1.0 - p) + self.heights[i + 1, j + 1] * p
        return np.asarray(low * (1.0 - q) + high * q)


@dataclass(frozen=True)
class Pose:
    """Where the scanner stands.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Its columns are the X, Y and Z of the scanner in the site frame.
    at : ndarray, shape (3,)
        Origin of the scanner in the site frame, metres.
    """

    axes: Array
    at: Array

    def to_site(self, points: Array) -> Array:
        """Points of the scanner frame in the site frame, shape (n, 3)."""
        return np.asarray(points @ self.axes.T + self.at)

    def turned(self, directions: Array) -> Array:
        """Directions of the scanner frame in the site frame, shape (n, 3)."""
        return np.asarray(directions @ self.axes.T)


def surface_of(rng: np.random.Generator, name: str, flatness_mm: float) -> Surface:
    """Surface with a relief of many bumps, whose root mean square about its plane is as stated."""
    corner, *sides = (np.array(each) for each in SURFACES[name])
    bare = Surface(name, corner, np.array(sides), np.zeros((2, 2)))
    steps = [np.arange(0.0, 1.0 + 1e-9, 1.0 / round(length / 0.03)) for length in bare.extent]
    a, b = (share * length for share, length in zip(steps, bare.extent, strict=True))
    heights = np.zeros((len(a), len(b)))
    for _ in range(max(8, round(6.0 * a[-1] * b[-1]))):
        width = rng.uniform(0.2, 0.7)
        at_a, at_b = (rng.uniform(-0.3, side[-1] + 0.3) for side in (a, b))
        bump = np.outer(
            np.exp(-0.5 * ((a - at_a) / width) ** 2), np.exp(-0.5 * ((b - at_b) / width) ** 2)
        )
        heights += rng.standard_normal() * bump
    plane = np.column_stack(
        [np.ones(heights.size), *(x.ravel() for x in np.meshgrid(a, b, indexing="ij"))]
    )
    heights -= (plane @ np.linalg.lstsq(plane, heights.ravel())[0]).reshape(heights.shape)
    return replace(bare, heights=heights * flatness_mm * _MM / heights.std())


def pose_at(
    rng: np.random.Generator, place: tuple[float, float, float], tilt_deg: float, number: int
) -> Pose:
    """Pose near a place, with some tenths of a degree of tilt besides the one that is wanted."""
    x, y, heading = place
    heading += rng.normal(0.0, 5.0)
    lean = tilt_deg * np.exp(1j * (0.6 + 0.5 * np.pi * number)) + complex(*rng.normal(0.0, 0.3, 2))
    up = np.array([np.sin(lean.real * _DEG), np.sin(lean.imag * _DEG), 0.0])
    up[2] = np.sqrt(1.0 - up @ up)
    ahead = np.array([np.sin(heading * _DEG), np.cos(heading * _DEG), 0.0])
    ahead -= (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    axes = np.column_stack([np.cross(ahead, up), ahead, up])
    at = np.array([x, y, 0.95]) + rng.normal(0.0, 0.05, 3)
    return Pose(axes, at)


def base_targets(survey: SurveyErrors) -> Array:
    """True places of the targets on the base of the scanner, in its frame."""
    angle = 2.0 * np.pi * np.arange(survey.base_targets) / survey.base_targets
    height = 0.3 * survey.base_m * (np.arange(survey.base_targets) % 2)
    return np.column_stack([survey.base_m * np.cos(angle), survey.base_m * np.sin(angle), height])


def wall_targets(
    rng: np.random.Generator, surfaces: list[Surface], survey: SurveyErrors
) -> Targets:
    """Measured targets on all surfaces: some in the corners, the others anywhere on them."""
    xyz, names, group = [], [], []
    for surface in surfaces:
        n, limit = survey.wall_targets, surface.extent - 2.0 * TARGET_MARGIN_M
        share = rng.uniform(0.0, 1.0, (n, 2))
        share[:4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
        a, b = (TARGET_MARGIN_M + share * limit).T
        flat = surface.corner + np.column_stack([a, b]) @ surface.axes
        xyz.append(flat + surface.relief(a, b)[:, None] * surface.normal)
        names += [f"{surface.name}{i + 1}" for i in range(n)]
        group += [surface.name] * n
    std = np.full((len(names), 3), survey.wall_mm * _MM)
    return Targets(
        tuple(names), tuple(group), np.concatenate(xyz) + std * rng.standard_normal(std.shape), std
    )


def survey_of(
    rng: np.random.Generator,
    plan: Plan,
    pose: Pose,
    walls: Targets,
    sheet: Array,
    position: str,
) -> Station:
    """Measure the base at a station, and let the project adjust pose and planes."""
    survey, n = plan.survey, plan.survey.base_targets
    names = tuple(f"B{i + 1}" for i in range(n))
    site = pose.to_site(base_targets(survey))
    std = np.full((n, 3), survey.site_mm * _MM)
    on_site = Targets(names, (position,) * n, site + std * rng.standard_normal(site.shape), std)
    of_scanner = Targets(
        names, (plan.scanner,) * n, sheet, np.full((n, 3), survey.scanner_mm * _MM)
    )
    return Station.adjust(walls, of_scanner, on_site, plan.surfaces, where="independent world")
