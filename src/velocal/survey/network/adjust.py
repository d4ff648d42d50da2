"""Least-squares adjustment of a network of sights, image rays and control points.

Functional model: directions, zenith angles and slope distances of levelled total stations, image
coordinates of calibrated cameras (collinearity), coordinates of control points with their full
covariance. Levelled stations leave four freedoms of the frame, shifts and the turn about the
plumb line: the datum, fixed by inner constraints over the control points (minimum partial
trace). The normal equations are assembled from a sparse design matrix and bordered by the
constraints; all statistics follow from their inverse. Textbook: Caspary, Concepts of Network
and Deformation Analysis; Luhmann et al., Close-Range Photogrammetry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from velocal.adjustment.quality import variance_factor_test
from velocal.errors import SurveyError
from velocal.survey.network.approximate import (
    intersection,
    resected_camera,
    resected_setup,
    unit_vectors,
)
from velocal.survey.network.model import (
    DEFECT,
    KINDS,
    NO_RAYS,
    Bordered,
    Control,
    Observed,
    Unknowns,
    ray_equations,
    sight_equations,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Largest change of an unknown (metres, radians) at which the iteration ends, and its steps.
STANDSTILL, MAX_ITERATIONS = 1e-9, 30


@dataclass(frozen=True)
class Network:
    """An adjusted network.

    Attributes
    ----------
    name : tuple of str
        Points: the control points, then the others in order of appearance.
    xyz : ndarray, shape (n, 3)
        Metres.
    cofactor : ndarray, shape (3n, 3n)
        Covariance as it follows from the stated standard deviations alone, square metres.
    variance_factor, probability : float
        Estimated from the residuals; probability of a worse one (both sides), the global test.
    redundancy : int
    largest_residual : float
        Largest normalised residual (Baarda), and the observation that has it.
    largest_residual_of : str
    setups : dict of str to ndarray, shape (3,)
        Adjusted places of stations and cameras, metres.
    rays : dict of str to int
        Set-ups that observed each point.
    iterations : int
    """

    name: tuple[str, ...]
    xyz: Array
    cofactor: Array
    variance_factor: float
    probability: float
    redundancy: int
    largest_residual: float
    largest_residual_of: str
    setups: dict[str, Array]
    rays: dict[str, int]
    iterations: int

    @property
    def covariance(self) -> Array:
        """A posteriori: cofactors times the estimated variance factor, square metres."""
        return self.cofactor * self.variance_factor

    @property
    def std(self) -> Array:
        """A posteriori standard deviations of the coordinates, metres, shape (n, 3)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)).reshape(-1, 3))

    def rows(self, names: Sequence[str]) -> tuple[Index, Index]:
        """Rows of points in `xyz`, and of their coordinates in `cofactor`."""
        points = np.array([self.name.index(name) for name in names], dtype=np.int64)
        return points, (3 * points[:, None] + np.arange(3)).ravel()

    def control(self, names: Sequence[str], *, a_priori: bool = False) -> Control:
        """Some points as control of the next adjustment."""
        points, rows = self.rows(names)
        covariance = self.cofactor if a_priori else self.covariance
        return Control(tuple(names), self.xyz[points], covariance[np.ix_(rows, rows)])


def adjust_network(
    control: Control,
    sights: Observed | None = None,
    rays: Observed | None = None,
    *,
    where: str = "network",
) -> Network:
    """Adjust points, set-ups and cameras; the unknowns start from what the observations give.

    Parameters
    ----------
    control : Control
        Datum points; with a covariance they are observations as well.
    sights, rays : Observed
        Of total stations and of images.
    where : str
        File, for errors.

    Raises
    ------
    SurveyError
        If a point hangs in the air (one set-up only, or not connected to the others), a set-up
        cannot be placed, or the iteration does not come to rest.
    """
    model = _Model(control, sights or Observed(), rays or NO_RAYS, where)
    unknowns, weight = model.start(), model.control_weight()
    for iterations in range(1, MAX_ITERATIONS + 1):
        misclosure, design = model.linearise(unknowns)
        difference = (control.xyz - unknowns.points[: len(control.name)]).ravel()
        system = Bordered(design, weight, model.datum(), where=where)
        if iterations == 1:
            system.check(model.name)
        step = system.step(misclosure, difference)
        unknowns = unknowns.moved(step)
        if np.max(np.abs(step)) < STANDSTILL:
            break
    else:
        raise SurveyError(
            f"the adjustment does not come to rest in {MAX_ITERATIONS} iterations",
            where=where,
            hint="Look for exchanged point names, wrong units, or a gross error.",
        )
    residual, design = model.linearise(unknowns)
    difference = (control.xyz - unknowns.points[: len(control.name)]).ravel()
    known = len(weight) - DEFECT if control.covariance is not None else 0
    redundancy = len(residual) + known + DEFECT - model.unknowns
    cofactor = Bordered(design, weight, model.datum(), where=where).inverse()
    squares = float(residual @ residual + difference @ weight @ difference)
    factor = squares / redundancy if redundancy else float("nan")
    # Rows are divided by their standard deviations: redundancy numbers are 1 - diag(A Q A').
    share = 1.0 - (design.multiply(design @ cofactor)).sum(axis=1)
    normalised = np.abs(residual) / np.sqrt(np.maximum(share, 1e-6))
    worst = int(np.argmax(normalised))
    size = 3 * len(model.name)
    return Network(
        name=model.name,
        xyz=unknowns.points,
        cofactor=cofactor[:size, :size],
        variance_factor=factor,
        probability=variance_factor_test(factor, redundancy) if redundancy else float("nan"),
        redundancy=redundancy,
        largest_residual=float(normalised[worst]),
        largest_residual_of=model.label(worst),
        setups=dict(
            zip(
                model.stations + model.images,
                [*unknowns.stations[:, :3], *unknowns.cameras],
                strict=True,
            )
        ),
        rays=model.seen(),
        iterations=iterations,
    )


