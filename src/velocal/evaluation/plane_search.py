"""Search for planes in the points of a recording.

Random planes through neighbouring points compete (RANSAC). The points of a plane must form one
connected, thin cluster as seen from the scanner; a slice through a hedge is neither connected nor
thin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.evaluation.planes_in_data import (
    MIN_LASERS,
    Cloud,
    FieldPlane,
    Found,
    Search,
    fit_robustly,
)
from velocal.geometry.planes import Plane, fit_plane

Rows = NDArray[np.int64]

#: Random planes of one round of the search, and the best of them that are looked at closely.
HYPOTHESES, SHORT_LIST = 1000, 25
#: Points on which random planes are compared.
SAMPLE = 5000
#: The three points of a random plane lie within this share of their range.
NEIGHBOURHOOD = 0.15
#: Share of the points within 3 distances of a found plane that must lie within half a distance:
#: 1/6 where points fill a volume, up to 1/2 where the plane cuts through other surfaces.
MIN_THINNESS = 0.6
#: The distance must be at least this multiple of the standard deviation of a plane's points.
STD_IN_DISTANCE = 3.0
#: Width of the grid cells in which connectedness is examined.
CELL_RAD = np.deg2rad(0.6)
#: Rounds in which a cluster may grow.
ROUNDS = 10


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
        plane, cluster = found
        planes.append(plane)
        free[cluster] = False
    if planes:
        return planes, []
    return [], [
        f"no plane found: among {len(cloud.xyz)} points no connected cluster of "
        f"{search.min_points} points of {MIN_LASERS} lasers lies within "
        f"{search.distance_m * 100:g} cm of a plane"
    ]


class _Finder:
    """Search for planes in one cloud."""

    def __init__(self, cloud: Cloud, search: Search) -> None:
        self.cloud, self.search = cloud, search
        self.grid, self.tree = _Grid(cloud), KDTree(cloud.xyz)

    def largest(
        self, name: str, free: NDArray[np.bool_], rng: np.random.Generator
    ) -> tuple[FieldPlane, Rows] | None:
        """Find the largest cluster of free points near one of many random planes.

        Parameters
        ----------
        name : str
            Of the plane.
        free : ndarray of bool, shape (n,)
            Points that no plane has yet.
        rng : Generator

        Returns
        -------
        (FieldPlane, ndarray of int) or None
            The plane and the cluster that it was fitted to; None without any.
        """
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
            cluster = self._cluster(np.array(around), free, guess)
            if cluster is None or (best is not None and len(cluster) <= len(best[1])):
                continue
            try:
                plane = fit_robustly(name, self.cloud, cluster, search)
            except SurveyError:
                continue
            if STD_IN_DISTANCE * np.std(plane.fit.residuals) <= search.distance_m:
                best = plane, cluster
        return best

    def _cluster(self, around: Rows, free: NDArray[np.bool_], plane: Plane) -> Rows | None:
        """Grow the largest connected cluster near a plane that is refitted on the way.

        None if it is too small, or if it is not thin: too many points lie before or behind it.
        """
        cloud, limit = self.cloud, self.search.distance_m
        cluster = around[:0]
        for _ in range(ROUNDS):
            apart = np.abs(plane.distance(cloud.xyz[around]))
            steep = cloud.incidence(around, plane) <= self.search.incidence_rad
            near = around[free[around] & steep & (apart <= limit)]
            grown = self.grid.largest_cluster(near)
            if len(grown) < self.search.min_points:
                return None
            if np.array_equal(grown, cluster):
                break
            cluster = grown
            try:
                plane = fit_plane(cloud.xyz[cluster]).plane
            except SurveyError:
                return None
        core = np.count_nonzero(np.abs(plane.distance(cloud.xyz[cluster])) <= 0.5 * limit)
        wide = steep & (apart <= 3.0 * limit) & self.grid.same_cells(cluster, around)
        return cluster if core >= MIN_THINNESS * np.count_nonzero(wide) else None


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
        return np.isin(self.cell[others], self.cell[rows])

    def largest_cluster(self, rows: Rows) -> Rows:
        """Rows of the largest connected cluster of cells; one empty cell does not break it."""
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
        return np.asarray(rows[cluster == np.argmax(np.bincount(cluster))])
