"""A storey of a building: boxes with doors and windows, and the scenes of its positions.

Its frame has the origin in a corner inside, X and Y along the outer walls and Z up from the
floor. All faces are plane, so that the thickness of a mapped wall is the scanner's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from velocal.arrays import Array
from velocal.errors import ConfigError
from velocal.simulation.scene import Scene, Surface
from velocal.simulation.survey import base_targets_true
from velocal.simulation.truth import position_errors
from velocal.simulation.world import World, true_pose
from velocal.study.world import BuildingBox
from velocal.survey.targets import Targets

#: Largest distance of the origin of a beam from the origin of the scanner, metres.
_REACH_M = 0.2


@dataclass(frozen=True)
class Face(Surface):
    """A rectangle with openings that beams pass.

    Attributes
    ----------
    openings : sequence of tuple
        Begin and end along `across`, then begin and end along `up`, metres.
    """

    openings: Sequence[tuple[float, float, float, float]] = ()

    def meet(self, origin: Array, direction: Array) -> Array:
        """Range at which beams, shape (n, 3), meet the surface; infinite where they do not."""
        length = super().meet(origin, direction)
        if self.openings:
            rows = np.flatnonzero(np.isfinite(length))
            at = origin[rows] + length[rows, None] * direction[rows] - self.corner
            a, b = at @ self.across, at @ self.up
            for left, right, bottom, top in self.openings:
                through = (a > left) & (a < right) & (b > bottom) & (b < top)
                length[rows[through]] = np.inf
        return length


def surfaces(world: World) -> dict[str, Surface]:
    """Build floor, ceiling, and the faces of all boxes and openings."""
    building = world.mapped_building()
    height, size = building.height_m, building.size_m
    ex, ey, ez = np.eye(3)
    found: dict[str, Surface] = {
        "floor": Face("floor", np.zeros(3), ex, ey, ez, size),
        "ceiling": Face("ceiling", height * ez, ex, ey, -ez, size),
    }
    for name, box in building.boxes.items():
        for face in _faces(name, box, height):
            found[face.name] = face
    return found


def _faces(name: str, box: BuildingBox, height: float) -> Iterator[Face]:
    """Four sides of a box, and the reveals of its openings."""
    low, high = np.array([box.x_m, box.y_m]).T
    extent = high - low
    along = int(np.argmax(extent))  # axis of the longer side
    across = 1 - along
    axes = np.eye(3)
    length, thickness = extent[along], extent[across]
    openings = [
        (start - low[along], stop - low[along], bottom, top)
        for start, stop, bottom, top in box.openings_m
    ]
    corner = np.append(low, 0.0)
    up = axes[2]

    def side(part: str, at: Array, axis: int, sign: float, size: tuple[float, float]) -> Face:
        """Upright rectangle along the other horizontal axis, its normal along `axis`."""
        return Face(f"{name} {part}", corner + at, axes[1 - axis], up, sign * axes[axis], size)

    for part, sign, shift in (("front", -1.0, 0.0), ("back", 1.0, thickness)):
        yield Face(
            f"{name} {part}", corner + shift * axes[across], axes[along], up,
            sign * axes[across], (length, height), None, openings,
        )  # fmt: skip
    yield side("begin", np.zeros(3), along, -1.0, (thickness, height))
    yield side("end", length * axes[along], along, 1.0, (thickness, height))
    for number, (left, right, bottom, top) in enumerate(openings, start=1):
        for part, place, sign in (("left", left, 1.0), ("right", right, -1.0)):
            at = place * axes[along] + bottom * up
            yield side(f"{part} {number}", at, along, sign, (thickness, top - bottom))
        for part, level, sign in (("sill", bottom, 1.0), ("lintel", top, -1.0)):
            if 0.0 < level < height:
                at = left * axes[along] + level * up
                yield Face(
                    f"{name} {part} {number}", corner + at, axes[along], axes[across],
                    sign * up, (right - left, thickness),
                )  # fmt: skip


def scene(world: World, position: str) -> Scene:
    """Scene of a position of the building.

    Raises
    ------
    ConfigError
        If the building has no such position.
    """
    building = world.mapped_building()
    if position not in building.positions:
        raise ConfigError(
            f"the building has no position {position!r}", allowed=", ".join(building.positions)
        )
    pose = true_pose(building.positions[position])
    # A face is seen from its own side only. The other faces are left out to save time.
    seen = {
        name: face
        for name, face in surfaces(world).items()
        if (pose.translation - face.corner) @ face.normal > -_REACH_M
    }
    intensity = building.reflectance
    reflectance = [intensity.floor if name == "floor" else intensity.walls for name in seen]
    errors = position_errors(world, building.scanner, position)
    return Scene(seen, np.array(reflectance, dtype=float), pose, errors)


def base_targets(world: World) -> list[Targets]:
    """Targets of the scanner's base at every position, as surveyed in the building's frame.

    No network is observed in the building: the coordinates have independent errors of
    `base_std_mm`, which is about the accuracy at the positions of the test field.
    """
    building = world.mapped_building()
    true, std = base_targets_true(world, building.scanner), building.base_std_mm * 1e-3
    found = []
    for position, where in building.positions.items():
        error = world.rng("base", position).normal(0.0, std, true.xyz.shape)
        xyz = true_pose(where).apply(true.xyz) + error
        found.append(Targets(true.name, (position,) * len(xyz), xyz, np.full(xyz.shape, std)))
    return found
