"""Constants of the simulated world as typed objects, and its random numbers."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from velocal.errors import ConfigError
from velocal.geometry.rigid import RigidTransformation, rotation_from_vector
from velocal.study.world import read_world

#: Factor of the surveyor's errors in a world without errors; zero would make them singular.
_TINY = 1e-6


@dataclass(frozen=True)
class ErrorModel:
    """Errors of a scanner; units in the names, standard deviations unless named otherwise.

    `far_point_m` is the range at which the factory calibrated: there the error of dl is
    `dl_mean_cm`, `dl_cm` (cut at `dl_limit` standard deviations), and `range_scale_cm_per_m`
    makes it another at other ranges.
    """

    dl_mean_cm: float
    dl_cm: float
    dl_limit: float
    alpha_deg: float
    v_deg: float
    range_scale_cm_per_m: float
    far_point_m: float
    pattern_median_cm: float
    pattern_log: float
    pattern_kernel_deg: float
    noise_median_cm: float
    noise_log: float
    noise_range_m: float
    shift_mean_cm: Mapping[str, float]
    shift_cm: float
    drift_laser_cm: float
    drift_common_cm: float
    drift_window_cm: float
    thermal_cm_per_k: float
    thermal_laser_cm_per_k: float
    outlier_share: float
    outlier_cm: float


@dataclass(frozen=True)
class FactoryModel:
    """How the factory values of a unit scatter about the design."""

    dist_mean_m: float
    dist_cm: float
    rotational_unit_deg: float
    rotational_deg: float
    vertical_unit_deg: float
    vertical_deg: float
    near_cm: float


@dataclass(frozen=True)
class Warmth:
    """Temperature of the scanner over the minutes of a recording; it causes drifts.

    Attributes
    ----------
    duration_s : float
        Length of the recordings of the study; the simulated ones may hold fewer rotations.
    time_constant_s : float
        Time constant with which the temperature approaches the steady one.
    halogen_k : float
        Rise of the steady temperature while the halogen light is on, kelvin.
    samples : mapping of str to mapping
        By sample, `halogen` (bool) and `start_k`: the temperature at the start above that of a
        scanner that has run for long without the light. Other samples start at zero.
    """

    duration_s: float
    time_constant_s: float
    halogen_k: float
    samples: Mapping[str, Mapping[str, Any]]

    def temperature_k(self, sample: str, share: np.ndarray) -> np.ndarray:
        """Temperature above the steady one without light, kelvin.

        Parameters
        ----------
        sample : str
        share : ndarray
            Times from 0 (start of the recording) to 1 (its end).
        """
        case = self.samples.get(sample, {"halogen": False, "start_k": 0.0})
        steady = self.halogen_k if case["halogen"] else 0.0
        return np.asarray(
            steady
            + (case["start_k"] - steady) * np.exp(-share * self.duration_s / self.time_constant_s)
        )


@dataclass(frozen=True)
class ScannerWorld:
    """Constants of a simulated unit, as the world file names them."""

    rotation_rate_hz: float
    rotation_rate_variation: float
    encoder_step_ticks: int
    min_range_m: float
    dropout: float
    base_targets: Mapping[str, Any]
    base_scanner: Mapping[str, Any]
    base_pointing_mm: float
    factory: FactoryModel | None
    errors: ErrorModel


@dataclass(frozen=True)
class World:
    """The whole world: seed, site, positions, warmth, units, survey, outdoor scenes, building."""

    seed: int
    site: Mapping[str, Any]
    positions: Mapping[str, Mapping[str, Any]]
    warmth: Warmth
    scanners: Mapping[str, ScannerWorld]
    survey: Mapping[str, Any]
    outdoor: Mapping[str, Any] | None = None
    building: Mapping[str, Any] | None = None

    def rng(self, *name: str) -> np.random.Generator:
        """Random numbers of their own for every name: a new sample changes no other sample."""
        keys = [zlib.crc32(part.encode()) for part in name]
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=keys))

    def pose(self, position: str) -> RigidTransformation:
        """True `T_site_scanner` of a position."""
        return true_pose(self.positions[position])

    def without_errors(self) -> World:
        """World with the same parameters, but perfect shots and a perfect survey.

        Ticks of the distance and steps of the encoder remain, as they belong to the packets.
        """
        kept = ("dl_mean_cm", "dl_cm", "alpha_deg", "v_deg")
        lengths = ("dl_limit", "pattern_kernel_deg", "far_point_m", "noise_range_m")
        scanners = {}
        for name, unit in self.scanners.items():
            zeros: dict[str, Any] = {
                item.name: {} if item.name == "shift_mean_cm" else 0.0
                for item in fields(ErrorModel)
                if item.name not in (*kept, *lengths)
            }
            scanners[name] = replace(
                unit,
                dropout=0.0,
                base_scanner={
                    **unit.base_scanner,
                    "std_mm": [_TINY * std for std in unit.base_scanner["std_mm"]],
                },
                base_pointing_mm=_TINY * unit.base_pointing_mm,
                errors=replace(unit.errors, **zeros),
            )
        flat = {name: {"mean_mm": 0.0, "max_mm": 0.0} for name in self.site["flatness"]}
        instrument = {name: _TINY * std for name, std in self.survey["total_station"].items()}
        camera = {**self.survey["camera"], "image_um": _TINY * self.survey["camera"]["image_um"]}
        return replace(
            self,
            site={**self.site, "flatness": flat},
            scanners=scanners,
            survey={**self.survey, "total_station": instrument, "camera": camera},
        )

    def check_position(self, position: str, scanner: str) -> None:
        """Check that a scanner stands at a position.

        Raises
        ------
        ConfigError
            If the position is unknown or belongs to another scanner.
        """
        stands = {name: where["scanner"] for name, where in self.positions.items()}
        if stands.get(position) != scanner:
            raise ConfigError(
                f"no {scanner} stands at position {position!r} of the simulated world",
                allowed=", ".join(f"{name} ({unit})" for name, unit in stands.items()),
                hint="Name another position, or describe this one under `positions:`.",
            )

    def scanner(self, name: str) -> ScannerWorld:
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


def true_pose(where: Mapping[str, Any]) -> RigidTransformation:
    """True `T_site_scanner` of an entry of `positions`."""
    # Heading is clockwise from the Y axis of the site, as the rotational angle is.
    turn = rotation_from_vector(np.array([0.0, 0.0, -np.deg2rad(where["heading_deg"])]))
    tilt = rotation_from_vector(
        np.deg2rad(np.array([where["tilt_x_deg"], where["tilt_y_deg"], 0.0]))
    )
    translation = np.array([where["x_m"], where["y_m"], where["z_m"]])
    return RigidTransformation(tilt @ turn, translation, np.zeros((6, 6)))


def read(path: Path) -> World:
    """Read the file of a simulated world.

    Raises
    ------
    ConfigError
        If the file is missing, or for the first fault in it.
    """
    return load(read_world(path).plain())


def load(content: Mapping[str, Any]) -> World:
    """Build a world from the content of a world file, which is validated already."""
    scanners = {}
    for name, unit in content["scanners"].items():
        factory = unit["factory"]
        scanners[name] = ScannerWorld(
            **{
                **{field.name: unit[field.name] for field in fields(ScannerWorld)},
                "factory": FactoryModel(**factory) if factory else None,
                "errors": ErrorModel(**unit["errors"]),
            }
        )
    warmth = Warmth(**content["warmth"])
    return World(
        content["seed"],
        content["field"],
        content["positions"],
        warmth,
        scanners,
        content["survey"],
        content.get("outdoor"),
        content.get("building"),
    )
