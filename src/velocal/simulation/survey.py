"""What the surveyor of the simulated world hands over: a field book, not coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from velocal.arrays import Array
from velocal.simulation.scene import Surface, site_surfaces
from velocal.simulation.world import World
from velocal.study.world import ControlCounts, TargetCounts
from velocal.survey.network.field_book import FieldBook
from velocal.survey.network.model import (
    ControlPoints,
    ImageObservations,
    PolarObservations,
    image_equations,
    polar_equations,
)
from velocal.survey.targets import Targets

#: Least distance of a target from the edge of a surface, metres.
_EDGE_M = 0.05
_ARCSEC = np.pi / 648e3


@dataclass(frozen=True)
class TrueTargets:
    """Targets on walls and floor at their true places.

    Attributes
    ----------
    name, surface : tuple of str
        Names of the targets, and of the surfaces that they are on.
    xyz, normal : ndarray, shape (n, 3)
        Coordinates in the true site frame, metres, and unit normals of the surfaces.
    """

    name: tuple[str, ...]
    surface: tuple[str, ...]
    xyz: Array
    normal: Array


def true_targets(world: World, counts: TargetCounts | ControlCounts, rng_name: str) -> TrueTargets:
    """Targets on the true surfaces, on a grid with random shifts that reaches to the edges.

    Parameters
    ----------
    world : World
    counts : TargetCounts or ControlCounts
        Number of targets on every surface.
    rng_name : str
        Name of the random numbers; its first letter stands in the names of the targets.
    """
    surfaces = site_surfaces(world)
    names: list[str] = []
    xyz = []
    for name, count in counts:
        rng = world.rng(rng_name, name)
        xyz.append(_scattered(surfaces[name], count, rng))
        names += [f"{name}_{rng_name[0]}{i + 1:03d}" for i in range(count)]
    surface = [name for name, count in counts for _ in range(count)]
    normal = np.array([surfaces[name].normal for name in surface])
    return TrueTargets(tuple(names), tuple(surface), np.concatenate(xyz), normal)


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
    """Targets on a scanner's base at their true places, in the scanner frame."""
    targets = world.scanner(scanner).base_targets
    radius, count = targets.radius_m, targets.count
    if targets.layout == "two_sides":
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
        If false, the observations are exact, and their standard deviations are the same.
    """
    survey = world.survey
    control = true_targets(world, survey.control, "control")
    targets = true_targets(world, world.site.targets, "targets")
    pointing = survey.total_station.pointing_mm
    network = [
        _polar(world, f"S{number + 1}", place, [(control.name, control.xyz, pointing, True)], noise)
        for number, place in enumerate(survey.stations)
    ]
    bases = {}
    for position, setups in survey.setups.items():
        scanner = world.positions[position].scanner
        true = base_targets_true(world, scanner)
        base = world.pose(position).apply(true.xyz)
        fine = world.scanner(scanner).base_pointing_mm
        what = [(control.name, control.xyz, pointing, True), (true.name, base, fine, False)]
        bases[position] = PolarObservations.joined(
            [_polar(world, f"{position}_{i + 1}", at, what, noise) for i, at in enumerate(setups)]
        )
    sketch = survey.sketch_mm * 1e-3
    images = _images(world, control, targets, noise)
    measured = set(images.target)
    return FieldBook(
        control=ControlPoints(control.name, sketch * np.round(control.xyz / sketch) + 0.0),
        planes={
            name: surface
            for name, surface in zip(targets.name, targets.surface, strict=True)
            if name in measured
        },
        polar=PolarObservations.joined(network),
        images=images,
        base_polar=bases,
        base_coordinates={unit: _repeated(world, unit, noise) for unit in world.scanners},
    )


def _polar(
    world: World,
    setup: str,
    place: Sequence[float],
    targets: Sequence[tuple[tuple[str, ...], Array, float, bool]],
    noise: bool,
) -> PolarObservations:
    """Observations of one set-up of the total station.

    Parameters
    ----------
    world : World
    setup : str
        Its name.
    place : sequence of float
        True coordinates of the instrument in the site frame, metres.
    targets : sequence of tuple
        Groups of targets: names, coordinates (m, 3), standard deviation of pointing (mm), and
        whether distances are measured.
    noise : bool
    """
    instrument = world.survey.total_station
    rng = world.rng("sights", setup)
    zero = rng.uniform(-np.pi, np.pi)
    values, stds = [], []
    for _, xyz, pointing_mm, with_distance in targets:
        value, _, _ = polar_equations(xyz, np.tile([*place, zero], (len(xyz), 1)))
        length = value[:, 2]
        # The distances are short: the error of pointing at the target exceeds that of the circle.
        angle = np.hypot(instrument.angle_arcsec * _ARCSEC, pointing_mm * 1e-3 / length)
        distance = instrument.distance_mm * 1e-3 + instrument.distance_ppm * 1e-6 * length
        # The same lateral error changes the direction by more if the line of sight is steep.
        std = np.column_stack([angle / np.sin(value[:, 1]), angle, distance])
        if not with_distance:
            value[:, 2] = std[:, 2] = np.nan
        values.append(value + (rng.normal(size=value.shape) * std if noise else 0.0))
        stds.append(std)
    names = tuple(name for part in targets for name in part[0])
    value, std = np.concatenate(values), np.concatenate(stds)
    return PolarObservations((setup,) * len(names), names, value, std)


def _images(
    world: World, control: TrueTargets, targets: TrueTargets, noise: bool
) -> ImageObservations:
    """Image coordinates of every target that a camera sees at no too large incidence.

    A target in one image only cannot be computed, so that nobody measures it.
    """
    camera = world.survey.camera
    principal = camera.principal_distance_mm
    half = np.array(camera.sensor_mm) / (2.0 * principal)
    xyz = np.concatenate([control.xyz, targets.xyz])
    normal = np.concatenate([control.normal, targets.normal])
    names = np.array([*control.name, *targets.name])
    std = camera.image_um * 1e-3 / principal
    measured = []
    for number, (x, y, z, *looks_at) in enumerate(world.survey.images):
        image, place = f"I{number + 1:02d}", np.array([x, y, z])
        forward = np.array(looks_at) - place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        ray = xyz - place
        steep = -np.sum(ray * normal, axis=1) / np.linalg.norm(ray, axis=1)
        seen = (ray @ forward > 0.0) & (steep > np.cos(np.deg2rad(camera.incidence_deg)))
        value, _, _ = image_equations(
            xyz, np.tile(place, (len(xyz), 1)), np.tile(rotation, (len(xyz), 1, 1))
        )
        seen &= (np.abs(value) < half).all(axis=1)
        # Errors of all points are drawn, so that those of a point depend on no other point.
        error = world.rng("image", image).normal(0.0, std, value.shape) if noise else 0.0
        measured.append((image, value + error, seen))
    in_images = np.sum([seen for _, _, seen in measured], axis=0)
    # Control points are known from the network.
    enough = (in_images > 1) | (np.arange(len(names)) < len(control.name))
    parts = []
    for image, value, seen in measured:
        kept = value[seen & enough]
        found = tuple(str(name) for name in names[seen & enough])
        std_of_all = np.full(kept.shape, std)
        parts.append(ImageObservations((image,) * len(found), found, kept, std_of_all))
    return ImageObservations.joined(parts)


def _repeated(world: World, scanner: str, noise: bool) -> Targets:
    """Repeated coordinates of the targets of a base, in the scanner frame."""
    how = world.scanner(scanner).base_scanner
    true = base_targets_true(world, scanner)
    rows = np.repeat(np.arange(len(true.name)), how.readings).tolist()
    std = np.tile(np.array(how.std_mm) * 1e-3, (len(rows), 1))
    repeated = true.take(rows)
    error = world.rng("base_readings", scanner).normal(size=std.shape) * std if noise else 0.0
    return Targets(repeated.name, repeated.group, repeated.xyz + error, std)
