"""The simulated world: the constants of its file, its random numbers and its true poses."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from velocal.arrays import Array
from velocal.errors import ConfigError
from velocal.geometry.rigid import RigidTransformation, rotation_from_vector
from velocal.study.model import validated
from velocal.study.reading import read_yaml
from velocal.study.world import Building, OutdoorKind, Pose, SampleWarmth, ScannerUnit, WorldFile

if TYPE_CHECKING:  # a change of the configuration's models does not change a simulated recording
    from velocal.study.study import Study

#: A scanner that has run for long without the halogen light.
_STEADY = SampleWarmth(halogen=False, start_k=0.0)


class World(WorldFile):
    """The file of a simulated world, with what follows from its constants."""

    def rng(self, *name: str) -> np.random.Generator:
        """Random numbers of their own for every name: a new sample changes no other sample."""
        keys = [zlib.crc32(part.encode()) for part in name]
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=keys))

    def pose(self, position: str) -> RigidTransformation:
        """True `T_site_scanner` of a position."""
        return true_pose(self.positions[position])

    def represented_s(self, passed_s: Array, length_s: float) -> Array:
        """Times of the experiment that the times of a recording represent, seconds.

        The experiment lasts `warmth.duration_s`, five minutes. A recording of this length
        represents itself. A shorter one represents three parts of the experiment, its beginning,
        its middle and its end, a third of the recording each. They pass at true speed, and the
        time between them is left out. A part represents at least `warmth.window_s`, the length of
        a window in the paper: a shorter third passes faster. A window of a short recording
        therefore has the temperatures of the same window of a long one.

        Parameters
        ----------
        passed_s : ndarray
            Times since the start of the recording, seconds.
        length_s : float
            Length of the recording, seconds.

        Returns
        -------
        ndarray
            Seconds since the start of the experiment, in the shape of `passed_s`.
        """
        third = length_s / 3.0
        part = max(third, self.warmth.window_s)
        left_out = max(self.warmth.duration_s - 3.0 * part, 0.0) / 2.0
        number = np.clip(np.floor(passed_s / third), 0.0, 2.0)
        return np.asarray(number * left_out + passed_s * (part / third))

    def temperature_k(self, sample: str, time_s: Array) -> Array:
        """Temperature of a scanner above the steady one without light, kelvin; it causes drifts.

        Parameters
        ----------
        sample : str
            Samples that the world file does not name start at the steady temperature.
        time_s : ndarray
            Seconds since the start of the experiment, see `represented_s`.

        Returns
        -------
        ndarray
            In the shape of `time_s`.
        """
        case = self.warmth.samples.get(sample, _STEADY)
        steady = self.warmth.halogen_k if case.halogen else 0.0
        passed = np.exp(-time_s / self.warmth.time_constant_s)
        return np.asarray(steady + (case.start_k - steady) * passed)

    def scanner(self, name: str) -> ScannerUnit:
        """Look up a simulated unit.

        Raises
        ------
        ConfigError
            If the world has no such scanner.
        """
        if name not in self.scanners:
            raise ConfigError(
                f"the simulated world has no scanner {name!r}",
                allowed=", ".join(self.scanners),
                hint="Describe it under `scanners:` of the world file.",
            )
        return self.scanners[name]

    def check_position(self, position: str, scanner: str) -> None:
        """Check that a scanner stands at a position.

        Raises
        ------
        ConfigError
            If the position is unknown or belongs to another scanner.
        """
        stands = {name: where.scanner for name, where in self.positions.items()}
        if stands.get(position) != scanner:
            raise ConfigError(
                f"no {scanner} stands at position {position!r} of the simulated world",
                allowed=", ".join(f"{name} ({unit})" for name, unit in stands.items()),
                hint="Name another position, or describe this one under `positions:`.",
            )

    def scene(self, name: str) -> tuple[OutdoorKind, float]:
        """Look up an outdoor scene: its kind, and the distance of its panels in metres.

        Raises
        ------
        ConfigError
            If the world has no such scene.
        """
        known = {
            f"{name}{number}": (kind, distance_m)
            for name, kind in (self.outdoor.kinds if self.outdoor else {}).items()
            for number, distance_m in enumerate(kind.distances_m, start=1)
        }
        if name not in known:
            raise ConfigError(
                f"the simulated world has no scene {name!r}",
                allowed=", ".join(known) or "no scene: the world has no `outdoor`",
                hint="Name another scene, or add a distance to its kind under `outdoor: kinds:`.",
            )
        return known[name]

    def mapped_building(self) -> Building:
        """Look up the building.

        Raises
        ------
        ConfigError
            If the world file describes no building.
        """
        if self.building is None:
            raise ConfigError(
                "the simulated world has no building to map",
                hint="Describe it under `building:`, or leave out the figure of the kind map.",
            )
        return self.building


def true_pose(where: Pose) -> RigidTransformation:
    """True `T_site_scanner` of an entry of `positions`."""
    # Heading is clockwise from the Y axis of the site, as the rotational angle is.
    turn = rotation_from_vector(np.array([0.0, 0.0, -np.deg2rad(where.heading_deg)]))
    tilt = rotation_from_vector(np.deg2rad(np.array([where.tilt_x_deg, where.tilt_y_deg, 0.0])))
    translation = np.array([where.x_m, where.y_m, where.z_m])
    return RigidTransformation(tilt @ turn, translation, np.zeros((6, 6)))


def read(path: Path) -> World:
    """Read the file of a simulated world.

    Raises
    ------
    ConfigError
        If the file is missing, or for the first fault in it.
    """
    return load(read_yaml(path), str(path))


def load(content: Mapping[str, Any], where: str = "world") -> World:
    """Build a world from the content of a world file.

    Parameters
    ----------
    content : mapping
    where : str
        How to call the file in errors.

    Raises
    ------
    ConfigError
        For the first fault in the content.
    """
    return validated(World, content, where)


def check_world(study: Study, world: World, where: str) -> None:
    """Check that the world has what the simulated recordings of a study need.

    Parameters
    ----------
    study : Study
    world : World
    where : str
        How to call the world's file in errors.

    Raises
    ------
    ConfigError
        If a simulated sample is of a scanner, a position or a scene that the world lacks, or if
        a building is mapped that the world lacks.
    """
    made, of_sample = study.made_files(), ""
    try:
        for sample in study.surveyed.values():
            if sample.recording in made:
                of_sample = f"sample {sample.name!r}: "
                world.scanner(sample.scanner)
                world.check_position(sample.position, sample.scanner)
        for panels in study.outdoor.values():
            if panels.recording in made:
                of_sample = f"sample {panels.name!r}: "
                world.scanner(panels.scanner)
                world.scene(panels.scene)
        of_sample = ""
        if study.config.maps:
            world.mapped_building()
    except ConfigError as error:
        raise ConfigError(
            f"{of_sample}{error.what}", where=where, allowed=error.allowed, hint=error.hint
        ) from None
