"""A second world for checks: calibrations whose truth is known, made without the project's models.

Beams, rigid motion, surfaces and errors are written here once more and in another way (complex
numbers, a correlation by its spectrum, bumps for the relief), so that an error in the project's own
models cannot hide itself. Only containers, the nominal geometry of the scanners, and the
adjustment of the survey come from the project; the survey passes through `Station.adjust` as that
of a user does.

The constants are plausible, not tuned: the noise of a shot is that of real recordings at 3-15 m,
the other sizes are those of `docs/methods.md`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.observations import Observations
from velocal.arrays import Array
from velocal.scanner.models import AZIMUTH_TICK_DEG, SCANNERS, Scanner
from velocal.scanner.parameters import NEAR_POINT, TWO_POINT, LaserParameters
from velocal.survey.station import Station
from velocal.survey.targets import Targets

#: Far point and near points of a factory's two-point calibration, metres.
FAR_M, NEAR_M = 25.04, (2.4, 1.93)
#: Standard deviation of the true correction at the near point minus that at the far one, as in real
#: files.
TWO_POINT_CM = 3.0
#: Beams count that meet a surface this far inside its edges, and at most at this incidence.
MARGIN_M, INCIDENCE = 0.12, np.cos(np.deg2rad(79.0))
#: Targets on walls and floor lie this far inside the edges.
TARGET_MARGIN_M = 0.05
#: Standard deviation of the median of n normal values, times the root of n.
_MEDIAN = np.sqrt(np.pi / 2.0)
_DEG, _CM, _MM = np.pi / 180.0, 1e-2, 1e-3


@dataclass(frozen=True, kw_only=True)
class UnitErrors:
    """True parameters of a unit minus those of its factory file: sizes of the errors.

    Attributes
    ----------
    dl_cm, alpha_deg, v_deg : float
        Standard deviations over the lasers.
    dl_mean_cm, alpha_mean_deg, v_mean_deg : float
        What is common to all lasers.
    hoff_mm, voff_mm : float
        Standard deviations over the lasers.
    two_point_cm : float
        If not zero, the file has a two-point correction that is right at the far point and
        beyond it, and this is the standard deviation of the error of its near point. The errors
        `dl_cm` and `dl_mean_cm` are then not used.
    """

    dl_cm: float = 1.9
    alpha_deg: float = 0.1
    v_deg: float = 0.1
    dl_mean_cm: float = 0.5
    alpha_mean_deg: float = 0.0
    v_mean_deg: float = 0.0
    hoff_mm: float = 0.0
    voff_mm: float = 0.0
    two_point_cm: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Errors of the measured distances: standard deviations.

    Attributes
    ----------
    shot_cm : float
        Of a single shot; every laser has its own, within a factor of about 1.35.
    pattern_cm : float
        Median over the lasers of the size of a pattern along azimuth, which is the same in all
        recordings of a station.
    pattern_log : float
        Scatter of the logarithm of that size over the lasers.
    pattern_deg : float
        Length over which the pattern is correlated.
    pattern_gaussian : bool
        Whether its correlation is ``exp(-d^2 / 4 pattern_deg^2)``, as that of the project's world,
        or ``exp(-d / pattern_deg)``.
    shift_cm : float
        Of a shift per laser and station.
    drift_cm : float
        Of a change per laser and window.
    surface_mm : tuple of float
        Least and largest size of a shift per laser and surface, the same at all stations, which
        some of the lasers have.
    surface_share : float
        Share of the lasers that have it, for every surface.
    near_cm : float
        Of an error per laser below about 2 m.
    azimuth_deg : float
        Of the azimuth of a median.
    """

    shot_cm: float = 0.65
    pattern_cm: float = 0.75
    pattern_log: float = 0.5
    pattern_deg: float = 0.5
    pattern_gaussian: bool = False
    shift_cm: float = 0.1
    drift_cm: float = 0.05
    surface_mm: tuple[float, float] = (0.0, 0.0)
    surface_share: float = 0.3
    near_cm: float = 0.0
    azimuth_deg: float = 0.005


