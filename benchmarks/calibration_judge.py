"""How `benchmarks/calibration.py` judges a set, and the trials of the project's own world."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from calibration_methods import DL_AT_M, Found, has_near_points

from velocal.adjustment.observations import Observations
from velocal.arrays import Array
from velocal.calibration.dialects import DIALECTS, Dialect
from velocal.chain import observe
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.models import AZIMUTH_TICK_DEG, AZIMUTH_TICKS, SCANNERS
from velocal.scanner.parameters import NEAR_POINT, TWO_POINT, LaserParameters
from velocal.simulation.draws import EDGE_M, INCIDENCE_RAD, MEDIAN_PER_MEAN, PLANES
from velocal.simulation.independent.shots import FAR_M
from velocal.simulation.independent.trial import NEAR_M, Recorded, Trial
from velocal.simulation.scene import Surface, cast, site_surfaces
from velocal.simulation.survey import field_book
from velocal.simulation.truth import (
    drift,
    factory_parameters,
    position_errors,
    unit_truth,
)
from velocal.simulation.world import World, load
from velocal.study.reading import read_yaml
from velocal.survey.network.survey import adjust_field_book

#: Ranges at which points are judged, metres.
RANGES_M = (10.0, 25.0, 50.0, 80.0)
#: Half width of a 95 % interval in standard deviations.
NORMAL_95 = 1.959964
WORLD = Path(__file__).parents[1] / "config/world.yaml"
#: Stations of the study's world: samples at each for the calibration, and two more that only judge.
STUDY = {
    "HDL-64E": (("P2", ("sa3", "sa4")), ("P1", ("sa1", "sa2"))),
    "HDL-32E": (("P5", ("sa5",)), ("P6", ("sa6",))),
}
MORE = {
    "P3": {"scanner": "HDL-64E", "x_m": 3.2, "y_m": 2.6, "heading_deg": -130.0},
    "P4": {"scanner": "HDL-64E", "x_m": 2.4, "y_m": 1.5, "heading_deg": 20.0},
    "P7": {"scanner": "HDL-32E", "x_m": 1.9, "y_m": 1.6, "heading_deg": 60.0},
    "P8": {"scanner": "HDL-32E", "x_m": 3.4, "y_m": 1.3, "heading_deg": -120.0},
}


def dialect_of(parameters: LaserParameters) -> Dialect:
    """The manual's formula where the file has near points, else that of the project."""
    return DIALECTS["manual" if has_near_points(parameters) else "paper"]


def misclosures(data: Observations, parameters: LaserParameters) -> Array:
    """Distance s of points from their plane along the beam, metres, by the file's own formula."""
    points = dialect_of(parameters).points(data.distance_m, data.phi, data.laser_id, parameters)
    direction, _ = laser_beams(data.phi, data.laser_id, parameters)
    distance = np.einsum("ni,ni->n", points, data.normal) + data.offset
    return np.asarray(distance / np.einsum("ni,ni->n", direction, data.normal))


