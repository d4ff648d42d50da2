"""Recordings without a survey: planes found in the data, and how flat each laser sees them.

A plane is searched by RANSAC and must be one connected, thin sheet as seen from the scanner; a
slice through a hedge is neither. Trimming compares a return with its own laser only, so that the
errors of the lasers, which are what is looked for, stay in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from velocal.adjustment.functional import misclosure
from velocal.beam_model import angle_from_ticks, distance_from_ticks, laser_beams
from velocal.errors import SurveyError
from velocal.parameters import ParameterSet
from velocal.planes import Plane, PlaneFit, fit_plane
from velocal.sensors import DISTANCE_TICK_M, Scanner
from velocal.validation import laser_statistics, statistics_table, summary_row

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

#: Random planes of one round of the search, and the best of them that are looked at closely.
HYPOTHESES, SHORT_LIST = 1000, 25
#: Points on which random planes are compared.
SAMPLE = 5000
#: The three points of a random plane lie within this share of their range.
NEIGHBOURHOOD = 0.15
#: Lasers that a plane must be seen by, as two or three lines do not fix one.
MIN_LASERS = 4
#: Share of the points within 3 distances of a found plane that must lie within half a distance:
#: 1/6 where points fill a volume, up to 1/2 where the plane cuts through other surfaces.
MIN_THINNESS = 0.6
#: The distance must be at least so many standard deviations of a found plane's points.
STD_IN_DISTANCE = 3.0
#: Width of the cells in which connectedness is examined.
CELL_RAD = np.deg2rad(0.6)
#: Trimming: limit in robust standard deviations, largest number of rounds.
TRIM_AT, ROUNDS = 3.0, 10
#: Standard deviations of normal noise in its median absolute deviation.
STD_PER_MAD = 1.4826
#: Returns that a cell must have before its spread tells anything of single returns.
MIN_SPREAD_COUNT = 5


@dataclass(frozen=True)
class Cloud:
    """Returns, or medians of them, with the points that a calibration gives.

    Attributes
    ----------
    distance_m, phi : ndarray, shape (n,)
        Raw distance, metres; rotational angle, radians.
    laser_id : ndarray of int, shape (n,)
        Laser of each.
    parameters : ParameterSet
        Calibration.
    xyz, direction : ndarray, shape (n, 3)
        Points, metres, and unit directions of their beams, scanner frame.
    """

    distance_m: Array
    phi: Array
    laser_id: NDArray[np.integer]
    parameters: ParameterSet
    xyz: Array
    direction: Array

    @classmethod
    def of(
        cls, distance_m: Array, phi: Array, laser_id: NDArray[np.integer], parameters: ParameterSet
    ) -> Cloud:
        """Compute the points of returns."""
        direction, origin = laser_beams(phi, laser_id, parameters)
        length = distance_m + parameters.dl[laser_id]
        xyz = length[:, None] * direction + origin
        return cls(distance_m, phi, laser_id, parameters, xyz, direction)

    @classmethod
    def of_medians(
        cls,
        medians: Mapping[str, NDArray[Any]],
        scanner: Scanner,
        rotation_rate_hz: float,
        parameters: ParameterSet,
    ) -> Cloud:
        """Compute the points of medians: columns ``laser_id``, ``azimuth``, ``distance``."""
        laser_id = medians["laser_id"]
        rate = 2.0 * np.pi * rotation_rate_hz
        phi = angle_from_ticks(medians["azimuth"], laser_id, scanner, rate)
        return cls.of(distance_from_ticks(medians["distance"]), phi, laser_id, parameters)

    def s(self, rows: Rows, plane: Plane) -> Array:
        """Residuals of rows along their beams, metres; equation (5)."""
        return misclosure(
            self.distance_m[rows],
            self.phi[rows],
            self.laser_id[rows],
            self.parameters,
            np.broadcast_to(plane.normal, (len(rows), 3)),
            np.full(len(rows), plane.offset),
        )

    def incidence(self, rows: Rows, plane: Plane) -> Array:
        """Angles of incidence of rows, radians."""
        return np.arccos(np.minimum(np.abs(self.direction[rows] @ plane.normal), 1.0))


@dataclass(frozen=True)
class Search:
    """What counts as a plane.

    Attributes
    ----------
    planes : int
        Planes to find at most.
    distance_m : float
        Points of a found plane lie within this distance of it.
    extent_m : float
        Largest diameter of a found plane; what is flat over metres is not over a whole street.
    min_points : int
        Points that a plane must have.
    incidence_rad : float
        Largest angle between beam and normal.
    seed : int
        Seed of the random search.
    """

    planes: int
    distance_m: float
    extent_m: float
    min_points: int
    incidence_rad: float
    seed: int

    @classmethod
    def from_config(cls, search: Mapping[str, Any]) -> Search:
        """Search out of the configuration's `field: search`."""
        return cls(
            planes=search["planes"],
            distance_m=search["distance_cm"] * 1e-2,
            extent_m=search["extent_m"],
            min_points=search["min_points"],
            incidence_rad=float(np.deg2rad(search["incidence_deg"])),
            seed=search["seed"],
        )


