"""Poses and planes at the point of linearisation: the survey with the errors that were found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from velocal.adjustment.nuisance import by_plane, by_pose
from velocal.adjustment.unit.model import Linearised, Shared
from velocal.adjustment.unit.station import Bins, UnitStation
from velocal.arrays import Array
from velocal.geometry.rigid import RigidTransformation, rotation_from_vector


@dataclass(frozen=True)
class CorrectedSurvey:
    """Corrections of the poses and planes, about which the misclosures are linearised.

    The pose of a small base is wrong by nearly 1 degree at times. The terms of second order then
    matter: they depend on azimuth and laser, and were explained by errors of voff and v.

    Attributes
    ----------
    stations : tuple of UnitStation
        As surveyed, with poses about the scanner (`model.about_scanner`).
    pose : ndarray, shape (stations, 6)
        Rotation vector and movement of the site about each scanner (rad, m).
    planes : tuple of ndarray, shape (planes, 4)
        Corrections of normal and offset of the planes of every station; in the site frame where
        the pose is known, else in that of the scanner.
    """

    stations: tuple[UnitStation, ...]
    pose: Array
    planes: tuple[Array, ...]

    @classmethod
    def none(cls, stations: Sequence[UnitStation]) -> CorrectedSurvey:
        """Take the survey as it is."""
        planes = tuple(np.zeros((len(station.plane_names), 4)) for station in stations)
        return cls(tuple(stations), np.zeros((len(stations), 6)), planes)

    @classmethod
    def of(cls, stations: Sequence[UnitStation], shared: Shared, errors: Array) -> CorrectedSurvey:
        """Take the survey with the errors that an adjustment has found.

        Parameters
        ----------
        stations : sequence of UnitStation
            As surveyed.
        shared : Shared
        errors : ndarray, shape (m,)
            Of the columns of `shared`, in units of their standard deviations.
        """
        found = cls.none(stations)
        for number, station in enumerate(stations):
            found.pose[number] = shared.pose(number) @ errors
            for effect in shared.effects:
                seen = effect.station in (-1, number) and effect.name in station.plane_names
                if effect.kind == "planes" and seen:
                    place = station.plane_names.index(effect.name)
                    found.planes[number][place] = effect.root @ errors[effect.columns]
        return found

    def _turn(self, number: int) -> RigidTransformation:
        """Movement of the site in the scanner frame of a station."""
        rotation = rotation_from_vector(self.pose[number, :3])
        centre = self.stations[number].survey.translation
        translation = centre + self.pose[number, 3:] - rotation @ centre
        return RigidTransformation(rotation, translation, np.zeros((6, 6)))

    def moved(self) -> list[UnitStation]:
        """Stations with the corrected poses; covariances are turned with them."""
        found = []
        for number, station in enumerate(self.stations):
            turn = self._turn(number)
            matrix = turn.plane_matrix()
            pose = station.pose
            if pose is not None:
                pose = RigidTransformation(
                    turn.rotation @ pose.rotation, turn.apply(pose.translation), pose.covariance
                )
            survey = replace(
                station.survey,
                translation=turn.apply(station.survey.translation),
                planes=matrix @ station.survey.planes @ matrix.T,
            )
            found.append(replace(station, survey=survey, pose=pose))
        return found

    def bins(self, bins: Bins) -> Bins:
        """Bins whose planes, in the scanner frame, are the corrected ones."""
        mean = bins.mean
        normal, offset = mean.normal.copy(), mean.offset.copy()
        for number, station in enumerate(self.moved()):
            rows = mean.station_number == number
            plane = np.column_stack([mean.normal[rows], mean.offset[rows]])
            plane = plane @ self._turn(number).plane_matrix().T
            change = self.planes[number] @ _to_scanner(station).T
            plane += change[mean.plane_number[rows]]
            plane /= np.linalg.norm(plane[:, :3], axis=1)[:, None]
            normal[rows], offset[rows] = plane[:, :3], plane[:, 3]
        return replace(bins, mean=replace(mean, normal=normal, offset=offset))

    def accounted(self, bins: Bins, at: Linearised) -> Array:
        """What the corrections add to z, as the unknowns are relative to the survey, (n,).

        Parameters
        ----------
        bins : Bins
            With the corrected planes.
        at : Linearised
            The misclosures of these.
        """
        found = np.zeros(len(at.z))
        for number, station in enumerate(self.moved()):
            rows = bins.mean.station_number == number
            point, towards = at.point[rows], at.towards[rows]
            normal = bins.mean.normal[rows]
            found[rows] = (
                by_pose(point, normal, towards, station.survey.translation) @ self.pose[number]
            )
            change = self.planes[number] @ _to_scanner(station).T
            own = change[bins.mean.plane_number[rows]]
            found[rows] += np.einsum("ni,ni->n", by_plane(point, towards), own)
        return found


def _to_scanner(station: UnitStation) -> Array:
    return np.eye(4) if station.pose is None else station.pose.plane_matrix()
