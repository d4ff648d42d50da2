"""What the surveyor of the simulated world hands over: targets of the field and of the bases."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.rigid import RigidTransformation
from velocal.simulation.scene import surveyed_field
from velocal.simulation.world import World
from velocal.survey import Targets

Array = NDArray[np.float64]
_EDGE_M = 0.05


def field_targets(world: World) -> list[Targets]:
    """Targets on walls and floor: on the true surface, measured with their accuracy."""
    std = world.field["target_std_mm"] * 1e-3
    surfaces = surveyed_field(world)
    parts = []
    for name, count in world.field["targets"].items():
        surface = surfaces[name]
        rng = world.rng("targets", name)
        # A jittered grid: targets cover the surface to its edges, as a surveyor would place them.
        columns = max(2, round(np.sqrt(count * surface.size[0] / surface.size[1])))
        rows = -(-count // columns)
        number = np.arange(count)
        a = (number % columns + rng.uniform(-0.3, 0.3, count)) / (columns - 1)
        b = (number // columns + rng.uniform(-0.3, 0.3, count)) / (rows - 1)
        across, up = (
            _EDGE_M + np.clip(share, 0.0, 1.0) * (extent - 2 * _EDGE_M)
            for share, extent in zip((a, b), surface.size, strict=True)
        )
        true = surface.at(across, up)
        parts.append(_measured(rng, [f"{name}_{i + 1:03d}" for i in range(count)], name, true, std))
    return parts


def base_targets_true(world: World, scanner: str) -> Array:
    """True coordinates of the targets on a scanner's base, scanner frame, shape (n, 3)."""
    layout: Mapping[str, Any] = world.scanner(scanner).base_targets
    radius, count = layout["radius_m"], layout["count"]
    if layout["layout"] == "two_sides":
        along = np.linspace(-0.2, 0.2, count // 2)
        sides = [
            np.column_stack([np.full(len(along), x), along, 0.03 * np.arange(len(along))])
            for x in (-radius, radius)
        ]
        return np.concatenate(sides)
    angle = np.deg2rad(30.0) * np.arange(count)
    return np.column_stack([radius * np.sin(angle), radius * np.cos(angle), np.zeros(count)])


def base_targets_scanner(world: World, scanner: str) -> Targets:
    """Targets of a base as measured in the scanner frame (caliper or drawing)."""
    true = base_targets_true(world, scanner)
    std = world.scanner(scanner).base_scanner_std_mm * 1e-3
    names = [f"B{i + 1}" for i in range(len(true))]
    return _measured(world.rng("base_scanner", scanner), names, scanner, true, std)


def base_targets_field(
    world: World, scanner: str, position: str, pose: RigidTransformation | None = None
) -> Targets:
    """Targets of a base as surveyed at a position: in the field frame, or in that of `pose`."""
    pose = pose or world.pose(position)
    true = pose.apply(base_targets_true(world, scanner))
    std = world.scanner(scanner).base_field_std_mm * 1e-3
    names = [f"B{i + 1}" for i in range(len(true))]
    return _measured(world.rng("base_field", scanner, position), names, position, true, std)


def _measured(
    rng: np.random.Generator, names: list[str], group: str, true: Array, std: float
) -> Targets:
    return Targets(
        tuple(names),
        (group,) * len(names),
        true + rng.normal(0.0, std, true.shape),
        np.full(true.shape, std),
    )