@dataclass(frozen=True)
class FieldPlane:
    """A plane fitted to points of a recording.

    Attributes
    ----------
    name : str
        Name of the patch, or plane1, plane2, ...
    fit : PlaneFit
        The plane with the orthogonal distances of its points.
    rows : ndarray of int, shape (n,)
        Points that it was fitted to, rows of the cloud.
    s : ndarray, shape (n,)
        Their residuals along the beam, metres.
    trimmed : int
        Points left out as outliers.
    range_m, incidence_rad : float
        Mean range and mean angle of incidence.
    """

    name: str
    fit: PlaneFit
    rows: Rows
    s: Array
    trimmed: int
    range_m: float
    incidence_rad: float

    @property
    def tilt_rad(self) -> float:
        """Angle between normal and vertical: 0 for a level plane, pi/2 for an upright one."""
        return float(np.arccos(min(1.0, abs(self.fit.plane.normal[2]))))


#: Planes, and what else there is to say: why there is none.
Found = tuple[list[FieldPlane], list[str]]


def patch_points(xyz: Array, box: Mapping[str, Sequence[float]]) -> Rows:
    """Rows of the points, shape (n, 3), inside a box: `x_m`, `y_m`, `z_m`, each from and to."""
    inside = np.ones(len(xyz), dtype=bool)
    for axis, name in enumerate(("x_m", "y_m", "z_m")):
        low, high = sorted(box[name])
        inside &= (xyz[:, axis] >= low) & (xyz[:, axis] <= high)
    return np.flatnonzero(inside)


def fit_patches(
    cloud: Cloud, patches: Mapping[str, Mapping[str, Sequence[float]]], search: Search
) -> Found:
    """Fit a plane to the points in each box; a box without a plane becomes a finding."""
    planes, findings = [], []
    for name, box in patches.items():
        try:
            planes.append(fit_robustly(name, cloud, patch_points(cloud.xyz, box), search))
        except SurveyError as error:
            findings.append(f"{name}: {error}")
    return planes, findings


def fit_robustly(name: str, cloud: Cloud, rows: Rows, search: Search) -> FieldPlane:
    """Fit a plane to rows of a cloud without its outliers and without grazing returns.

    A return is an outlier if it is further from the median of its laser than three robust
    standard deviations, of that laser or of all lasers, whichever is larger: neither a laser that
    is off as a whole nor a noisy one is made to look like the others.

    Raises
    ------
    SurveyError
        If too few points or lasers are left.
    """
    keep = steep = np.ones(len(rows), dtype=bool)
    _, laser = np.unique(cloud.laser_id[rows], return_inverse=True)
    for _ in range(ROUNDS):
        _check_size(cloud, rows[keep], search)
        plane = fit_plane(cloud.xyz[rows[keep]]).plane
        steep = cloud.incidence(rows, plane) <= search.incidence_rad
        used = keep & steep
        s = cloud.s(rows, plane)
        centre = _medians(s, laser, used)[laser]
        size = np.where(np.isfinite(centre), np.abs(s - centre), np.inf)
        own = _medians(size, laser, used)[laser]
        common = _medians(size, np.zeros_like(laser), used)[0]
        # Never finer than half a tick: noise-free medians would trim themselves away.
        sigma = np.maximum(STD_PER_MAD * np.fmax(own, common), DISTANCE_TICK_M / 2)
        changed = steep & np.isfinite(size) & (size <= TRIM_AT * sigma)
        if np.array_equal(changed, keep):
            break
        keep = changed
    chosen = rows[keep]
    _check_size(cloud, chosen, search)
    fit = fit_plane(cloud.xyz[chosen])
    return FieldPlane(
        name,
        fit,
        chosen,
        cloud.s(chosen, fit.plane),
        trimmed=int(np.count_nonzero(steep & ~keep)),
        range_m=float(np.mean(cloud.distance_m[chosen])),
        incidence_rad=float(np.mean(cloud.incidence(chosen, fit.plane))),
    )


def _check_size(cloud: Cloud, rows: Rows, search: Search) -> None:
    lasers = len(np.unique(cloud.laser_id[rows]))
    if len(rows) < search.min_points or lasers < MIN_LASERS:
        raise SurveyError(
            f"{len(rows)} points of {lasers} lasers",
            allowed=f"{search.min_points} points of {MIN_LASERS} lasers, or more",
        )


