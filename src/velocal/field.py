"""Recordings without a survey: planes found in the data, and how flat each laser sees them.

A plane is searched by RANSAC and must be one connected, thin sheet as seen from the scanner; a
slice through a hedge is neither. The plane is then fitted robustly, so that a laser's own error
stays in: returns are trimmed about the median of their laser, never about the plane.
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
from velocal.validation import LaserStatistics, laser_statistics

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
#: Share of the points within 3 distances of a plane that must lie within half a distance: 1/6
#: where points fill a volume, 1/2 where the plane cuts through another surface.
MIN_THINNESS = 0.6
#: Width of the cells in which connectedness is examined.
CELL_RAD = np.deg2rad(0.6)
#: Trimming: limit in robust standard deviations, largest number of rounds.
TRIM_AT, ROUNDS = 3.0, 10
#: Standard deviations of normal noise in its median absolute deviation.
STD_PER_MAD = 1.4826


@dataclass(frozen=True)
class Cloud:
    """Returns, or medians of them, with the points that a calibration gives.

    Attributes
    ----------
    distance_m, phi : ndarray, shape (n,)
        Raw distance, metres; rotational angle, radians.
    laser_id : ndarray of int, shape (n,)
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
        cls,
        distance_m: Array,
        phi: Array,
        laser_id: NDArray[np.integer],
        parameters: ParameterSet,
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
        phi = angle_from_ticks(
            medians["azimuth"], laser_id, scanner, 2.0 * np.pi * rotation_rate_hz
        )
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

    def cosine(self, rows: Rows, plane: Plane) -> Array:
        """Cosine of the angle of incidence of rows."""
        return np.abs(self.direction[rows] @ plane.normal)


@dataclass(frozen=True)
class Search:
    """What counts as a plane.

    Attributes
    ----------
    planes : int
        Planes to find at most.
    distance_m : float
        Half of the thickness within which points belong to a plane.
    extent_m : float
        Largest diameter of a plane; what looks flat over metres is not over a whole street.
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
            search["planes"],
            search["distance_cm"] * 1e-2,
            search["extent_m"],
            search["min_points"],
            float(np.deg2rad(search["incidence_deg"])),
            search["seed"],
        )


@dataclass(frozen=True)
class FieldPlane:
    """A plane fitted to points of a recording.

    Attributes
    ----------
    name : str
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


def patch_points(xyz: Array, box: Mapping[str, Sequence[float]]) -> Rows:
    """Rows of the points, shape (n, 3), inside a box: `x_m`, `y_m`, `z_m`, each from and to."""
    inside = np.ones(len(xyz), dtype=bool)
    for axis, name in enumerate(("x_m", "y_m", "z_m")):
        low, high = sorted(box[name])
        inside &= (xyz[:, axis] >= low) & (xyz[:, axis] <= high)
    return np.flatnonzero(inside)


def fit_robustly(name: str, cloud: Cloud, rows: Rows, search: Search) -> FieldPlane:
    """Fit a plane to rows of a cloud without its outliers and without grazing returns.

    Raises
    ------
    SurveyError
        If too few points or lasers are left.
    """
    keep = np.ones(len(rows), dtype=bool)
    grazing = np.zeros(len(rows), dtype=bool)
    _, laser = np.unique(cloud.laser_id[rows], return_inverse=True)
    for _ in range(ROUNDS):
        _check_size(name, cloud, rows[keep], search)
        fit = fit_plane(cloud.xyz[rows[keep]])
        grazing = cloud.cosine(rows, fit.plane) < np.cos(search.incidence_rad)
        s = cloud.s(rows, fit.plane)
        about = s - _medians(s, laser, keep & ~grazing)[laser]
        size = np.abs(about[keep & ~grazing])
        # Never finer than half a tick: noise-free medians would trim themselves away.
        sigma = max(STD_PER_MAD * float(np.median(size)) if len(size) else 0.0, DISTANCE_TICK_M / 2)
        changed = ~grazing & (np.abs(about) <= TRIM_AT * sigma)
        if np.array_equal(changed, keep):
            break
        keep = changed
    chosen = rows[keep]
    _check_size(name, cloud, chosen, search)
    fit = fit_plane(cloud.xyz[chosen])
    return FieldPlane(
        name,
        fit,
        chosen,
        cloud.s(chosen, fit.plane),
        int(np.count_nonzero(~keep & ~grazing)),
        float(np.mean(cloud.distance_m[chosen])),
        float(np.mean(np.arccos(np.minimum(cloud.cosine(chosen, fit.plane), 1.0)))),
    )