@dataclass(frozen=True, kw_only=True)
class SurveyErrors:
    """How the surveyor works.

    Attributes
    ----------
    base_m : float
        Distance of the base targets from the middle of the base.
    base_targets : int
        Their number.
    scanner_mm, site_mm : float
        Standard deviations of a coordinate of a base target in the scanner frame, which is
        measured once, and in the site frame, which is measured at every station.
    wall_targets : int
        Targets on every surface.
    wall_mm : float
        Standard deviation of a coordinate of such a target.
    flatness_mm : float
        Root mean square of the relief of every surface.
    """

    base_m: float = 0.1
    base_targets: int = 6
    scanner_mm: float = 0.7
    site_mm: float = 1.0
    wall_targets: int = 12
    wall_mm: float = 1.0
    flatness_mm: float = 1.0


#: Noise of other scanners than the HDL-64E, which has the default values.
NOISE: Mapping[str, Noise] = {
    "HDL-32E": Noise(shot_cm=0.5, pattern_cm=0.3),
    "VLP-16": Noise(shot_cm=0.75, pattern_cm=0.4),
}
#: Places of the scanner: x, y (metres), heading (degrees). The first four are for calibrations.
PLACES = (
    (2.0, 1.9, 35.0),
    (4.1, 2.7, -120.0),
    (1.5, 3.3, 160.0),
    (3.3, 1.3, -40.0),
    (2.8, 3.0, 80.0),
    (4.9, 1.7, -10.0),
)
UNSEEN = 2


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A unit, a site and a survey, of which `draw` makes any number of examples.

    Attributes
    ----------
    scanner : str
    stations : int
        Stations of the calibration, 1 to 4.
    tilt_deg : float
        Tilt of the scanner at these stations, each to another side.
    windows : int
        Recorded windows of a station.
    shots : int
        Shots of a median.
    surfaces : tuple of str
        Surfaces that are surveyed and seen, out of `SURFACES`.
    every : int
        One azimuth bin of this number is used.
    unit : UnitErrors
    noise : Noise, optional
        That of the scanner in `NOISE` if left out.
    survey : SurveyErrors
    """

    scanner: str = "HDL-64E"
    stations: int = 1
    tilt_deg: float = 0.0
    windows: int = 3
    shots: int = 100
    surfaces: tuple[str, ...] = ("long", "short", "floor")
    every: int = 1
    unit: UnitErrors = field(default_factory=UnitErrors)
    noise: Noise | None = None
    survey: SurveyErrors = field(default_factory=SurveyErrors)

    @property
    def errors(self) -> Noise:
        """Noise of the scanner."""
        return self.noise or NOISE.get(self.scanner, Noise())


@dataclass(frozen=True)
class Recorded:
    """What a user has of one station.

    Attributes
    ----------
    survey : Station
        As the project adjusts it from the coordinates of the targets.
    windows : tuple of Observations
        Medians of every window, with the surveyed planes.
    """

    survey: Station
    windows: tuple[Observations, ...]


@dataclass(frozen=True)
class Trial:
    """One example of a calibration, with its truth.

    Attributes
    ----------
    scanner : str
    factory, true : LaserParameters
        The file of the factory, and the truth. With a two-point correction, `true` has the true
        corrections at the points of the factory.
    slope : ndarray, shape (n,)
        Change of the true distance correction with the range, below the far point.
    stations : tuple of Recorded
    unseen : tuple of Observations
        Medians at stations that were not calibrated on, with the true planes.
    spread : mapping of str to float
        True standard deviations of what an adjustment has to guess, by name: dl, alpha, v, scale,
        voff, hoff (metres, radians, 1).
    """

    scanner: str
    factory: LaserParameters
    true: LaserParameters
    slope: Array
    stations: tuple[Recorded, ...]
    unseen: tuple[Observations, ...]
    spread: Mapping[str, float]

    def correction(self, length: Array | float, laser: NDArray[np.integer] | slice) -> Array:
        """True distance correction at a range.

        Parameters
        ----------
        length : ndarray, shape (n,), or float
            True ranges, metres.
        laser : ndarray of int, shape (n,), or slice

        Returns
        -------
        ndarray, shape (n,)
            Metres.
        """
        return _correction(self.true, self.slope, length, laser)

    def shots(
        self, length: float, phi: Array, laser: NDArray[np.integer]
    ) -> tuple[Array, Array, Array]:
        """Shots without noise at a range: raw distances, true points, directions of the beams.

        Parameters
        ----------
        length : float
            True range, metres.
        phi : ndarray, shape (n,)
            Rotational angles, radians.
        laser : ndarray of int, shape (n,)

        Returns
        -------
        raw : ndarray, shape (n,)
            Metres.
        points, directions : ndarray, shape (n, 3)
            Scanner frame.
        """
        origin, direction = _rays(phi, laser, self.true)
        raw = length - self.correction(length, laser)
        return raw, origin + length * direction, direction


@dataclass(frozen=True)
class _Surface:
    """A rectangle: its corner, two orthogonal sides, and heights of its relief on a grid."""

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


#: Corner and two sides of every surface, metres. The walls and the floor meet at the origin, the
#: board leans in front of them.
SURFACES: Mapping[str, tuple[tuple[float, float, float], ...]] = {
    "long": ((0.0, 0.0, 0.0), (6.5, 0.0, 0.0), (0.0, 0.0, 2.6)),
    "short": ((0.0, 0.0, 0.0), (0.0, 4.6, 0.0), (0.0, 0.0, 2.6)),
    "floor": ((0.0, 0.0, 0.0), (6.5, 0.0, 0.0), (0.0, 4.6, 0.0)),
    "board": ((6.4, 1.8, 0.1), (0.0, 1.6, 0.0), (0.7, 0.0, 1.3)),
    "far": ((0.0, 4.9, 0.0), (6.5, 0.0, 0.0), (0.0, 0.0, 2.6)),
}


@dataclass(frozen=True)
class _Pose:
    """Where the scanner stands: columns of `axes` are its X, Y and Z in the site frame."""

    axes: Array
    at: Array

    def to_site(self, points: Array) -> Array:
        return np.asarray(points @ self.axes.T + self.at)

    def turned(self, directions: Array) -> Array:
        return np.asarray(directions @ self.axes.T)


def draw(plan: Plan, seed: int) -> Trial:
    """Make one example of a plan.

    Parameters
    ----------
    plan : Plan
    seed : int
        Every seed is another unit, another survey and other noise.

    Returns
    -------
    Trial
        With `UNSEEN` stations beside those of the plan.
    """
    rng = np.random.default_rng([seed, 20151])
    scanner = SCANNERS[plan.scanner]
    factory, true, slope = _unit(rng, scanner, plan.unit)
    surfaces = [_surface(rng, name, plan.survey.flatness_mm) for name in plan.surfaces]
    shots = _Shots(plan, scanner, true, slope, surfaces, rng)
    walls = _wall_targets(rng, surfaces, plan.survey)
    on_base = _base(plan.survey)
    sheet = on_base + rng.normal(0.0, plan.survey.scanner_mm * _MM, on_base.shape)
    stations = []
    for number in range(plan.stations):
        pose = _pose(rng, PLACES[number], plan.tilt_deg, number)
        survey = _survey(rng, plan, pose, walls, sheet, f"S{number + 1}")
        stations.append(Recorded(survey, tuple(shots.windows(rng, pose, survey, plan.windows))))
    unseen = []
    for place in PLACES[-UNSEEN:]:
        pose = _pose(rng, place, 0.0, 0)
        unseen += shots.windows(rng, pose, None, 1)
    two_point = plan.unit.two_point_cm
    spread = {
        "dl": (np.hypot(two_point, TWO_POINT_CM) if two_point else plan.unit.dl_cm) * _CM,
        "alpha": plan.unit.alpha_deg * _DEG,
        "v": plan.unit.v_deg * _DEG,
        "scale": 0.0,
        "voff": plan.unit.voff_mm * _MM,
        "hoff": plan.unit.hoff_mm * _MM,
    }
    return Trial(plan.scanner, factory, true, slope, tuple(stations), tuple(unseen), spread)


def _unit(
    rng: np.random.Generator, scanner: Scanner, errors: UnitErrors
) -> tuple[LaserParameters, LaserParameters, Array]:
    """Factory file, truth, and slope of the true distance correction."""
    n = scanner.n_lasers

    def around(mean: float, std: float) -> Array:
        return mean + std * rng.standard_normal(n)

    own_file = scanner.has_factory_file
    factory = LaserParameters(
        dl=around(1.2, 0.05) if own_file else np.zeros(n),
        alpha=scanner.rotational_rad + (around(0.4, 0.12) if own_file else 0.0) * _DEG,
        v=scanner.vertical_rad + (around(-0.1, 0.13) if own_file else 0.0) * _DEG,
        voff=scanner.vertical_offset_m + np.zeros(n),
        hoff=scanner.horizontal_offset_m + np.zeros(n),
        carried={TWO_POINT: np.zeros(n)},
    )
    true = replace(
        factory,
        dl=factory.dl + around(errors.dl_mean_cm, errors.dl_cm) * _CM,
        alpha=factory.alpha + around(errors.alpha_mean_deg, errors.alpha_deg) * _DEG,
        v=factory.v + around(errors.v_mean_deg, errors.v_deg) * _DEG,
        voff=factory.voff + around(0.0, errors.voff_mm) * _MM,
        hoff=factory.hoff + around(0.0, errors.hoff_mm) * _MM,
    )
    if not errors.two_point_cm:
        return factory, true, np.zeros(n)
    # The true correction is linear in the range up to the far point.
    slope = around(0.0, TWO_POINT_CM * _CM) / (FAR_M - NEAR_M[0])
    wrong = around(errors.dl_mean_cm, errors.two_point_cm) * _CM
    true = replace(true, dl=factory.dl)
    near = {
        name: factory.dl + slope * (at - FAR_M) for name, at in zip(NEAR_POINT, NEAR_M, strict=True)
    }
    on = {TWO_POINT: np.ones(n)}
    file = replace(factory, carried=on | {name: value - wrong for name, value in near.items()})
    return file, replace(true, carried=on | near), slope


def _correction(
    true: LaserParameters,
    slope: Array,
    length: Array | float,
    laser: NDArray[np.integer] | slice,
) -> Array:
    return np.asarray(true.dl[laser] + slope[laser] * np.minimum(np.subtract(length, FAR_M), 0.0))


def _surface(rng: np.random.Generator, name: str, flatness_mm: float) -> _Surface:
    """Surface with a relief of many bumps, whose root mean square about its plane is as stated."""
    corner, *sides = (np.array(each) for each in SURFACES[name])
    bare = _Surface(name, corner, np.array(sides), np.zeros((2, 2)))
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


def _pose(
    rng: np.random.Generator, place: tuple[float, float, float], tilt_deg: float, number: int
) -> _Pose:
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
    return _Pose(axes, at)


def _rays(phi: Array, laser: NDArray[np.integer], true: LaserParameters) -> tuple[Array, Array]:
    """Origins and unit directions of beams in the scanner frame.

    In the plane of X + iY, the head turns clockwise: a laser that looks along Y at azimuth zero is
    turned by ``exp(-i (phi - alpha))``, together with its origin, which lies to the left.
    """
    turn = np.exp(-1j * (phi - true.alpha[laser]))
    ahead = 1j * np.cos(true.v[laser]) * turn
    aside = -true.hoff[laser] * turn
    origin = np.column_stack([aside.real, aside.imag, true.voff[laser]])
    return origin, np.column_stack([ahead.real, ahead.imag, np.sin(true.v[laser])])


def _along(n: int, step_deg: float, noise: Noise, rng: np.random.Generator, rows: int) -> Array:
    """Random functions of unit variance on a full turn of n steps, shape (rows, n)."""
    apart = np.minimum(np.arange(n), n - np.arange(n)) * step_deg / noise.pattern_deg
    correlation = np.exp(-(apart**2) / 4.0) if noise.pattern_gaussian else np.exp(-apart)
    power = np.sqrt(np.maximum(np.fft.rfft(correlation).real, 0.0))
    white = np.fft.rfft(rng.standard_normal((rows, n)), axis=1)
    return np.asarray(np.fft.irfft(white * power, n=n, axis=1))


class _Shots:
    """Medians of distances of one unit at one site."""

    def __init__(
        self,
        plan: Plan,
        scanner: Scanner,
        true: LaserParameters,
        slope: Array,
        surfaces: list[_Surface],
        rng: np.random.Generator,
    ) -> None:
        noise, n = plan.errors, scanner.n_lasers
        self.plan, self.noise, self.true, self.slope = plan, noise, true, slope
        self.surfaces, self.tick_m = surfaces, scanner.distance_tick_m
        self.step_deg = scanner.azimuth_bin_ticks * AZIMUTH_TICK_DEG
        self.shot = noise.shot_cm * _CM * np.exp(rng.normal(0.0, 0.3, n))
        self.size = noise.pattern_cm * _CM * np.exp(rng.normal(0.0, noise.pattern_log, n))
        self.near = noise.near_cm * _CM * rng.standard_normal(n)
        shape = n, len(surfaces)
        moved = rng.uniform(0.0, 1.0, shape) < noise.surface_share
        size = rng.uniform(*noise.surface_mm, shape) * _MM * rng.choice([-1.0, 1.0], shape)
        self.of_surface = np.where(moved, size, 0.0)

    def windows(
        self, rng: np.random.Generator, pose: _Pose, survey: Station | None, count: int
    ) -> list[Observations]:
        """Medians of every window; with the true planes where there is no survey."""
        noise, n_lasers = self.noise, len(self.true)
        steps = round(360.0 / self.step_deg)
        bins = np.arange(0, steps, self.plan.every)
        pattern = self.size[:, None] * _along(steps, self.step_deg, noise, rng, n_lasers)
        shift = rng.normal(0.0, noise.shift_cm * _CM, n_lasers)
        laser = np.repeat(np.arange(n_lasers), len(bins))
        cell = np.tile(bins, n_lasers)
        phi: Array = np.asarray((cell + 0.5) * self.step_deg * _DEG, dtype=np.float64)
        length, surface = self._cast(pose, phi, laser)
        hit = surface >= 0
        phi, length, cell = phi[hit], length[hit], cell[hit]
        laser, surface = laser[hit], surface[hit]
        raw = length - _correction(self.true, self.slope, length, laser)
        raw += pattern[laser, cell] + shift[laser] + self.of_surface[laser, surface]
        raw += self.near[laser] / (1.0 + np.exp((length - 2.0) / 0.25))
        return [self._median(rng, pose, survey, raw, phi, laser, surface) for _ in range(count)]

    def _median(
        self,
        rng: np.random.Generator,
        pose: _Pose,
        survey: Station | None,
        raw: Array,
        phi: Array,
        laser: NDArray[np.integer],
        surface: NDArray[np.integer],
    ) -> Observations:
        noise, n = self.noise, len(raw)
        drift = rng.normal(0.0, noise.drift_cm * _CM, len(self.true))
        median = self.shot * _MEDIAN / np.sqrt(self.plan.shots)
        distance = raw + drift[laser] + median[laser] * rng.standard_normal(n)
        # The median of an even number of ticks is a multiple of half a tick.
        distance = np.round(2.0 * distance / self.tick_m) * 0.5 * self.tick_m
        rows = {
            "distance_m": distance,
            "phi_rad": phi + noise.azimuth_deg * _DEG * rng.standard_normal(n),
            "laser_id": laser,
            "plane": surface,
        }
        if survey is not None:
            return survey.observations(rows)
        normals = np.array([each.normal for each in self.surfaces]) @ pose.axes
        offsets = [each.normal @ (pose.at - each.corner) for each in self.surfaces]
        return Observations(
            distance,
            rows["phi_rad"],
            laser,
            normals[surface],
            np.array(offsets)[surface],
            surface,
        )

    def _cast(
        self, pose: _Pose, phi: Array, laser: NDArray[np.integer]
    ) -> tuple[Array, NDArray[np.int64]]:
        """Range to the first surface that each beam meets, and its number; -1 where none counts."""
        origin, direction = _rays(phi, laser, self.true)
        origin, direction = pose.to_site(origin), pose.turned(direction)
        nearest, number = np.full(len(phi), np.inf), np.full(len(phi), -1)
        counts = np.zeros(len(phi), dtype=bool)
        for index, surface in enumerate(self.surfaces):
            towards = direction @ surface.normal
            with np.errstate(divide="ignore", invalid="ignore"):
                length = (surface.corner - origin) @ surface.normal / towards
            near = np.flatnonzero((length > 0.3) & (length < nearest))
            for _ in range(2):  # the second time at the place where the relief is met
                place = origin[near] + length[near, None] * direction[near] - surface.corner
                a, b = (place @ surface.axes.T).T
                flat = (surface.corner - origin[near]) @ surface.normal / towards[near]
                length[near] = flat + surface.relief(a, b) / towards[near]
            wide, high = surface.extent
            inside = (a >= 0.0) & (a <= wide) & (b >= 0.0) & (b <= high)
            within = (a >= MARGIN_M) & (a <= wide - MARGIN_M)
            within &= (b >= MARGIN_M) & (b <= high - MARGIN_M)
            within &= np.abs(towards[near]) >= INCIDENCE
            near = near[inside]
            nearest[near], number[near], counts[near] = length[near], index, within[inside]
        return nearest, np.where(counts, number, -1)


def _base(survey: SurveyErrors) -> Array:
    """True places of the targets on the base of the scanner, in its frame."""
    angle = 2.0 * np.pi * np.arange(survey.base_targets) / survey.base_targets
    height = 0.3 * survey.base_m * (np.arange(survey.base_targets) % 2)
    return np.column_stack([survey.base_m * np.cos(angle), survey.base_m * np.sin(angle), height])


def _wall_targets(
    rng: np.random.Generator, surfaces: list[_Surface], survey: SurveyErrors
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


def _survey(
    rng: np.random.Generator,
    plan: Plan,
    pose: _Pose,
    walls: Targets,
    sheet: Array,
    position: str,
) -> Station:
    """Measure the base at a station, and let the project adjust pose and planes."""
    survey, n = plan.survey, plan.survey.base_targets
    names = tuple(f"B{i + 1}" for i in range(n))
    site = pose.to_site(_base(survey))
    std = np.full((n, 3), survey.site_mm * _MM)
    on_site = Targets(names, (position,) * n, site + std * rng.standard_normal(site.shape), std)
    of_scanner = Targets(
        names, (plan.scanner,) * n, sheet, np.full((n, 3), survey.scanner_mm * _MM)
    )
    return Station.adjust(walls, of_scanner, on_site, plan.surfaces, where="independent world")
