"""What the surveyor of the simulated world hands over: field books, not coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.simulation.scene import Surface, surveyed_field
from velocal.simulation.world import World
from velocal.survey.network.model import Control, Observed, ray_equations, sight_equations
from velocal.survey.network.observations import FieldBook
from velocal.survey.targets import Targets

Array = NDArray[np.float64]
_EDGE_M = 0.05
_ARCSEC = np.pi / 648e3


@dataclass(frozen=True)
class Marks:
    """Marked points on walls and floor, as they are.

    Attributes
    ----------
    name, surface : tuple of str
    xyz, normal : ndarray, shape (n, 3)
        Metres, field frame; the normal of the surface.
    """

    name: tuple[str, ...]
    surface: tuple[str, ...]
    xyz: Array
    normal: Array


def marks(world: World, counts: Mapping[str, int], stream: str) -> Marks:
    """Points on the true surfaces, a jittered grid: they cover a surface to its edges.

    Parameters
    ----------
    world : World
    counts : mapping of str to int
        Points on every surface.
    stream : str
        Name of the random stream.
    """
    surfaces = surveyed_field(world)
    names: list[str] = []
    xyz = []
    for name, count in counts.items():
        rng = world.rng(stream, name)
        xyz.append(_scattered(surfaces[name], count, rng))
        names += [f"{name}_{stream[0]}{i + 1:03d}" for i in range(count)]
    surface = [name for name, count in counts.items() for _ in range(count)]
    normal = np.array([surfaces[name].normal for name in surface])
    return Marks(tuple(names), tuple(surface), np.concatenate(xyz), normal)


def _scattered(surface: Surface, count: int, rng: np.random.Generator) -> Array:
    columns = max(2, round(np.sqrt(count * surface.size[0] / surface.size[1])))
    rows = -(-count // columns)
    number = np.arange(count)
    a = (number % columns + rng.uniform(-0.3, 0.3, count)) / (columns - 1)
    b = (number // columns + rng.uniform(-0.3, 0.3, count)) / (rows - 1)
    across, up = (
        _EDGE_M + np.clip(share, 0.0, 1.0) * (extent - 2 * _EDGE_M)
        for share, extent in zip((a, b), surface.size, strict=True)
    )
    return surface.at(across, up)


def base_targets_true(world: World, scanner: str) -> Targets:
    """Targets on a scanner's base as they are, scanner frame."""
    layout: Mapping[str, Any] = world.scanner(scanner).base_targets
    radius, count = layout["radius_m"], layout["count"]
    if layout["layout"] == "two_sides":
        along = np.linspace(-0.2, 0.2, count // 2)
        sides = [
            np.column_stack([np.full(len(along), x), along, 0.03 * np.arange(len(along))])
            for x in (-radius, radius)
        ]
        xyz = np.concatenate(sides)
    else:
        angle = np.deg2rad(30.0) * np.arange(count)
        xyz = np.column_stack([radius * np.sin(angle), radius * np.cos(angle), np.zeros(count)])
    names = tuple(f"B{i + 1}" for i in range(len(xyz)))
    return Targets(names, (scanner,) * len(xyz), xyz, np.zeros(xyz.shape))


def field_book(world: World, *, noise: bool = True) -> FieldBook:
    """Observe control points, targets, and the bases at all positions that have set-ups.

    Parameters
    ----------
    world : World
    noise : bool
        Without it the observations are exact, and their standard deviations as stated.
    """
    survey = world.survey
    control = marks(world, survey["control"], "control")
    targets = marks(world, world.field["targets"], "targets")
    pointing = survey["total_station"]["pointing_mm"]
    network = [
        _sights(
            world, f"S{number + 1}", place, [(control.name, control.xyz, pointing, True)], noise
        )
        for number, place in enumerate(survey["stations"])
    ]
    bases = {}
    for position, setups in survey["setups"].items():
        scanner = world.positions[position]["scanner"]
        true = base_targets_true(world, scanner)
        base = world.pose(position).apply(true.xyz)
        fine = world.scanner(scanner).base_pointing_mm
        what = [(control.name, control.xyz, pointing, True), (true.name, base, fine, False)]
        bases[position] = _joined(
            [_sights(world, f"{position}_{i + 1}", at, what, noise) for i, at in enumerate(setups)]
        )
    sketch = survey["sketch_mm"] * 1e-3
    return FieldBook(
        control=Control(control.name, sketch * np.round(control.xyz / sketch) + 0.0),
        planes=dict(zip(targets.name, targets.surface, strict=True)),
        network=_joined(network),
        images=_images(world, control, targets, noise),
        base_sights=bases,
        base_readings={scanner: _readings(world, scanner, noise) for scanner in world.scanners},
    )


def _sights(
    world: World,
    station: str,
    place: Sequence[float],
    targets: Sequence[tuple[tuple[str, ...], Array, float, bool]],
    noise: bool,
) -> Observed:
    """Sights of one set-up to targets: names, coordinates, error of pointing, with distances."""
    instrument: Mapping[str, float] = world.survey["total_station"]
    rng = world.rng("sights", station)
    zero = rng.uniform(-np.pi, np.pi)
    values, stds = [], []
    for _, xyz, pointing_mm, with_distance in targets:
        value, _, _ = sight_equations(xyz, np.tile([*place, zero], (len(xyz), 1)))
        length = value[:, 2]
        # Sight lines to a wall are short: pointing at the target counts more than the circle.
        angle = np.hypot(instrument["angle_arcsec"] * _ARCSEC, pointing_mm * 1e-3 / length)
        distance = instrument["distance_mm"] * 1e-3 + instrument["distance_ppm"] * 1e-6 * length
        # A steep sight turns the direction by more than it misses the target.
        std = np.column_stack([angle / np.sin(value[:, 1]), angle, distance])
        if not with_distance:
            value[:, 2] = std[:, 2] = np.nan
        values.append(value + (rng.normal(size=value.shape) * std if noise else 0.0))
        stds.append(std)
    names = tuple(name for part in targets for name in part[0])
    return Observed((station,) * len(names), names, np.concatenate(values), np.concatenate(stds))


def _joined(parts: Sequence[Observed]) -> Observed:
    return Observed(
        tuple(name for part in parts for name in part.setup),
        tuple(name for part in parts for name in part.target),
        np.concatenate([part.value for part in parts]),
        np.concatenate([part.std for part in parts]),
    )


def _images(world: World, control: Marks, targets: Marks, noise: bool) -> Observed:
    """Image rays of every target that a camera sees, not too obliquely."""
    camera: Mapping[str, Any] = world.survey["camera"]
    principal = camera["principal_distance_mm"]
    half = np.array(camera["sensor_mm"]) / (2.0 * principal)
    xyz = np.concatenate([control.xyz, targets.xyz])
    normal = np.concatenate([control.normal, targets.normal])
    names = np.array([*control.name, *targets.name])
    std = camera["image_um"] * 1e-3 / principal
    parts = []
    for number, (x, y, z, *looks_at) in enumerate(world.survey["images"]):
        image, place = f"I{number + 1:02d}", np.array([x, y, z])
        forward = np.array(looks_at) - place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        ray = xyz - place
        steep = -np.sum(ray * normal, axis=1) / np.linalg.norm(ray, axis=1)
        seen = (ray @ forward > 0.0) & (steep > np.cos(np.deg2rad(camera["incidence_deg"])))
        value, _, _ = ray_equations(
            xyz, np.tile(place, (len(xyz), 1)), np.tile(rotation, (len(xyz), 1, 1))
        )
        seen &= (np.abs(value) < half).all(axis=1)
        # Errors of all points are drawn, so that no point's depend on what else is seen.
        error = world.rng("image", image).normal(0.0, std, value.shape) if noise else 0.0
        value = (value + error)[seen]
        found = tuple(str(name) for name in names[seen])
        parts.append(Observed((image,) * len(found), found, value, np.full(value.shape, std)))
    return _joined(parts)


def _readings(world: World, scanner: str, noise: bool) -> Targets:
    """Repeated readings of the targets of a base, scanner frame."""
    how = world.scanner(scanner).base_scanner
    true = base_targets_true(world, scanner)
    rows = np.repeat(np.arange(len(true.name)), how["readings"]).tolist()
    std = np.tile(np.array(how["std_mm"]) * 1e-3, (len(rows), 1))
    taken = true.take(rows)
    error = world.rng("base_readings", scanner).normal(size=std.shape) * std if noise else 0.0
    return Targets(taken.name, taken.group, taken.xyz + error, std)
