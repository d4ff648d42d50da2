"""Result of the adjustment of a unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.result import CalibrationSet
from velocal.arrays import Array

#: Parameters of the result, in the order of its vectors and matrices.
NAMES = ("dl", "alpha", "v")
#: Quantile of 95 % of a normal distribution.
NORMAL_95 = 1.644854


@dataclass(frozen=True)
class Component:
    """A property of the unit, with its interval.

    Attributes
    ----------
    name : str
        ``sigma_dl``, ``sigma_alpha``, ``sigma_v``, ``sigma_scale`` (or ``sigma_far``: of the
        correction at the far point), ``sigma_voff``, ``sigma_hoff``: standard deviations over the
        lasers; ``sigma_shift``: of the shift of a laser at a station; ``sigma_plane``: of the shift
        of a laser on a plane; ``sigma_common``: of the common shift of a station;
        ``sigma_relief``: of the deviations of surfaces from their planes, as a multiple of what
        the stations state, where it is learnt; ``tau``,
        ``omega``: median over the lasers of the pattern along azimuth and of the white noise of
        one observation; ``length``: correlation length of the pattern.
    unit : str
        ``m``, ``rad`` or ``1``.
    value, low, high : float
        Median and the quantiles of 5 and 95 %; for ``tau`` and ``omega`` over the lasers. They are
        equal where the value is given.
    learnt : bool
        Whether it was estimated from the unit.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    learnt: bool

    @property
    def rms(self) -> float:
        """Root of the mean square, with the logarithm taken as normal.

        A value of this size that is not known exactly causes errors of this variance.
        """
        width = np.log(self.high / self.low) / (2.0 * NORMAL_95)
        return float(self.value * np.exp(width**2))


@dataclass(frozen=True)
class CommonPart:
    """Mean of a parameter over the lasers, which an error of the survey can imitate.

    Attributes
    ----------
    name : str
        ``dl``, ``alpha`` or ``v``.
    unit : str
        ``m`` or ``rad``.
    value, std : float
        Mean correction that the calibration contains.
    by_survey, by_survey_std : float
        What the data and the survey alone say.
    decided : float
        1 where the survey decides on the mean, 0 where it stays at the factory's value because
        the survey does not know it better than the lasers differ from each other.
    """

    name: str
    unit: str
    value: float
    std: float
    by_survey: float
    by_survey_std: float
    decided: float

    @property
    def at_factory(self) -> bool:
        """Whether the mean was left at the factory's value."""
        return self.decided == 0.0


@dataclass(frozen=True)
class PlaneEffect:
    """What the adjustment found of a plane.

    Attributes
    ----------
    name : str
    correction : ndarray, shape (4,)
        Of normal and offset as surveyed, scanner frame.
    std : ndarray, shape (4,)
        Standard deviations of the corrected plane, without those of the pose.
    count : int
        Number of observations.
    before_m, after_m : float
        Mean misclosure with the factory's parameters and with the adjusted ones, both on the
        plane as surveyed, metres; NaN without observations.
    """

    name: str
    correction: Array
    std: Array
    count: int
    before_m: float
    after_m: float


@dataclass(frozen=True)
class StationEffect:
    """What the adjustment found of a station.

    Attributes
    ----------
    name : str
    shift_m, shift_std_m : float
        Shift that the distances of all lasers have in common there.
    pose : ndarray, shape (6,)
        Correction of rotation vector and translation of `T_scanner_site` (rad, m).
    pose_prior, pose_covariance : ndarray, shape (6, 6)
        Covariance from the survey, and after the adjustment.
    planes : tuple of PlaneEffect
    count : ndarray of int, shape (lasers,)
        Number of observations of every laser.
    share : ndarray, shape (lasers,), or None
        Observations of every laser, of those that it should have; None where that number is not
        known. It is 1 where no observation is expected.
    """

    name: str
    shift_m: float
    shift_std_m: float
    pose: Array
    pose_prior: Array
    pose_covariance: Array
    planes: tuple[PlaneEffect, ...]
    count: NDArray[np.int64]
    share: Array | None

    @property
    def pose_in_std(self) -> float:
        """Length of the correction of the pose in units of its prior; about 2.4 at most."""
        values, vectors = np.linalg.eigh(self.pose_prior)
        kept = values > 1e-12 * max(float(values[-1]), 1e-300)
        if not kept.any():
            return 0.0
        return float(np.linalg.norm(self.pose @ vectors[:, kept] / np.sqrt(values[kept])))


@dataclass(frozen=True)
class UnitNoise:
    """Noise of the distances of a unit.

    Attributes
    ----------
    tau : ndarray, shape (lasers, stations)
        Standard deviation of the pattern along azimuth, metres; NaN where not observed.
    omega : ndarray, shape (lasers, stations)
        Of the white noise of one observation.
    length_rad : float
        Correlation length of the pattern along azimuth (Matern 3/2).
    """

    tau: Array
    omega: Array
    length_rad: float


@dataclass(frozen=True)
class Held:
    """A parameter of a laser that is not known better than before.

    Attributes
    ----------
    laser_id : int
    name : str
    determined : float
        Share that the data decide.
    """

    laser_id: int
    name: str
    determined: float


