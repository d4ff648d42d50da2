"""The scene: bounded planes with their deviations from flatness, and beams that meet them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.geometry.rigid import RigidTransformation
from velocal.simulation.truth import position_errors
from velocal.simulation.world import World
from velocal.study.world import Flatness


@dataclass(frozen=True)
class Relief:
    """Smooth deviation of a surface from its plane, in metres along its normal.

    A sum of cosines whose mean absolute value is the printed one, and one bump that reaches the
    printed largest deviation.

    Attributes
    ----------
    waves : ndarray, shape (n, 4)
        Amplitude (metres), wave numbers along `across` and `up` (radians per metre), phase.
    bump : ndarray, shape (4,)
        Height, centre along `across` and `up`, and width (metres); no bump if the height is zero.
    """

    waves: Array
    bump: Array

    def __call__(self, across: Array, up: Array) -> Array:
        """Deviation at coordinates in the plane, metres, in the shape of the coordinates."""
        height = np.zeros_like(across)
        for size, wave_a, wave_b, phase in self.waves:
            height += size * np.cos(wave_a * across + wave_b * up + phase)
        if self.bump[0]:
            size, centre_a, centre_b, width = self.bump
            square = (across - centre_a) ** 2 + (up - centre_b) ** 2
            height += size * np.exp(-square / (2.0 * width**2))
        return height


@dataclass(frozen=True)
class Surface:
    """A rectangle: corner, two orthonormal axes with extents, and its relief.

    Attributes
    ----------
    name : str
    corner, across, up, normal : ndarray, shape (3,)
        The normal points to the side from which the surface is seen.
    size : tuple of float
        Extent along `across` and `up`, metres.
    relief : Relief or None
    """

    name: str
    corner: Array
    across: Array
    up: Array
    normal: Array
    size: tuple[float, float]
    relief: Relief | None = None

    def at(self, a: Array, b: Array) -> Array:
        """Points of the true surface at coordinates in the plane, shape (n, 3)."""
        base = self.corner + a[:, None] * self.across + b[:, None] * self.up
        if self.relief is None:
            return base
        return base + self.relief(a, b)[:, None] * self.normal

    def meet(self, origin: Array, direction: Array) -> Array:
        """Range at which beams, shape (n, 3), meet the surface; infinite where they do not."""
        # Height above the plane, and coordinates in it; then their changes along the beam.
        axes = np.stack([self.normal, self.across, self.up])
        from_height, from_a, from_b = axes @ origin.T - (axes @ self.corner)[:, None]
        towards, along_a, along_b = axes @ direction.T
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = -from_height / towards
            a, b = from_a + flat * along_a, from_b + flat * along_b
            inside = (flat > 0) & (a >= 0) & (a <= self.size[0]) & (b >= 0) & (b <= self.size[1])
        if self.relief is not None:
            flat[inside] += self.relief(a[inside], b[inside]) / towards[inside]
        return np.where(inside, flat, np.inf)


#: Whatever is between scanner and surfaces, and changes single shots; see `outdoor.Air`.
Between = Callable[[np.random.Generator, Array, Array, NDArray[np.float32]], NDArray[np.float32]]


@dataclass(frozen=True)
class Scene:
    """Surroundings of a scanner, its pose, and the errors that it has there.

    Attributes
    ----------
    surfaces : dict of str to Surface
    reflectance : ndarray
        Intensity of the returns of each surface.
    pose : RigidTransformation
        `T_scene_scanner`.
    errors : ndarray, shape (36000, n) or (36000, 1)
        Range errors that stay with the place, metres, over raw azimuth; see `position_errors`.
    between : Between or None
    """

    surfaces: dict[str, Surface]
    reflectance: Array
    pose: RigidTransformation
    errors: Array
    between: Between | None = None


def draw_relief(rng: np.random.Generator, size: tuple[float, float], flatness: Flatness) -> Relief:
    """Draw a relief whose mean and largest absolute deviation are as printed.

    Both are deviations from the plane that fits best, as a surveyor finds them. Waves are drawn
    until the ratio of their largest to their mean deviation is at most the printed one.

    Parameters
    ----------
    rng : Generator
    size : tuple of float
        Extent of the surface, metres.
    flatness : Flatness
    """
    mean_m, max_m = flatness.mean_mm * 1e-3, flatness.max_mm * 1e-3
    wanted = 0.95 * max_m / mean_m if mean_m else np.inf
    drawn, least = np.zeros((0, 4)), np.inf
    for _ in range(100):
        waves = _draw_waves(rng, int(rng.integers(2, 7)))
        _, _, height = _about_plane(Relief(waves, np.zeros(4)), size, 30)
        ratio = float(np.max(np.abs(height)) / np.mean(np.abs(height)))
        if ratio < least:
            drawn, least = waves, ratio
        if least <= wanted:
            break
    a, b, height = _about_plane(Relief(drawn, np.zeros(4)), size, 200)
    # The waves alone must stay below the largest deviation, the bump then reaches it.
    scale = min(mean_m / np.mean(np.abs(height)), 0.95 * max_m / np.max(np.abs(height)))
    drawn[:, 0] *= scale
    top = int(np.argmax(height))
    return Relief(drawn, np.array([max_m - scale * height[top], a[top], b[top], 0.3]))


def _draw_waves(rng: np.random.Generator, n: int) -> Array:
    wavelengths, heading = rng.uniform(0.7, 2.5, n), rng.uniform(0.0, np.pi, n)
    return np.column_stack(
        [
            rng.uniform(0.5, 1.0, n),
            2 * np.pi / wavelengths * np.cos(heading),
            2 * np.pi / wavelengths * np.sin(heading),
            rng.uniform(0.0, 2 * np.pi, n),
        ]
    )


def _about_plane(
    relief: Relief, size: tuple[float, float], steps: int
) -> tuple[Array, Array, Array]:
    """Coordinates of a grid, and the heights of a relief there above its best plane, metres."""
    grid = [np.linspace(0.0, extent, steps) for extent in size]
    a, b = (side.ravel() for side in np.meshgrid(*grid))
    height = relief(a, b)
    plane = np.column_stack([np.ones_like(a), a, b])
    best, *_ = np.linalg.lstsq(plane, height)
    return a, b, height - plane @ best


def site_surfaces(world: World) -> dict[str, Surface]:
    """Build the surveyed surfaces and the room behind them, in the site frame."""
    site = world.site
    ex, ey, ez = np.eye(3)
    height = site.wall_height_m

    def surveyed(
        name: str, across: Array, up: Array, normal: Array, size: tuple[float, float]
    ) -> Surface:
        relief = draw_relief(world.rng("relief", name), size, getattr(site.flatness, name))
        return Surface(name, np.zeros(3), across, up, normal, size, relief)

    surfaces = [
        surveyed("short_wall", ey, ez, ex, (site.short_wall_m, height)),
        surveyed("long_wall", ex, ez, ey, (site.long_wall_m, height)),
        surveyed("floor", ex, ey, ez, site.floor_m),
    ]
    (x0, x1), (y0, y1), top = site.room_x_m, site.room_y_m, site.room_height_m
    corner = np.array([x0, y0, 0.0])
    wide, deep = x1 - x0, y1 - y0
    surfaces += [
        Surface("room_left", corner, ey, ez, ex, (deep, top)),
        Surface("room_right", corner + wide * ex, ey, ez, -ex, (deep, top)),
        Surface("room_front", corner, ex, ez, ey, (wide, top)),
        Surface("room_back", corner + deep * ey, ex, ez, -ey, (wide, top)),
        # 4 mm below the surveyed floor, so that beams meet the surveyed floor first.
        Surface("room_floor", corner - 0.004 * ez, ex, ey, ez, (wide, deep)),
        Surface("room_ceiling", corner + top * ez, ex, ey, -ez, (wide, deep)),
    ]
    return {surface.name: surface for surface in surfaces}


def site_scene(world: World, scanner: str, position: str) -> Scene:
    """Scene of the surveyed site at a position of a scanner."""
    surfaces = site_surfaces(world)
    return Scene(
        surfaces,
        np.array([70.0, 75.0, 35.0, *[55.0] * (len(surfaces) - 3)]),
        world.pose(position),
        position_errors(world, scanner, position),
    )


def cast(
    surfaces: dict[str, Surface], origin: Array, direction: Array
) -> tuple[Array, NDArray[np.int64]]:
    """Cast beams on surfaces.

    Parameters
    ----------
    surfaces : dict of str to Surface
    origin, direction : ndarray, shape (n, 3)
        Of every beam; the directions are unit vectors.

    Returns
    -------
    range : ndarray, shape (n,)
        To the first surface that the beam meets, metres; infinite if it meets none.
    index : ndarray of int, shape (n,)
        Of that surface; -1 if there is none.
    """
    nearest = np.full(len(origin), np.inf)
    first = np.full(len(origin), -1)
    for number, surface in enumerate(surfaces.values()):
        length = surface.meet(origin, direction)
        nearer = length < nearest
        nearest[nearer], first[nearer] = length[nearer], number
    return nearest, first