class _Model:
    """Observations with numbered points and set-ups."""

    def __init__(self, control: Control, sights: Observed, rays: Observed, where: str) -> None:
        self.control, self.sights, self.rays, self.where = control, sights, rays, where
        self.name = tuple(dict.fromkeys((*control.name, *sights.target, *rays.target)))
        self.stations = tuple(dict.fromkeys(sights.setup))
        self.images = tuple(dict.fromkeys(rays.setup))
        self.unknowns = 3 * len(self.name) + 4 * len(self.stations) + 6 * len(self.images)
        number = {name: row for row, name in enumerate(self.name)}
        self.sight_point = np.array([number[t] for t in sights.target], dtype=np.int64)
        self.ray_point = np.array([number[t] for t in rays.target], dtype=np.int64)
        self.sight_setup = _numbered(sights.setup, self.stations)
        self.ray_setup = _numbered(rays.setup, self.images)
        self.check()

    def check(self) -> None:
        """Check that every point is seen from two set-ups and connected to the others."""
        seen, known = self.seen(), self.control.covariance is not None
        for name in self.name:
            if seen[name] < 2 and not (known and name in self.control.name):
                raise SurveyError(
                    f"point {name!r} is seen from {seen[name]} set-up(s)",
                    where=self.where,
                    allowed="2 or more",
                    hint="Nothing would check it, or determine it: observe it once more.",
                )
        points, setups = len(self.name), len(self.stations) + len(self.images)
        one = np.concatenate([self.sight_point, self.ray_point])
        other = np.concatenate([self.sight_setup, len(self.stations) + self.ray_setup]) + points
        if known:  # control points hang together by themselves
            one = np.concatenate([one, np.zeros(len(self.control.name), dtype=np.int64)])
            other = np.concatenate([other, np.arange(len(self.control.name))])
        graph = sparse.coo_array(
            (np.ones(len(one)), (one, other)), shape=(points + setups, points + setups)
        )
        count, part = connected_components(graph, directed=False)
        if count > 1:
            lost = int(np.flatnonzero(part[:points] != np.bincount(part).argmax())[0])
            raise SurveyError(
                f"point {self.name[lost]!r} is not connected to the rest of the network",
                where=self.where,
                hint="Set-ups must share points with each other.",
            )

    def seen(self) -> dict[str, int]:
        """Count the set-ups that see each point."""
        pairs = {*zip(self.sights.setup, self.sights.target, strict=True)}
        pairs |= {*zip(self.rays.setup, self.rays.target, strict=True)}
        counts = dict.fromkeys(self.name, 0)
        for _, target in pairs:
            counts[target] += 1
        return counts

    def start(self) -> Unknowns:
        """Set-ups from the control points, then the other points from the set-ups."""
        n = len(self.control.name)
        points = np.full((len(self.name), 3), np.nan)
        points[:n] = self.control.xyz
        stations, cameras, rotations = [], [], []
        polar = np.isfinite(self.sights.value).all(axis=1)
        for number, name in enumerate(self.stations):
            own = polar & (self.sight_setup == number) & (self.sight_point < n)
            place, zero = resected_setup(
                self.sights.value[own], points[self.sight_point[own]],
                where=f"{self.where}, set-up {name!r}",
            )  # fmt: skip
            stations.append([*place, zero])
        for number, name in enumerate(self.images):
            own = (self.ray_setup == number) & (self.ray_point < n)
            place, rotation = resected_camera(
                self.rays.value[own], points[self.ray_point[own]],
                where=f"{self.where}, image {name!r}",
            )  # fmt: skip
            cameras.append(place)
            rotations.append(rotation)
        found = Unknowns(
            points,
            np.array(stations).reshape(-1, 4),
            np.array(cameras).reshape(-1, 3),
            np.array(rotations).reshape(-1, 3, 3),
        )
        both = np.isfinite(self.sights.value[:, :2]).all(axis=1)
        setup, value = found.stations[self.sight_setup[both]], self.sights.value[both]
        towards = np.column_stack([self.rays.value, np.ones(len(self.rays.value))])
        towards = np.einsum("nji,nj->ni", found.rotations[self.ray_setup], towards)
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        owner = np.concatenate([self.sight_point[both], self.ray_point])
        origin = np.concatenate([setup[:, :3], found.cameras[self.ray_setup]])
        ray = np.concatenate([unit_vectors(value[:, 0] + setup[:, 3], value[:, 1]), towards])
        for number in range(n, len(points)):
            own = owner == number
            try:
                points[number] = intersection(origin[own], ray[own])
            except SurveyError as error:
                raise SurveyError(
                    f"point {self.name[number]!r}: {error.what}", where=self.where, hint=error.hint
                ) from None
        return found

    def linearise(self, at: Unknowns) -> tuple[Array, sparse.csr_array]:
        """Observed minus computed and its derivatives, rows divided by standard deviations."""
        first = 3 * len(self.name)
        computed, by_point, by_setup = sight_equations(
            at.points[self.sight_point], at.stations[self.sight_setup]
        )
        misclosure = self.sights.value - computed
        misclosure[:, 0] = np.mod(misclosure[:, 0] + np.pi, 2.0 * np.pi) - np.pi
        there = np.isfinite(misclosure)
        sights = _rows(
            misclosure[there],
            self.sights.std[there],
            np.concatenate([by_point, by_setup], axis=2)[there],
            self._columns(self.sight_point, first + 4 * self.sight_setup, 4),
            np.nonzero(there)[0],
        )
        first += 4 * len(self.stations)
        computed, by_point, by_setup = ray_equations(
            at.points[self.ray_point], at.cameras[self.ray_setup], at.rotations[self.ray_setup]
        )
        n, k = computed.shape
        rays = _rows(
            (self.rays.value - computed).ravel(),
            self.rays.std.ravel(),
            np.concatenate([by_point, by_setup], axis=2).reshape(n * k, 9),
            self._columns(self.ray_point, first + 6 * self.ray_setup, 6),
            np.repeat(np.arange(n), k),
        )
        parts = [(w, value, columns) for w, value, columns in (sights, rays) if len(w)]
        size = [value.shape[1] for _, value, _ in parts for _ in range(len(value))]
        design = sparse.csr_array(
            (
                np.concatenate([value.ravel() for _, value, _ in parts]),
                np.concatenate([columns.ravel() for _, _, columns in parts]),
                np.concatenate([[0], np.cumsum(size)]),
            ),
            shape=(len(size), self.unknowns),
        )
        return np.concatenate([w for w, _, _ in parts]), design

    @staticmethod
    def _columns(point: Index, setup: Index, size: int) -> Index:
        return np.column_stack(
            [3 * point[:, None] + np.arange(3), setup[:, None] + np.arange(size)]
        )

    def label(self, row: int) -> str:
        """Name an observation by its row of the design matrix."""
        labels = []
        for observed, kinds in ((self.sights, KINDS[0]), (self.rays, KINDS[1])):
            for number, kind in zip(*np.nonzero(np.isfinite(observed.value)), strict=True):
                labels.append(f"{kinds[kind]} {observed.setup[number]}-{observed.target[number]}")
        return labels[row]

    def control_weight(self) -> Array:
        """Inverse of the control points' covariance, in its range: the datum has none."""
        covariance = self.control.covariance
        if covariance is None:
            return np.zeros((3 * len(self.control.name),) * 2)
        values, vectors = np.linalg.eigh((covariance + covariance.T) / 2.0)
        vectors = vectors[:, DEFECT:]
        return np.asarray((vectors / values[DEFECT:]) @ vectors.T)

    def datum(self) -> Array:
        """Inner constraints: shifts of the control points, and their turn about the plumb line."""
        xyz = self.control.xyz - self.control.xyz.mean(axis=0)
        turn = np.column_stack([-xyz[:, 1], xyz[:, 0], np.zeros(len(xyz))]).ravel()
        border = np.zeros((self.unknowns, DEFECT))
        border[: xyz.size, :3] = np.tile(np.eye(3), (len(xyz), 1)) / np.sqrt(len(xyz))
        border[: xyz.size, 3] = turn / np.linalg.norm(turn)
        return border


def _rows(
    misclosure: Array, std: Array, derivatives: Array, columns: Index, row: Index
) -> tuple[Array, Array, Index]:
    """Rows of the design matrix, homogenised; `row` is the sight or ray of each."""
    return misclosure / std, derivatives / std[:, None], columns[row]


def _numbered(names: Sequence[str], order: Sequence[str]) -> Index:
    number = {name: row for row, name in enumerate(order)}
    return np.array([number[name] for name in names], dtype=np.int64)
