"""Medians that lie on the planes, gathered to cells of azimuth for the tests of the survey."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.nuisance import by_pose
from velocal.arrays import Array
from velocal.reduction.assignment import NO_PLANE, Limits
from velocal.scanner.beam import Beams, laser_beams
from velocal.scanner.parameters import LaserParameters
from velocal.survey.checks.hits import Hits
from velocal.survey.station import Station

#: Width of a cell, radians: residuals of a laser are correlated over less than that.
CELL_RAD = float(np.deg2rad(5.0))
_CELLS = 72


@dataclass(frozen=True)
class Cells:
    """Medians of one laser on one plane in one sector of azimuth, together.

    Attributes
    ----------
    key : ndarray of int, shape (n,)
        Number of laser, plane and sector, ascending.
    laser_id, plane : ndarray of int, shape (n,)
    s : ndarray, shape (n,)
        Median distance from the plane along the beam, metres.
    spread : ndarray, shape (n,)
        Standard deviation of s within the cell, metres.
    count : ndarray of int, shape (n,)
        Medians in the cell.
    phi : ndarray, shape (n,)
        Mean rotational angle, radians.
    point, normal, towards : ndarray
        Where the beam of the cell meets its plane, unit normal, and ``n . u``; scanner frame.
    """

    key: NDArray[np.int64]
    laser_id: NDArray[np.int64]
    plane: NDArray[np.int64]
    s: Array
    spread: Array
    count: NDArray[np.int64]
    phi: Array
    point: Array
    normal: Array
    towards: Array

    def __len__(self) -> int:
        return len(self.key)

    @classmethod
    def of(
        cls,
        beams: Beams,
        hits: Hits,
        parameters: LaserParameters,
        station: Station,
        limits: Limits,
    ) -> Cells:
        """Gather the medians within the limits.

        Parameters
        ----------
        beams : Beams
            Medians of one window or of several.
        hits : Hits
            Of these beams.
        parameters : LaserParameters
        station : Station
        limits : Limits
        """
        rows = np.flatnonzero((hits.plane != NO_PLANE) & hits.within(limits))
        phi = np.mod(beams.phi[rows], 2.0 * np.pi)
        sector = np.minimum((phi / CELL_RAD).astype(np.int64), _CELLS - 1)
        planes = len(station.planes)
        key = (beams.laser_id[rows].astype(np.int64) * planes + hits.plane[rows]) * _CELLS + sector
        order = np.lexsort((hits.s[rows], key))
        key, s, phi = key[order], hits.s[rows][order], phi[order]
        keys, begin, count = np.unique(key, return_index=True, return_counts=True)
        middle = 0.5 * (s[begin + (count - 1) // 2] + s[begin + count // 2])
        mean = np.add.reduceat(s, begin) / count if len(keys) else s
        square = np.add.reduceat(s**2, begin) / count if len(keys) else s
        angle = np.add.reduceat(phi, begin) / count if len(keys) else phi
        number = keys // _CELLS
        laser, plane = number // planes, number % planes
        direction, origin = laser_beams(angle, laser, parameters)
        normal = np.stack([patch.plane.normal for patch in station.patches])[plane]
        offset = np.array([patch.plane.offset for patch in station.patches])[plane]
        towards = np.einsum("ni,ni->n", direction, normal)
        length = -(np.einsum("ni,ni->n", origin, normal) + offset) / towards
        return cls(
            key=keys,
            laser_id=laser,
            plane=plane,
            s=middle,
            spread=np.sqrt(np.maximum(square - mean**2, 0.0)),
            count=count,
            phi=angle,
            point=origin + length[:, None] * direction,
            normal=normal,
            towards=towards,
        )

    def by_pose(self, station: Station) -> Array:
        """Derivatives of s by the pose of the station, shape (n, 6)."""
        return by_pose(self.point, self.normal, self.towards, station.pose.translation)
