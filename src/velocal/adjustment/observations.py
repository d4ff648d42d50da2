"""Distances to planes: what all adjustments take, and what residuals are computed from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import design, misclosure
from velocal.arrays import Array, joined_rows, rows_of
from velocal.scanner.parameters import LaserParameters


@dataclass(frozen=True)
class Observations:
    """Distances to planes whose lasers are adjusted, from one or several stations.

    Attributes
    ----------
    distance_m, phi, laser_id : ndarray, shape (n,)
        Raw distance (metres), rotational angle (radians), laser.
    normal : ndarray, shape (n, 3)
        Unit normal of the plane of each, in the scanner frame of its station.
    offset : ndarray, shape (n,)
        Its offset, metres.
    plane : ndarray of int, shape (n,), or None
        Plane among those of the station; None where there is one only.
    station : ndarray of int, shape (n,), or None
        Station; None where there is one only.
    """

    distance_m: Array
    phi: Array
    laser_id: NDArray[np.integer]
    normal: Array
    offset: Array
    plane: NDArray[np.integer] | None = None
    station: NDArray[np.integer] | None = None

    @property
    def plane_number(self) -> NDArray[np.integer]:
        """`plane`, zeros where it is None."""
        return np.zeros(len(self.phi), dtype=np.int64) if self.plane is None else self.plane

    @property
    def station_number(self) -> NDArray[np.integer]:
        """`station`, zeros where it is None."""
        return np.zeros(len(self.phi), dtype=np.int64) if self.station is None else self.station

    def take(self, rows: slice | NDArray[np.integer] | NDArray[np.bool_]) -> Observations:
        """Some of the observations."""
        return rows_of(self, rows)

    def misclosure(self, parameters: LaserParameters, scale: Array | None = None) -> Array:
        """Distance s along the beam of every observation, metres, shape (n,)."""
        return misclosure(
            self.distance_m, self.phi, self.laser_id, parameters, self.normal, self.offset, scale
        )

    def design(
        self, parameters: LaserParameters, scale: Array | None = None
    ) -> tuple[Array, Array]:
        """Misclosures and design matrix; see `functional.design`."""
        return design(
            self.distance_m, self.phi, self.laser_id, parameters, self.normal, self.offset, scale
        )


def joined(stations: Sequence[Observations]) -> Observations:
    """Observations of several stations, to be adjusted together."""
    return joined_rows(
        [
            replace(each, plane=each.plane_number, station=np.full(len(each.phi), number))
            for number, each in enumerate(stations)
        ]
    )
