"""A calibration as the program for which it is written applies it to a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.calibration.convert import convert
from velocal.calibration.dialects import MANUAL, PAPER, Dialect, dialect_named
from velocal.calibration.files.document import CalibrationFile
from velocal.calibration.inverse import RawValues, raw_values
from velocal.scanner import beam
from velocal.scanner.models import AZIMUTH_TICK_DEG, Scanner
from velocal.scanner.parameters import LaserParameters

#: Range at which the effect of what is left out is stated, metres.
FAR_M = 80.0


@dataclass(frozen=True)
class AppliedCalibration:
    """Numbers of a calibration with the point formula that they belong to, for one recording.

    Azimuths are those of the model of this project (`beam.angle_from_ticks`); what a program adds
    to the azimuth of a firing in another way is taken into account at the rotation rate.

    Attributes
    ----------
    dialect : Dialect
    parameters : LaserParameters
        Numbers of that dialect.
    scanner : Scanner
    rate_hz : float
        Rotation rate of the recording.
    """

    dialect: Dialect
    parameters: LaserParameters
    scanner: Scanner
    rate_hz: float

    @cached_property
    def model(self) -> LaserParameters:
        """Parameters of equations (1) to (3): the same points, but for near-point corrections."""
        return convert(
            self.parameters,
            self.dialect,
            PAPER,
            scanner=self.scanner,
            rate_hz=self.rate_hz,
            inexact=True,
        )

    @cached_property
    def has_near_points(self) -> bool:
        """Whether near-point corrections take effect, so that `model` is not all."""
        effective = self.dialect.effective(self.parameters, self.scanner)
        return self.dialect.has_near(effective)

    def points(
        self,
        distance_m: Array,
        phi: Array,
        laser_id: NDArray[np.integer],
        *,
        rounded: bool = False,
    ) -> Array:
        """Compute points as the program does.

        Parameters
        ----------
        distance_m, phi : ndarray, shape (n,)
            Raw distance, metres, and rotational angle of the model, radians.
        laser_id : ndarray of int, shape (n,)
        rounded : bool
            Whether what is added to the azimuth of a firing is rounded as the program does.

        Returns
        -------
        ndarray, shape (n, 3)
            Scanner frame, metres.
        """
        if not self.has_near_points and not rounded:
            return beam.points(distance_m, phi, laser_id, self.model)
        firing = phi - 2.0 * np.pi * self.rate_hz * self.scanner.azimuth_delay_s[laser_id]
        azimuth = firing + self._added(rounded)[laser_id]
        effective = self.dialect.effective(self.parameters, self.scanner)
        return self.dialect.points(distance_m, azimuth, laser_id, effective)

    def raw(self, xyz: Array, laser_id: NDArray[np.integer], *, rounded: bool = False) -> RawValues:
        """Raw values of points that the program has computed: the inverse of `points`.

        Parameters
        ----------
        xyz : ndarray, shape (n, 3)
            Scanner frame, metres.
        laser_id : ndarray of int, shape (n,)
        rounded : bool
            As of `points`.

        Returns
        -------
        RawValues
            Its azimuths are those of the firings.
        """
        effective = self.dialect.effective(self.parameters, self.scanner)
        found = raw_values(self.dialect, xyz, laser_id, effective)
        firing = np.mod(found.azimuth - self._added(rounded)[laser_id], 2.0 * np.pi)
        return replace(found, azimuth=firing)

    def _added(self, rounded: bool) -> Array:
        """What the program adds to the azimuth of a firing, by laser, radians."""
        added = 2.0 * np.pi * self.rate_hz * self.dialect.delays_s(self.scanner)
        if rounded and self.dialect.rounds:
            # Those of firings are whole ticks; their means in medians are not.
            tick = np.deg2rad(AZIMUTH_TICK_DEG)
            added = np.round(added / tick) * tick
        return np.asarray(added)

    @property
    def left_out(self) -> str | None:
        """What of the program's formula is not applied, and its size; None if nothing is."""
        alike = PAPER.policy(self.scanner) is self.dialect.policy(self.scanner)
        if self.scanner.firing_time_s is None and not alike:
            turn = 360.0 * self.rate_hz * self.scanner.firing_cycle_s
            return (
                f"{self.dialect.name} turns azimuths within a firing of the {self.scanner.name}, "
                f"whose firing times are not known: left out, up to {turn:.2f} deg"
            )
        if self.dialect.rounds and self.dialect.delays_s(self.scanner).any():
            size = FAR_M * np.deg2rad(AZIMUTH_TICK_DEG / 2.0)
            return (
                f"{self.dialect.name} rounds azimuths to {AZIMUTH_TICK_DEG:g} deg: left out, up to "
                f"{100.0 * size:.1f} cm at {FAR_M:g} m"
            )
        return None


def applied(
    calibration: CalibrationFile | LaserParameters, scanner: Scanner, rate_hz: float
) -> AppliedCalibration:
    """Tell how a calibration is applied to a recording.

    Parameters
    ----------
    calibration : CalibrationFile or LaserParameters
        Of a file, the dialect that it states, or else that of the manufacturer; parameters are
        those of equations (1) to (3).
    scanner : Scanner
    rate_hz : float
        Rotation rate of the recording.

    Returns
    -------
    AppliedCalibration

    Raises
    ------
    ConfigError
        If the file states a dialect that is not known.
    """
    if isinstance(calibration, LaserParameters):
        return AppliedCalibration(PAPER, calibration, scanner, rate_hz)
    name = calibration.dialect
    dialect = MANUAL if name is None else dialect_named(name, where="dialect")
    return AppliedCalibration(dialect, calibration.parameters, scanner, rate_hz)
