"""The model of a unit, linearised: columns of the lasers, and what all lasers share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import ADJUSTABLE
from velocal.adjustment.nuisance import by_plane, by_pose
from velocal.adjustment.unit.settings import UnitSettings
from velocal.adjustment.unit.station import Bins, UnitStation
from velocal.arrays import Array
from velocal.geometry.rigid import skew
from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import LaserParameters

#: Unknowns of a laser, in the order of every matrix of this package. `dl` and `scale` are the
#: two parameters of the distance: a constant and a scale, or the corrections at range zero and at
#: the far point where there is one.
UNKNOWNS = ("dl", "alpha", "v", "scale", "voff", "hoff")
#: Unknowns that have a mean over the lasers.
WITH_MEAN = 4
#: A surface has at most this number of knots; their distance grows where it would have more.
MAX_KNOTS = 150
#: Least information on a direction of relief, whose prior has the information 1.
LEAST_INFORMATION = 0.1


@dataclass(frozen=True)
class Linearised:
    """Rows ``z = A x + N nu + errors``, x relative to the factory.

    Attributes
    ----------
    z : ndarray, shape (n,)
        Minus the misclosure, plus what the point of linearisation accounts for; metres.
    matrix : ndarray, shape (n, 6)
        A, in the order of `UNKNOWNS`.
    point : ndarray, shape (n, 3)
        Where each beam meets its plane, scanner frame.
    towards : ndarray, shape (n,)
        ``n . u``.
    range_m : ndarray, shape (n,)
        Distance along the beam to the plane: what the corrected distance should be.
    """

    z: Array
    matrix: Array
    point: Array
    towards: Array
    range_m: Array


def range_columns(range_m: Array, far_point_m: float | None) -> tuple[Array, Array]:
    """Derivatives of a distance by the two parameters of its correction.

    Without far point, the correction is ``dl + scale * range``. With it, it is
    ``dl (1 - t) + scale t`` with t the range in units of the far point, at most 1.
    """
    if far_point_m is None:
        return np.ones_like(range_m), range_m
    share = np.clip(range_m / far_point_m, 0.0, 1.0)
    return 1.0 - share, share


def linearise(
    bins: Bins, factory: LaserParameters, x: Array, far_point_m: float | None
) -> Linearised:
    """Linearise the misclosures of all bins.

    Parameters
    ----------
    bins : Bins
    factory : LaserParameters
    x : ndarray, shape (lasers, 6)
        Point of linearisation, relative to the factory.
    far_point_m : float or None
        See `range_columns`.

    Notes
    -----
    The misclosure is linear in the two parameters of the distance if the column of the scale is
    the range that the plane predicts. The measured range must not be used: its noise is that of
    the misclosure, so that a scale of -1 would make all residuals zero.
    """
    data = bins.mean
    angles = ("alpha", "v", "voff", "hoff")
    at = factory.corrected({name: x[:, UNKNOWNS.index(name)] for name in angles})
    s, all_columns = data.design(at)
    range_m = data.distance_m + at.dl[data.laser_id] - s
    matrix = np.empty((len(s), len(UNKNOWNS)))
    for name in angles:
        matrix[:, UNKNOWNS.index(name)] = all_columns[:, ADJUSTABLE.index(name)]
    matrix[:, 0], matrix[:, 3] = range_columns(range_m, far_point_m)
    own = x[data.laser_id].copy()
    own[:, [0, 3]] = 0.0
    direction, origin = laser_beams(data.phi, data.laser_id, at)
    return Linearised(
        z=-s + np.einsum("ni,ni->n", matrix, own),
        matrix=matrix,
        point=origin + range_m[:, None] * direction,
        towards=np.einsum("ni,ni->n", direction, data.normal),
        range_m=range_m,
    )


@dataclass(frozen=True)
class Effect:
    """A group of shared unknowns with unit prior.

    Attributes
    ----------
    kind : {"pose", "planes", "flatness"}
    station : int
        Number of the station; -1 for what several stations share.
    name : str
        Of the station or the plane.
    columns : slice
        Among all shared unknowns of this module.
    root : ndarray
        What the unknowns are multiplied by to get corrections of pose (6, 6), as movements of the
        base, or plane (4, 3);
        that of planes is in the site frame where the pose is known. The roots of all stations
        stand one below the other in what their poses have in common. Empty for relief.
    """

    kind: str
    station: int
    name: str
    columns: slice
    root: Array


@dataclass(frozen=True)
class Shared:
    """Errors of the survey, which all lasers share, as unknowns with unit prior.

    Attributes
    ----------
    matrix : ndarray, shape (n, m)
        Derivatives of z by the unknowns.
    effects : tuple of Effect
    """

    matrix: Array
    effects: tuple[Effect, ...]

    def pose(self, station: int) -> Array:
        """Matrix that makes corrections of the pose of a station of all unknowns, (6, m)."""
        found = np.zeros((6, self.matrix.shape[1]))
        for effect in self.effects:
            if effect.kind == "pose" and effect.station == station:
                found[:, effect.columns] = effect.root
            elif effect.kind == "pose" and effect.station < 0:
                found[:, effect.columns] = effect.root[6 * station : 6 * station + 6]
        return found

    def reduced(self, weight: Array) -> Shared:
        """Leave out the directions of relief of which the data say nothing.

        The knots of each surface are turned to the eigenvectors of their information. Their prior
        is 1 in all directions, and remains so.

        Parameters
        ----------
        weight : ndarray, shape (n,)
            Inverse variances of the rows; neglecting their correlation overrates the information.
        """
        blocks, effects, used = [], [], 0
        for effect in self.effects:
            block = self.matrix[:, effect.columns]
            if effect.kind == "flatness":
                # Only the rows on this surface are not zero.
                rows = np.flatnonzero(block.any(axis=1))
                own = block[rows]
                values, vectors = np.linalg.eigh((own * weight[rows, None]).T @ own)
                vectors = vectors[:, values > LEAST_INFORMATION]
                block = np.zeros((len(block), vectors.shape[1]))
                block[rows] = own @ vectors
            blocks.append(block)
            columns = slice(used, used + block.shape[1])
            effects.append(replace(effect, columns=columns))
            used = columns.stop
        return Shared(np.concatenate(blocks, axis=1), tuple(effects))

    def columns(self, kind: str) -> NDArray[np.int64]:
        """Numbers of the unknowns of one kind."""
        chosen = [
            np.arange(e.columns.start, e.columns.stop) for e in self.effects if e.kind == kind
        ]
        return np.concatenate(chosen) if chosen else np.zeros(0, dtype=np.int64)


def root_of(covariance: Array, rank: int) -> Array:
    """Matrix R with R R' = covariance, shape (u, rank); negative eigenvalues count as zero."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0)))[:, -rank:])


