"""Input of the adjustment of a unit: the stations, and the means of their azimuth bins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from velocal.adjustment.observations import Observations
from velocal.adjustment.stochastic import SurveyUncertainty
from velocal.arrays import Array, joined_rows
from velocal.errors import VelocalError
from velocal.geometry.rigid import RigidTransformation
from velocal.scanner.parameters import LaserParameters


@dataclass(frozen=True)
class UnitStation:
    """One position of the unit: its observations, and how well it was surveyed.

    Attributes
    ----------
    name : str
        Name of the position.
    observations : Observations
        Of all windows and samples at this position together.
    survey : SurveyUncertainty
        Covariances of the pose and of the planes.
    plane_names : tuple of str
        Names of the planes, in the order of the numbers in `Observations.plane`.
    pose : RigidTransformation or None
        `T_scanner_site`. With it, a plane that several stations see has one error of its targets
        and one relief, which they share; without it, every station has its own.
    expected : ndarray, shape (lasers,), or None
        Number of observations that every laser should have there, however far they lie from
        their planes; None where it is not known.
    """

    name: str
    observations: Observations
    survey: SurveyUncertainty
    plane_names: tuple[str, ...]
    pose: RigidTransformation | None = None
    expected: Array | None = None

    def __post_init__(self) -> None:
        """Check that numbers of planes, covariances and names agree."""
        known = len(self.survey.planes)
        seen = int(self.observations.plane_number.max(initial=-1)) + 1
        if len(self.plane_names) != known or seen > known or len(self.survey.flatness_m) != known:
            raise VelocalError(
                f"{len(self.plane_names)} names and {len(self.survey.flatness_m)} values of "
                f"flatness for {known} surveyed planes, of which {seen} are observed",
                where=f"position {self.name!r}",
                allowed="the same number of each",
            )


@dataclass(frozen=True)
class Bins:
    """Means of the azimuth bins of all stations, sorted by laser, station, angle and plane.

    Attributes
    ----------
    mean : Observations
        One row per bin: mean angle, and the distance whose misclosure at the factory's parameters
        is the mean of the bin. `mean.plane` is the number of the plane in its station.
    count : ndarray, shape (n,)
        Number of observations in the bin.
    """

    mean: Observations
    count: Array


def azimuth_bins(
    stations: Sequence[UnitStation], factory: LaserParameters, width_rad: float
) -> Bins:
    """Average the misclosures of every laser, station and plane in bins of azimuth.

    Means of distances would be wrong by millimetres where a beam meets a wall at a flat angle;
    means of misclosures are not.

    Parameters
    ----------
    stations : sequence of UnitStation
    factory : LaserParameters
        Where the misclosures are computed.
    width_rad : float

    Returns
    -------
    Bins

    Raises
    ------
    VelocalError
        If an observation is of a laser that the parameters lack, or is not finite.
    """
    rows: list[Observations] = []
    counts: list[Array] = []
    for number, station in enumerate(stations):
        data = station.observations
        n = len(data.phi)
        laser = np.asarray(data.laser_id, dtype=np.int64)
        if n and not 0 <= laser.min() <= laser.max() < len(factory):
            raise VelocalError(
                f"laser {laser.max() if laser.max() >= len(factory) else laser.min()}",
                where=f"position {station.name!r}",
                allowed=f"0 to {len(factory) - 1}",
            )
        s = data.misclosure(factory)
        if not np.isfinite(s).all():
            raise VelocalError(
                f"{int(np.sum(~np.isfinite(s)))} of {n} observations have no finite distance to "
                "their plane",
                where=f"position {station.name!r}",
                hint="Leave out beams that are parallel to their plane.",
            )
        phi = np.mod(data.phi, 2.0 * np.pi)
        cells = int(np.ceil(2.0 * np.pi / width_rad)) + 1
        planes = len(station.plane_names)
        key = (laser * cells + np.floor(phi / width_rad).astype(np.int64)) * planes
        key = key + np.asarray(data.plane_number, dtype=np.int64)
        # Sums over all possible bins are much quicker than sorting the observations.
        count = np.bincount(key).astype(np.float64)
        found = np.flatnonzero(count)
        one_of = np.empty(len(count), dtype=np.int64)
        one_of[key] = np.arange(n)
        first, count = one_of[found], count[found]
        angle = np.bincount(key, phi)[found] / count
        mean_s = np.bincount(key, s)[found] / count
        row = replace(
            data.take(first),
            phi=angle,
            distance_m=np.zeros(len(found)),
            station=np.full(len(found), number),
            plane=np.asarray(data.plane_number, dtype=np.int64)[first],
            laser_id=laser[first],
        )
        rows.append(replace(row, distance_m=mean_s - row.misclosure(factory)))
        counts.append(count)
    mean = joined_rows(rows)
    order = np.lexsort((mean.plane_number, mean.phi, mean.station_number, mean.laser_id))
    return Bins(mean.take(order), np.concatenate(counts)[order])