def _check_size(name: str, cloud: Cloud, rows: Rows, search: Search) -> None:
    lasers = len(np.unique(cloud.laser_id[rows]))
    if len(rows) < search.min_points or lasers < MIN_LASERS:
        raise SurveyError(
            f"{name}: {len(rows)} points of {lasers} lasers",
            allowed=f"{search.min_points} points of {MIN_LASERS} lasers, or more",
        )


def _medians(values: Array, group: Rows, chosen: NDArray[np.bool_]) -> Array:
    """Median of the chosen values of each group; infinite for a group without any."""
    medians = np.full(int(group.max()) + 1, np.inf)
    order = np.lexsort((values[chosen], group[chosen]))
    of = group[chosen][order]
    present, begin, count = np.unique(of, return_index=True, return_counts=True)
    ordered = values[chosen][order]
    medians[present] = 0.5 * (ordered[begin + (count - 1) // 2] + ordered[begin + count // 2])
    return medians


def fit_patches(
    cloud: Cloud, patches: Mapping[str, Mapping[str, Sequence[float]]], search: Search
) -> tuple[list[FieldPlane], list[str]]:
    """Fit a plane to the points in each box.

    Returns
    -------
    planes : list of FieldPlane
    findings : list of str
        Why a box gave no plane.
    """
    planes, findings = [], []
    for name, box in patches.items():
        try:
            planes.append(fit_robustly(name, cloud, patch_points(cloud.xyz, box), search))
        except SurveyError as error:
            findings.append(str(error))
    return planes, findings


def find_planes(cloud: Cloud, search: Search) -> tuple[list[FieldPlane], list[str]]:
    """Search planes, the one with most points first.

    Returns
    -------
    planes : list of FieldPlane
        Named plane1, plane2, ...
    findings : list of str
        What there is to say if none was found.
    """
    rng = np.random.default_rng(search.seed)
    grid, tree = _Grid(cloud), KDTree(cloud.xyz)
    free = np.ones(len(cloud.xyz), dtype=bool)
    planes: list[FieldPlane] = []
    while len(planes) < search.planes and np.count_nonzero(free) >= search.min_points:
        found = _largest_plane(f"plane{len(planes) + 1}", cloud, grid, tree, free, search, rng)
        if found is None:
            break
        plane, band = found
        planes.append(plane)
        free[band] = False
    if planes:
        return planes, []
    what = f"no connected plane of {search.min_points} points of {MIN_LASERS} lasers was found"
    return [], [f"{what} within {search.distance_m * 100:g} cm among {len(cloud.xyz)} points"]


def _largest_plane(
    name: str,
    cloud: Cloud,
    grid: _Grid,
    tree: KDTree,
    free: NDArray[np.bool_],
    search: Search,
    rng: np.random.Generator,
) -> tuple[FieldPlane, Rows] | None:
    """One round of the search: the largest sheet among the best random planes, and its band."""
    open_ = np.flatnonzero(free)
    some = cloud.xyz[open_[rng.choice(len(open_), size=min(SAMPLE, len(open_)), replace=False)]]
    seeds, normals, offsets = _random_planes(cloud.xyz[open_], rng)
    if not len(seeds):
        return None
    apart = np.abs(some @ normals.T + offsets)
    inside = cdist(some, seeds) <= 0.5 * search.extent_m
    # Zero on average where the points fill a volume.
    score = 1.5 * np.count_nonzero(inside & (apart <= search.distance_m), axis=0)
    score -= 0.5 * np.count_nonzero(inside & (apart <= 3.0 * search.distance_m), axis=0)
    best: tuple[FieldPlane, Rows] | None = None
    for index in np.argsort(-score, kind="stable")[:SHORT_LIST]:
        around = np.array(tree.query_ball_point(seeds[index], 0.5 * search.extent_m))
        plane = Plane(normals[index], float(offsets[index]), np.zeros((4, 4)))
        sheet = _grown_sheet(cloud, grid, np.sort(around), free, plane, search)
        if sheet is None or (best is not None and len(sheet) <= len(best[1])):
            continue
        try:
            best = fit_robustly(name, cloud, sheet, search), sheet
        except SurveyError:
            continue
    return best


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


def _grown_sheet(
    cloud: Cloud,
    grid: _Grid,
    around: Rows,
    free: NDArray[np.bool_],
    plane: Plane,
    search: Search,
) -> Rows | None:
    """Largest connected sheet of the free rows near a plane that is refitted as it grows.

    None if it is too small, or if it is no sheet: too many points lie before or behind it.
    """
    xyz, direction, unused = cloud.xyz[around], cloud.direction[around], free[around]
    sheet = np.empty(0, dtype=np.int64)
    for _ in range(ROUNDS):
        apart = np.abs(plane.distance(xyz))
        steep = np.abs(direction @ plane.normal) >= np.cos(search.incidence_rad)
        near = unused & steep & (apart <= search.distance_m)
        grown = grid.largest_cluster(around[near])
        if len(grown) < search.min_points:
            return None
        if np.array_equal(grown, sheet):
            break
        sheet = grown
        try:
            plane = fit_plane(cloud.xyz[sheet]).plane
        except SurveyError:
            return None
    core = np.count_nonzero(np.abs(plane.distance(cloud.xyz[sheet])) <= 0.5 * search.distance_m)
    beside = steep & (apart <= 3.0 * search.distance_m) & grid.same_cells(sheet, around)
    return sheet if core >= MIN_THINNESS * np.count_nonzero(beside) else None


class _Grid:
    """Cells of laser and rotational angle: neighbours there are neighbours on any plane.

    Unlike a grid of metres, it is as coarse as the rings are at every range.
    """

    def __init__(self, cloud: Cloud) -> None:
        rank = np.argsort(np.argsort(cloud.parameters.v, kind="stable"), kind="stable")
        self.columns = round(2.0 * np.pi / CELL_RAD)
        theta = cloud.phi - cloud.parameters.alpha[cloud.laser_id]
        column = np.floor(theta / (2.0 * np.pi) * self.columns).astype(np.int64) % self.columns
        self.shape = (len(rank) + 2, self.columns)  # two rows more: no neighbours over the edge
        self.cell = rank[cloud.laser_id] * self.columns + column

    def same_cells(self, rows: Rows, others: Rows) -> NDArray[np.bool_]:
        """Tell which of the others lie in a cell of some row."""
        occupied = np.zeros(self.shape[0] * self.shape[1], dtype=bool)
        occupied[self.cell[rows]] = True
        return np.asarray(occupied[self.cell[others]])

    def largest_cluster(self, rows: Rows) -> Rows:
        """Those of the rows whose cells hang together, most of them; a gap of one cell is none."""
        if not len(rows):
            return rows
        cells, of = np.unique(self.cell[rows], return_inverse=True)
        number = np.full(self.shape[0] * self.shape[1], -1)
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


def plane_statistics(plane: FieldPlane, cloud: Cloud, sigma_m: float) -> LaserStatistics:
    """Statistics of s per laser on a plane, for a datasheet's standard deviation."""
    return laser_statistics(
        plane.s, cloud.laser_id[plane.rows], len(cloud.parameters), sigma_m
    )