def symmetric_root(covariance: Array) -> Array:
    """Symmetric root of a covariance: of two that are alike, the roots are alike too."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def shared_effects(
    stations: Sequence[UnitStation], bins: Bins, at: Linearised, settings: UnitSettings
) -> Shared:
    """Columns of pose, planes and relief.

    Parameters
    ----------
    stations : sequence of UnitStation
        With poses about the scanner, see `about_scanner`.
    bins : Bins
    at : Linearised
        Where the derivatives are taken.
    settings : UnitSettings

    Returns
    -------
    Shared
        Sparse in structure, but dense in memory: the rows are means of bins.

    Notes
    -----
    The base targets are measured once in the scanner frame, and at every station in the site
    frame. The error of the former turns and moves the scanner frame by the same amount at all
    stations, so that more stations do not average it out.
    """
    n, station_of, plane_of = len(at.z), bins.mean.station_number, bins.mean.plane_number
    blocks: list[Array] = []
    effects: list[Effect] = []
    used = 0

    def add(
        kind: str,
        station: int,
        name: str,
        rows: NDArray[np.int64],
        values: Array,
        root: Array,
    ) -> None:
        nonlocal used
        block = np.zeros((n, values.shape[1]))
        block[rows] = values
        blocks.append(block)
        effects.append(Effect(kind, station, name, slice(used, used + values.shape[1]), root))
        used += values.shape[1]

    several = len(stations) > 1
    common = settings.pose_in_common if several else 0.0
    together, roots = np.zeros((n, 6)), []
    for number, station in enumerate(stations):
        rows = np.flatnonzero(station_of == number)
        root = symmetric_root(station.survey.pose)
        derivative = by_pose(
            at.point[rows], bins.mean.normal[rows], at.towards[rows], station.survey.translation
        )
        own = np.sqrt(1.0 - common) * root
        add("pose", number, station.name, rows, derivative @ own, own)
        roots.append(np.sqrt(common) * root)
        together[rows] = derivative @ roots[-1]
    if several:
        add("pose", -1, "", np.arange(n), together, np.concatenate(roots))
    # One entry per plane, or per plane and station where its stations do not know their pose.
    members: dict[tuple[int, str], list[tuple[int, int]]] = {}
    for number, station in enumerate(stations):
        for plane, name in enumerate(station.plane_names):
            key = (-1, name) if station.pose is not None else (number, name)
            members.setdefault(key, []).append((number, plane))
    for (owner, name), seen in members.items():
        root = _site_root(stations, *seen[0])
        own_rows, columns, places, sizes = [], [], [], []
        for number, plane in seen:
            station = stations[number]
            rows = np.flatnonzero((station_of == number) & (plane_of == plane))
            to_scanner = np.eye(4) if station.pose is None else station.pose.plane_matrix()
            derivative = by_plane(at.point[rows], at.towards[rows])
            own_rows.append(rows)
            columns.append(derivative @ to_scanner @ root)
            point = at.point[rows]
            if station.pose is not None:
                point = (point - station.pose.translation) @ station.pose.rotation
            places.append(point)
            flatness = max(float(station.survey.flatness_m[plane]), settings.relief_least_m)
            sizes.append(flatness / at.towards[rows])
        rows = np.concatenate(own_rows)
        if not len(rows):
            continue
        add("planes", owner, name, rows, np.concatenate(columns), root)
        values = relief(np.concatenate(places), settings.relief_knots_m, settings.relief_length_m)
        values = values * np.concatenate(sizes)[:, None]
        add("flatness", owner, name, rows, values, np.zeros((0, values.shape[1])))
    return Shared(np.concatenate(blocks, axis=1), tuple(effects))


def lever(translation: Array) -> Array:
    """Change of rotation vector and translation of ``T_scanner_site`` by a movement of the base.

    An error of the base targets turns the site about the scanner by w and moves it by r: the
    rotation vector changes by w, the translation t by ``r + w x t``.

    Parameters
    ----------
    translation : ndarray, shape (3,)

    Returns
    -------
    ndarray, shape (6, 6)
    """
    found = np.eye(6)
    found[3:, :3] = -skew(translation)
    return found


def about_scanner(station: UnitStation) -> UnitStation:
    """State the pose of a station as a movement of its base, about the origin of the scanner.

    The translation of ``T_scanner_site`` contains the rotation times the place of the origin of the
    site. That is another one at every station, so that it hides what the errors of the base have in
    common; and it is metres away, so that the terms of second order of a rotation matter there.
    """
    back = np.linalg.inv(lever(station.survey.translation))
    survey = replace(
        station.survey, translation=np.zeros(3), pose=back @ station.survey.pose @ back.T
    )
    return replace(station, survey=survey)


def _site_root(stations: Sequence[UnitStation], number: int, plane: int) -> Array:
    """Root of the covariance of a plane, in the site frame where the pose is known."""
    station = stations[number]
    covariance = station.survey.planes[plane]
    if station.pose is not None:
        back = np.linalg.inv(station.pose.plane_matrix())
        covariance = back @ covariance @ back.T
    return root_of(covariance, 3)


def relief(points: Array, knots_m: float, length_m: float) -> Array:
    """Basis of a smooth deviation with unit variance at every point, shape (n, knots).

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres, near a plane.
    knots_m : float
        Distance of the knots. It grows for large surfaces, and the length with it.
    length_m : float
        Standard deviation of the kernel about each knot.
    """
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred.T @ centred)[0][:, :2]
    flat = centred @ axes
    around = np.array([[i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    while True:
        # One number per grid cell: rows are sorted much more slowly.
        i, j = np.round(flat / knots_m).astype(np.int64).T
        least, width = j.min(), np.ptp(j) + 1
        cells = np.unique(i * width + (j - least))
        cells = np.column_stack([cells // width, cells % width + least])
        near = np.unique((cells[:, None] + around).reshape(-1, 2), axis=0)
        if len(near) <= MAX_KNOTS:
            break
        knots_m, length_m = 1.25 * knots_m, 1.25 * length_m
    a, b = (flat[:, k, None] - near[:, k] * knots_m for k in (0, 1))
    square = a**2 + b**2
    values = np.exp(-square / (2.0 * length_m**2))
    values[square > (3.5 * length_m) ** 2] = 0.0
    return np.asarray(values / np.sqrt((values**2).sum(axis=1))[:, None])