def _medians(values: Array, group: Rows, chosen: NDArray[np.bool_]) -> Array:
    """Median of the chosen values of each group; NaN for a group without any."""
    medians = np.full(int(group.max(initial=0)) + 1, np.nan)
    order = np.lexsort((values[chosen], group[chosen]))
    ordered = values[chosen][order]
    present, begin, count = np.unique(group[chosen][order], return_index=True, return_counts=True)
    below, above = ordered[begin + (count - 1) // 2], ordered[begin + count // 2]
    medians[present] = 0.5 * (below + above)
    return medians


def find_planes(cloud: Cloud, search: Search) -> Found:
    """Search planes, the largest first: plane1, plane2, ...; none found becomes a finding."""
    rng = np.random.default_rng(search.seed)
    finder = _Finder(cloud, search)
    free = np.ones(len(cloud.xyz), dtype=bool)
    planes: list[FieldPlane] = []
    while len(planes) < search.planes and np.count_nonzero(free) >= search.min_points:
        found = finder.largest(f"plane{len(planes) + 1}", free, rng)
        if found is None:
            break
        plane, sheet = found
        planes.append(plane)
        free[sheet] = False
    if planes:
        return planes, []
    return [], [
        f"no plane found: among {len(cloud.xyz)} points no connected sheet of {search.min_points} "
        f"points of {MIN_LASERS} lasers lies within {search.distance_m * 100:g} cm of a plane"
    ]


class _Finder:
    """Search for planes in one cloud."""

    def __init__(self, cloud: Cloud, search: Search) -> None:
        self.cloud, self.search = cloud, search
        self.grid, self.tree = _Grid(cloud), KDTree(cloud.xyz)

    def largest(
        self, name: str, free: NDArray[np.bool_], rng: np.random.Generator
    ) -> tuple[FieldPlane, Rows] | None:
        """One round: the largest sheet of free points near one of many random planes."""
        search = self.search
        xyz = self.cloud.xyz[free]
        some = xyz[rng.choice(len(xyz), size=min(SAMPLE, len(xyz)), replace=False)]
        seeds, normals, offsets = _random_planes(xyz, rng)
        apart = np.abs(some @ normals.T + offsets)
        inside = cdist(some, seeds) <= 0.5 * search.extent_m
        # Zero on average where the points fill a volume.
        score = 1.5 * np.count_nonzero(inside & (apart <= search.distance_m), axis=0)
        score -= 0.5 * np.count_nonzero(inside & (apart <= 3.0 * search.distance_m), axis=0)
        best: tuple[FieldPlane, Rows] | None = None
        for index in np.argsort(-score, kind="stable")[:SHORT_LIST]:
            around = self.tree.query_ball_point(
                seeds[index], 0.5 * search.extent_m, return_sorted=True
            )
            guess = Plane(normals[index], float(offsets[index]), np.zeros((4, 4)))
            sheet = self._sheet(np.array(around), free, guess)
            if sheet is None or (best is not None and len(sheet) <= len(best[1])):
                continue
            try:
                plane = fit_robustly(name, self.cloud, sheet, search)
            except SurveyError:
                continue
            if STD_IN_DISTANCE * np.std(plane.fit.residuals) <= search.distance_m:
                best = plane, sheet
        return best

    def _sheet(self, around: Rows, free: NDArray[np.bool_], plane: Plane) -> Rows | None:
        """Grow the largest connected sheet near a plane that is refitted on the way.

        None if it is too small, or if it is no sheet: too many points lie before or behind it.
        """
        cloud, limit = self.cloud, self.search.distance_m
        sheet = around[:0]
        for _ in range(ROUNDS):
            apart = np.abs(plane.distance(cloud.xyz[around]))
            steep = cloud.incidence(around, plane) <= self.search.incidence_rad
            near = around[free[around] & steep & (apart <= limit)]
            grown = self.grid.largest_cluster(near)
            if len(grown) < self.search.min_points:
                return None
            if np.array_equal(grown, sheet):
                break
            sheet = grown
            try:
                plane = fit_plane(cloud.xyz[sheet]).plane
            except SurveyError:
                return None
        core = np.count_nonzero(np.abs(plane.distance(cloud.xyz[sheet])) <= 0.5 * limit)
        wide = steep & (apart <= 3.0 * limit) & self.grid.same_cells(sheet, around)
        return sheet if core >= MIN_THINNESS * np.count_nonzero(wide) else None


def _random_planes(xyz: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """First points, unit normals and offsets of planes through three neighbouring points."""
    some = xyz[rng.choice(len(xyz), size=min(4 * SAMPLE, len(xyz)), replace=False)]
    first = rng.integers(len(some), size=HYPOTHESES)
    radius = NEIGHBOURHOOD * np.linalg.norm(some[first], axis=1)
    near = KDTree(some).query_ball_point(some[first], radius, return_sorted=True)
    pick = rng.random((HYPOTHESES, 2))
    others = np.array(
        [
            [around[int(share * len(around))] for share in shares]
            for around, shares in zip(near, pick, strict=True)
        ]
    )
    a, b = some[others[:, 0]] - some[first], some[others[:, 1]] - some[first]
    normals = np.cross(a, b)
    area = np.linalg.norm(normals, axis=1)
    # Three points almost on a line, as along one ring, fix no plane.
    good = area > 0.05 * np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    seeds, normals = some[first[good]], normals[good] / area[good, None]
    return seeds, normals, -np.einsum("ni,ni->n", normals, seeds)


class _Grid:
    """Cells of laser and rotational angle: neighbours there are neighbours on any plane.

    Unlike a grid of metres, it is as coarse as the rings are at every range.
    """

    def __init__(self, cloud: Cloud) -> None:
        rank = np.argsort(np.argsort(cloud.parameters.v, kind="stable"), kind="stable")
        self.columns = round(2.0 * np.pi / CELL_RAD)
        self.cells = (len(rank) + 2) * self.columns  # two lines more: no neighbours over the edge
        theta = cloud.phi - cloud.parameters.alpha[cloud.laser_id]
        column = np.floor(theta / (2.0 * np.pi) * self.columns).astype(np.int64) % self.columns
        self.cell = rank[cloud.laser_id] * self.columns + column

    def same_cells(self, rows: Rows, others: Rows) -> NDArray[np.bool_]:
        """Tell which of the others lie in a cell of some row."""
        occupied = np.zeros(self.cells, dtype=bool)
        occupied[self.cell[rows]] = True
        return np.asarray(occupied[self.cell[others]])

    def largest_cluster(self, rows: Rows) -> Rows:
        """Those rows whose cells hang together, the most of them; a gap of one cell is none."""
        if not len(rows):
            return rows
        cells, of = np.unique(self.cell[rows], return_inverse=True)
        number = np.full(self.cells, -1)
        number[cells] = np.arange(len(cells))
        line, column = np.divmod(cells, self.columns)
        begin, end = [], []
        for down, right in ((0, 1), (0, 2), (1, -1), (1, 0), (1, 1), (2, 0)):
            beside = number[(line + down) * self.columns + (column + right) % self.columns]
            begin.append(np.flatnonzero(beside >= 0))
            end.append(beside[beside >= 0])
        edges = (np.concatenate(begin), np.concatenate(end))
        links = coo_array((np.ones(len(edges[0])), edges), shape=(len(cells), len(cells)))
        _, label = connected_components(links, directed=False)
        cluster = label[of]
        return rows[cluster == np.argmax(np.bincount(cluster))]


def laser_columns(plane: FieldPlane, cloud: Cloud, sigma_m: float) -> dict[str, NDArray[Any]]:
    """Statistics of s on a plane, one element per laser that sees it, in cm and per cent.

    Parameters
    ----------
    plane : FieldPlane
    cloud : Cloud
        The points that it was fitted in.
    sigma_m : float
        Standard deviation of the datasheet, metres.
    """
    laser_id = cloud.laser_id[plane.rows]
    lasers = laser_statistics(plane.s, laser_id, len(cloud.parameters), sigma_m)
    columns = statistics_table({}, {plane.name: lasers})
    seen = columns["count"] > 0
    return {("plane" if k == "calibration" else k): v[seen] for k, v in columns.items()}


def plane_row(
    plane: FieldPlane,
    lasers: Mapping[str, NDArray[Any]],
    medians: Mapping[str, NDArray[Any]],
) -> dict[str, Any]:
    """Row of the table of planes, in metres, degrees and centimetres.

    Parameters
    ----------
    plane : FieldPlane
    lasers : mapping of str to ndarray
        What `laser_columns` gave for it.
    medians : mapping of str to ndarray
        Columns ``spread`` (raw ticks) and ``count`` of the cloud's medians.
    """
    summary = summary_row(lasers)
    often = plane.rows[medians["count"][plane.rows] >= MIN_SPREAD_COUNT]
    spread = medians["spread"][often] * DISTANCE_TICK_M * 1e2
    return {
        "plane": plane.name,
        "points": len(plane.rows),
        "trimmed": plane.trimmed,
        "lasers": summary["lasers"],
        "range_m": plane.range_m,
        "incidence_deg": float(np.rad2deg(plane.incidence_rad)),
        "tilt_deg": float(np.rad2deg(plane.tilt_rad)),
        "std_cm": summary["std_cm"],
        "mean_std_cm": summary["mean_std_cm"],
        "pooled_rms_cm": summary["pooled_rms_cm"],
        "spread_cm": float(np.median(spread)) if len(spread) else float("nan"),
        "flatness_mean_cm": plane.fit.flatness_mean_m * 1e2,
        "flatness_max_cm": plane.fit.flatness_max_m * 1e2,
    }