def _rms(values: Array | list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def correction_at(parameters: LaserParameters, raw_m: Array) -> Array:
    """Distance correction that a file gives at raw distances, mean of all azimuths, by laser.

    Parameters
    ----------
    parameters : LaserParameters
    raw_m : ndarray, shape (lasers,)
        Raw distance of each laser, metres.
    """
    laser, phi = _turn(len(parameters))
    raw, zero = raw_m[laser], np.zeros(len(parameters))
    direction, _ = laser_beams(phi, laser, parameters)
    with_it = dialect_of(parameters).points(raw, phi, laser, parameters)
    without = DIALECTS["paper"].points(raw, phi, laser, replace(parameters, dl=zero))
    along = np.einsum("ni,ni->n", with_it - without, direction)
    return np.asarray(along.reshape(len(parameters), -1).mean(axis=1))


def point_errors(trial: Trial, parameters: LaserParameters, range_m: float) -> tuple[float, float]:
    """Root mean square over lasers and azimuths of a point's error: in all, and along the beam."""
    laser, phi = _turn(len(parameters))
    raw, true, direction = trial.shots(range_m, phi, laser)
    apart = dialect_of(parameters).points(raw, phi, laser, parameters) - true
    along = np.einsum("ni,ni->n", apart, direction)
    return _rms(np.linalg.norm(apart, axis=1)), _rms(along)


def _turn(n_lasers: int) -> tuple[Array, Array]:
    azimuths = np.deg2rad(np.arange(4.0, 364.0, 10.0))
    return np.repeat(np.arange(n_lasers), len(azimuths)), np.tile(azimuths, n_lasers)


def judged(trial: Trial, found: Found) -> dict[str, float]:
    """Errors of one set against the truth, its coverage, and what it does where it was not made.

    Parameters
    ----------
    trial : Trial
    found : Found

    Returns
    -------
    dict of str to float
        ``dl_cm``, ``alpha_deg``, ``v_deg``: root mean square errors over the lasers (dl at 3 m);
        ``{name}_mean``: the part common to all lasers; ``worst_dl_cm``: of the worst laser;
        ``cover_{name}``: share of the lasers whose 95 % interval contains the truth, NaN without
        stated deviations, and without the mean of an angle whose mean stays at the factory's
        value; ``std_{name}``: root mean square stated deviation; ``unseen_cm``,
        ``centred_cm``, ``induced_cm``: root mean square of s at unseen stations, without the mean
        of each station, and of the difference to what the true values give; ``point_{range}_cm``,
        ``along_{range}_cm``: error of points.
    """
    row: dict[str, float] = {}
    # What the scanner measures at that range: an HDL-64E adds more than 1 m to its raw distances.
    wanted = trial.correction(DL_AT_M, slice(None))
    error = {
        "dl": correction_at(found.parameters, DL_AT_M - wanted) - wanted,
        "alpha": found.parameters.alpha - trial.true.alpha,
        "v": found.parameters.v - trial.true.v,
    }
    size = {"dl": ("cm", 1e2), "alpha": ("deg", 180.0 / np.pi), "v": ("deg", 180.0 / np.pi)}
    for name, values in error.items():
        unit, factor = size[name]
        row[f"{name}_{unit}"] = _rms(values) * factor
        row[f"{name}_mean"] = float(np.mean(values)) * factor
        std = found.std.get(name)
        if name in found.at_factory:
            values = values - values.mean()
        row[f"cover_{name}"] = (
            np.nan if std is None else float(np.mean(np.abs(values) <= NORMAL_95 * std))
        )
        row[f"std_{name}"] = np.nan if std is None else _rms(std) * factor
    row["worst_dl_cm"] = float(np.max(np.abs(error["dl"]))) * 1e2
    s = [(misclosures(data, found.parameters), _true_s(trial, data)) for data in trial.unseen]
    row["unseen_cm"] = _rms([_rms(own) for own, _ in s]) * 1e2
    row["centred_cm"] = _rms([_rms(own - own.mean()) for own, _ in s]) * 1e2
    row["induced_cm"] = _rms([_rms(own - true) for own, true in s]) * 1e2
    for range_m in RANGES_M:
        total, along = point_errors(trial, found.parameters, range_m)
        row[f"point_{range_m:g}_cm"], row[f"along_{range_m:g}_cm"] = total * 1e2, along * 1e2
    return row


def _true_s(trial: Trial, data: Observations) -> Array:
    """Distance s of the points that the true values give, with the correction at their range."""
    plain = data.misclosure(replace(trial.true, dl=np.zeros(len(trial.true))))
    length = data.distance_m + trial.true.dl[data.laser_id]
    return np.asarray(plain + trial.correction(length, data.laser_id))


def study_world() -> World:
    """Read the world of the study, with stations that were never calibrated on."""
    content = dict(read_yaml(WORLD))
    flat = {"z_m": 0.8, "tilt_x_deg": 0.2, "tilt_y_deg": -0.3}
    content["positions"] = content["positions"] | {name: flat | at for name, at in MORE.items()}
    return load(content)


def study_trial(scanner: str, stations: int, seed: int, *, two_point: bool = False) -> Trial:
    """Draw a trial from the study's world: medians with all its errors, its survey, its factory.

    Parameters
    ----------
    scanner : str
    stations : int
        1 or 2.
    seed : int
        Is added to that of the study; zero is the study itself.
    two_point : bool
        Whether the file of the factory has its near points, as those of HDL-64E do; else it has
        one distance correction, as in the paper.
    """
    world = study_world()
    world = world.model_copy(update={"seed": world.seed + seed})
    factory, unit = factory_parameters(world, scanner), unit_truth(world, scanner)
    survey = adjust_field_book(field_book(world))
    surfaces = site_surfaces(world)
    recorded = []
    for position, samples in STUDY[scanner][:stations]:
        station = survey.station(scanner, position, PLANES, where="study's world")
        shots = _Shots(world, scanner, position, surfaces)
        windows = [
            observe(shots.beams(sample, share), station, factory)
            for sample in samples
            for share in (0.1, 0.5, 0.9)
        ]
        recorded.append(Recorded(station, tuple(windows)))
    unseen = []
    for position in (name for name, at in MORE.items() if at["scanner"] == scanner):
        unseen.append(_Shots(world, scanner, position, surfaces).on_true_planes())
    errors = world.scanner(scanner).errors
    slope = -unit.range_scale
    true = replace(unit.parameters, dl=unit.parameters.dl + slope * FAR_M, carried={})
    at_wall = np.hypot(errors.dl_cm, errors.range_scale_cm_per_m * (FAR_M - DL_AT_M))
    spread = {
        "dl": at_wall * 1e-2,
        "alpha": np.deg2rad(errors.alpha_deg),
        "v": np.deg2rad(errors.v_deg),
        "scale": errors.range_scale_cm_per_m * 1e-2,
        "voff": 0.0,
        "hoff": 0.0,
    }
    if two_point:
        near = {
            name: true.dl + slope * (at - FAR_M)
            for name, at in zip(NEAR_POINT, NEAR_M, strict=True)
        }
        true = replace(true, carried=near)
        # What the file is wrong by at its points; the unknowns are the corrections at range zero
        # and at the far point.
        far = true.dl - factory.dl
        at_near = near[NEAR_POINT[0]] - factory.carried[NEAR_POINT[0]]
        at_zero = at_near + (at_near - far) * NEAR_M[0] / (FAR_M - NEAR_M[0])
        spread |= {"dl": float(at_zero.std()), "scale": float(far.std())}
    else:
        factory = replace(factory, carried={TWO_POINT: np.zeros(len(slope))})
    return Trial(scanner, factory, true, slope, tuple(recorded), tuple(unseen), spread)


class _Shots:
    """Medians of a position of the study's world, without packets."""

    def __init__(
        self, world: World, scanner: str, position: str, surfaces: dict[str, Surface]
    ) -> None:
        self.world, self.scanner, self.surfaces = world, SCANNERS[scanner], surfaces
        self.position, self.pose = position, world.pose(position)
        self.unit = unit_truth(world, scanner)
        width = self.scanner.azimuth_bin_ticks
        ticks = np.arange(width // 2, AZIMUTH_TICKS, width)
        laser = np.repeat(np.arange(self.scanner.n_lasers), len(ticks))
        ticks = np.tile(ticks, self.scanner.n_lasers)
        phi = np.deg2rad(ticks * AZIMUTH_TICK_DEG)
        direction, origin = laser_beams(phi, laser, self.unit.parameters)
        direction, origin = direction @ self.pose.rotation.T, self.pose.apply(origin)
        length, surface = cast(surfaces, origin, direction)
        seen = (surface >= 0) & (length >= world.scanner(scanner).min_range_m)
        self.phi, self.laser, self.surface = phi[seen], laser[seen], surface[seen]
        self.length, self.direction, self.origin = length[seen], direction[seen], origin[seen]
        errors = position_errors(world, scanner, position)
        self.raw = self.unit.raw(self.length, self.laser) + errors[ticks[seen], self.laser]
        self.median = self.unit.noise(self.length, self.laser) * MEDIAN_PER_MEAN / 10.0

    def beams(self, sample: str, share: float) -> Beams:
        """Medians of 100 shots of a sample, at a share of its time."""
        rng = self.world.rng("bench", self.position, sample, str(share))
        time_s = np.array([share * self.world.warmth.duration_s])
        now = drift(self.world, self.scanner.name, sample).at(time_s)[0]
        raw = self.raw + now[self.laser] + self.median * rng.standard_normal(len(self.raw))
        # The encoder's steps average out over the shots of a bin, except for a few hundredths.
        phi = self.phi + np.deg2rad(0.005) * rng.standard_normal(len(raw))
        return Beams(raw, phi, self.laser, self.scanner.distance_tick_m)

    def on_true_planes(self) -> Observations:
        """Medians of a sample of its own on walls and floor, with their true planes."""
        beams = self.beams(f"bench {self.position}", 0.5)
        hit = self.origin + self.length[:, None] * self.direction
        kept = np.zeros(len(beams), dtype=bool)
        normals, offsets = [], []
        for index, name in enumerate(PLANES):
            surface = self.surfaces[name]
            own = self.surface == index
            inside = np.abs(self.direction @ surface.normal) >= np.cos(INCIDENCE_RAD)
            for axis, extent in zip((surface.across, surface.up), surface.size, strict=True):
                middle = (hit - surface.corner) @ axis - 0.5 * extent
                inside &= np.abs(middle) <= 0.5 * extent - 2.0 * EDGE_M
            kept |= own & inside
            normals.append(-surface.normal @ self.pose.rotation)
            offsets.append(surface.normal @ (surface.corner - self.pose.translation))
        plane = self.surface[kept]
        return Observations(
            beams.distance_m[kept],
            beams.phi[kept],
            self.laser[kept],
            np.array(normals)[plane],
            np.array(offsets)[plane],
            plane,
        )
