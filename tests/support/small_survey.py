"""A room, its survey and recordings in memory: quick, and without the simulated world."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from velocal.geometry.rigid import RigidTransformation, rotation_from_vector
from velocal.reduction.assignment import Limits
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters, nominal
from velocal.study.adjustment import Adjustment
from velocal.survey.checks.run import Checked, Recorded, SurveyFiles, check_study
from velocal.survey.station import Station
from velocal.survey.targets import Targets

LIMITS, SIGMA_M = Limits(0.25, 0.05, float(np.deg2rad(80.0))), 0.02
#: The room is a box from the origin; the surveyed parts of its sides begin at the origin too.
ROOM_M = np.array([9.0, 7.0, 3.0])
PLANES = {"wall1": (1, (0.1, 5.0), (0.1, 2.0)), "wall2": (0, (0.1, 3.0), (0.1, 2.0)),
          "floor": (2, (0.1, 5.0), (0.1, 4.0))}  # fmt: skip
#: Heading (deg, anticlockwise) and place of the scanner in the room.
POSES = {"P1": (-40.0, (2.0, 1.8, 0.8)), "P2": (65.0, (3.3, 1.4, 0.9))}
NOISE_M = 0.004


@dataclass(frozen=True)
class Small:
    """Targets and recordings; a test breaks one of them, and checks the rest.

    `stated` is the calibration that the configuration names, by default with 1 cm and 0.05 deg of
    errors.
    """

    scanner: str
    planes: Targets
    base_scanner: Targets
    base_site: Mapping[str, Targets]
    windows: Mapping[str, Mapping[str, Beams]]
    stated: LaserParameters
    from_file: bool = True
    names: tuple[str, ...] = tuple(PLANES)
    order: Mapping[str, str] = field(default_factory=dict)

    def site(self, change: Callable[[np.ndarray], np.ndarray]) -> Small:
        """The same with all coordinates of the site frame changed."""
        moved = {name: replace(t, xyz=change(t.xyz)) for name, t in self.base_site.items()}
        planes = replace(self.planes, xyz=change(self.planes.xyz))
        return replace(self, planes=planes, base_site=moved)

    def base(self, change: Callable[[np.ndarray], np.ndarray]) -> Small:
        """The same with changed coordinates of the base in the scanner frame."""
        return replace(
            self, base_scanner=replace(self.base_scanner, xyz=change(self.base_scanner.xyz))
        )

    def stations(self) -> dict[str, Station]:
        return {
            name: Station.adjust(self.planes, self.base_scanner, site, self.names, where="survey")
            for name, site in self.base_site.items()
        }

    def check(self) -> Checked:
        survey = SurveyFiles(
            self.planes, self.base_scanner, self.base_site, self.stations(),
            ("planes.csv", "base_scanner.csv", "base_field.csv"),
        )  # fmt: skip
        known = SCANNERS[self.scanner]
        stochastic = Adjustment.recommended(known).stochastic()
        recorded = [
            Recorded(
                f"of_{name}", name, known, self.stated, self.from_file, stochastic,
                self.windows[self.order.get(name, name)],
            )
            for name in self.base_site
        ]  # fmt: skip
        return check_study(survey, recorded, limits=LIMITS, sigma_m=SIGMA_M)


def small(
    scanner: str = "HDL-32E",
    seed: int = 1,
    *,
    radius_m: float = 0.15,
    base_mm: tuple[float, float] = (0.3, 0.5),
    targets: int = 3,
    target_mm: float = 1.0,
    flat_base: bool = False,
    dl_m: float = 0.0,
) -> Small:
    """Survey and record.

    Parameters
    ----------
    scanner : str
    seed : int
    radius_m : float
        Of the circle of five targets on the base.
    base_mm : tuple of float
        Standard deviations of these targets in the scanner frame and in the site frame.
    targets : int
        Rows and columns of targets on a plane.
    target_mm : float
        Their standard deviation.
    flat_base : bool
        Whether all targets of the base have one height.
    dl_m : float
        True distance correction of all lasers.
    """
    rng = np.random.default_rng(seed)
    known = SCANNERS[scanner]
    design = nominal(known)
    n = len(design)
    true = design.corrected(
        {
            "dl": dl_m + rng.normal(0.0, 0.01, n),
            "alpha": np.deg2rad(rng.normal(0.0, 0.05, n)),
            "v": np.deg2rad(rng.normal(0.0, 0.05, n)),
        }
    )
    parts = [_targets(name, targets, target_mm, rng) for name in PLANES]
    planes = Targets(
        tuple(name for part in parts for name in part.name),
        tuple(name for part in parts for name in part.group),
        np.concatenate([part.xyz for part in parts]),
        np.concatenate([part.std for part in parts]),
    )
    angle = np.deg2rad(10.0 + 72.0 * np.arange(5))
    height = np.zeros(5) if flat_base else np.array([0.0, 0.05, 0.0, 0.05, 0.02])
    base = np.column_stack([radius_m * np.sin(angle), 0.8 * radius_m * np.cos(angle), height])
    names = tuple(f"B{i + 1}" for i in range(5))

    def measured(xyz: np.ndarray, group: str, std_mm: float) -> Targets:
        std = np.full(xyz.shape, std_mm * 1e-3)
        return Targets(names, (group,) * 5, xyz + rng.normal(size=xyz.shape) * std, std)

    poses = {name: pose(name) for name in POSES}
    return Small(
        scanner,
        planes,
        measured(base, scanner, base_mm[0]),
        {name: measured(at.apply(base), name, base_mm[1]) for name, at in poses.items()},
        {
            name: {
                window: record(known.name, true, at, rng)
                for window in ("beginning", "end")
            }
            for name, at in poses.items()
        },
        design,
    )  # fmt: skip


def pose(name: str) -> RigidTransformation:
    """True ``T_site_scanner``."""
    heading, place = POSES[name]
    turn = rotation_from_vector(np.deg2rad([0.3, -0.4, heading]))
    return RigidTransformation(turn, np.array(place), np.zeros((6, 6)))


def record(
    scanner: str, true: LaserParameters, at: RigidTransformation, rng: np.random.Generator
) -> Beams:
    """Medians of one window, every four degrees."""
    n = len(true)
    phi = np.deg2rad(np.repeat(np.arange(0.0, 360.0, 4.0), n))
    laser = np.tile(np.arange(n), 90)
    direction, origin = laser_beams(phi, laser, true)
    start, towards = at.apply(origin), direction @ at.rotation.T
    with np.errstate(divide="ignore"):
        length = np.where(towards > 0, (ROOM_M - start) / towards, -start / towards).min(axis=1)
    measured = length - true.dl[laser] + rng.normal(0.0, NOISE_M, len(phi))
    return Beams(measured, phi, laser, SCANNERS[scanner].distance_tick_m)


def _targets(name: str, count: int, std_mm: float, rng: np.random.Generator) -> Targets:
    axis, first, second = PLANES[name]
    grid = np.meshgrid(np.linspace(*first, count), np.linspace(*second, count))
    xyz = np.insert(np.column_stack([g.ravel() for g in grid]), axis, 0.0, axis=1)
    std = np.full(xyz.shape, std_mm * 1e-3)
    return Targets(
        tuple(f"{name}_{i + 1}" for i in range(len(xyz))),
        (name,) * len(xyz),
        xyz + rng.normal(size=xyz.shape) * std,
        std,
    )