@dataclass(frozen=True)
class RangeScale:
    """What the data say of the change of a distance correction with the range.

    It is estimated with all else, so that it does not disturb the other parameters, but it is not
    corrected.

    Attributes
    ----------
    value, std : ndarray, shape (lasers,)
        Metres per metre, relative to the factory.
    determined : ndarray, shape (lasers,)
        Share that the data decide of it: 1 - variance / variance over the lasers.
    near_m, far_m : ndarray, shape (lasers,)
        Shortest and longest range of the observations of a laser; NaN without any. Nothing is
        known beyond them.
    """

    value: Array
    std: Array
    determined: Array
    near_m: Array
    far_m: Array

    def change(self, range_m: Array, laser_id: NDArray[np.integer], mean_m: Array) -> Array:
        """Change of the correction from the mean range of a laser, never extrapolated.

        Parameters
        ----------
        range_m : ndarray, shape (n,)
            Ranges along the beam, metres. Beyond those observed, the correction stays constant.
        laser_id : ndarray of int, shape (n,)
        mean_m : ndarray, shape (lasers,)
            `UnitCalibration.mean_range_m`.

        Returns
        -------
        ndarray, shape (n,)
            Metres.
        """
        near, far = (
            np.where(np.isfinite(each), each, mean_m) for each in (self.near_m, self.far_m)
        )
        within = np.clip(range_m, near[laser_id], far[laser_id])
        return np.asarray(self.value[laser_id] * (within - mean_m[laser_id]))


@dataclass(frozen=True)
class UnitCalibration:
    """Calibration of a unit from all its stations.

    Attributes
    ----------
    calibration : CalibrationSet
        Corrections of dl, alpha and v. That of dl holds at `mean_range_m`. Sources of covariance:
        ``noise``, ``prior`` (true values that the data do not determine), ``offsets`` (of voff and
        hoff), ``shift`` (of lasers at stations and on planes, and common to all), ``pose``,
        ``planes``, ``flatness``, ``population`` (standard deviations of the unit that are not
        known exactly).
    shared : ndarray, shape (lasers, 3, q)
        What lasers have in common: ``shared[k] @ shared[l].T`` is the covariance between the
        corrections of the lasers k and l.
    determined : ndarray, shape (lasers, 3)
        Share of each parameter that the data decided: 1 - variance / variance of the prior.
    held : tuple of Held
        What stays at the value of the factory (with the common part of the unit), as the data say
        nearly nothing.
    common : tuple of CommonPart
        Of dl, alpha and v.
    population : tuple of Component
    stations : tuple of StationEffect
    noise : UnitNoise
    mean_range_m : ndarray, shape (lasers,)
        Mean range of the observations of every laser, at which its dl holds: the distance along
        the beam to the plane, not the raw one.
    range_limits_m : tuple of float
        Shortest and longest range that was observed.
    far_point_m : float or None
        Range at which the correction of the distance has faded to zero.
    range_scale : RangeScale or None
        None where there is a far point.
    passes : int
        How often observations were assigned to planes; 1 without `readjust`.
    warnings : tuple of str
        What a user should know before the calibration is used.
    """

    calibration: CalibrationSet
    shared: Array
    determined: Array
    held: tuple[Held, ...]
    common: tuple[CommonPart, ...]
    population: tuple[Component, ...]
    stations: tuple[StationEffect, ...]
    noise: UnitNoise
    mean_range_m: Array
    range_limits_m: tuple[float, float]
    far_point_m: float | None
    range_scale: RangeScale | None = None
    passes: int = 1
    warnings: tuple[str, ...] = field(default=())

    @property
    def kept(self) -> Mapping[int, tuple[str, ...]]:
        """Names of the parameters in `held`, by laser."""
        found: dict[int, tuple[str, ...]] = {}
        for one in self.held:
            found[one.laser_id] = (*found.get(one.laser_id, ()), one.name)
        return found

    def to_columns(self) -> dict[str, Array]:
        """Columns of a table of the lasers: `CalibrationSet.to_columns` and the shares."""
        shares = zip(self.calibration.names, self.determined.T, strict=True)
        return self.calibration.to_columns() | {f"{name}_from_data": each for name, each in shares}

    def sigma(self, name: str) -> float:
        """Value of a component of the population."""
        return next(one.value for one in self.population if one.name == name)

    def std_without_mean(self, name: str) -> Array:
        """Standard deviation of a correction minus its mean over the lasers, shape (lasers,).

        Where the mean stays at the factory's value, the covariance of the calibration contains
        that the lasers differ from the factory by chance in the mean too: by their spread over
        the root of their number. The data know the differences between lasers better.

        Parameters
        ----------
        name : {"dl", "alpha", "v"}
        """
        place = NAMES.index(name)
        together = self.shared[:, place]
        own = self.calibration.covariance[:, place, place] - (together**2).sum(axis=1)
        n = len(own)
        apart = together - together.mean(axis=0)
        variance = (1.0 - 2.0 / n) * own + own.sum() / n**2 + (apart**2).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def range_factor(self, range_m: Array) -> Array:
        """Factor of the correction of dl of every laser at some ranges.

        Parameters
        ----------
        range_m : ndarray, shape (n,)
            Ranges along the beam (corrected distances), metres.

        Returns
        -------
        ndarray, shape (lasers, n)
            1 at the mean range of the laser. With a far point it falls linearly to 0 there;
            without one it is 1 at all ranges.
        """
        ranges = np.atleast_1d(np.asarray(range_m, dtype=np.float64))
        if self.far_point_m is None:
            return np.ones((len(self.mean_range_m), len(ranges)))
        left = np.maximum(self.far_point_m - ranges, 0.0)
        return np.asarray(left / (self.far_point_m - self.mean_range_m)[:, None])

    def near_correction(self, range_m: Array) -> Array:
        """Correction of the distance of every laser at some ranges, metres, (lasers, n).

        Parameters
        ----------
        range_m : ndarray, shape (n,)
            Ranges along the beam (corrected distances), metres; 2.4 and 1.93 for the near points
            of a two-point file.
        """
        dl = self.calibration.corrections[:, NAMES.index("dl")]
        return np.asarray(dl[:, None] * self.range_factor(range_m))
