"""Stochastic model: what is known before the adjustment of observations, parameters and survey."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.errors import VelocalError


@dataclass(frozen=True, kw_only=True)
class SurveyUncertainty:
    """Uncertainty of the pose and the planes of one station.

    Attributes
    ----------
    translation : ndarray, shape (3,)
        Of ``T_scanner_site``, metres.
    pose : ndarray, shape (6, 6)
        Covariance of its rotation vector and translation (rad, m).
    planes : ndarray, shape (k, 4, 4)
        Covariance of normal and offset of every plane from its targets, without the pose.
    flatness_m : ndarray, shape (k,)
        Standard deviation of the surface of every plane about it, metres.
    """

    translation: Array
    pose: Array
    planes: Array
    flatness_m: Array


@dataclass(frozen=True, kw_only=True)
class Stochastic:
    """A-priori knowledge.

    Attributes
    ----------
    noise_std_m : float
        Standard deviation of a distance, metres.
    prior_std : mapping of str to float
        Standard deviation of the corrections that the factory's accuracy allows, by parameter;
        metres and radians. It scales the parameters to each other.
    angle_std_rad : float
        Standard deviation of a rotational angle, radians.
    block_rad : float or None
        Width of a block, radians. Misclosures of one block, which are near each other in
        rotational angle and on one plane, are correlated; the spread of the blocks gives the
        noise of the parameters. None where misclosures are independent.
    range_scale : float
        Standard deviation of the range scale of a laser, where it is not adjusted.
    repeatability_m : float
        Standard deviation of the change of the distances of a laser from one recording to
        another, metres.
    survey : tuple of SurveyUncertainty
        Uncertainty of the survey, by station.
    """

    noise_std_m: float
    prior_std: Mapping[str, float]
    angle_std_rad: float = 0.0
    block_rad: float | None = None
    range_scale: float = 0.0
    repeatability_m: float = 0.0
    survey: tuple[SurveyUncertainty, ...] = ()

    def prior_of(self, names: Sequence[str]) -> Array:
        """Prior standard deviations of some parameters, shape (u,).

        Raises
        ------
        VelocalError
            If one of the parameters has no prior standard deviation.
        """
        if missing := [name for name in names if name not in self.prior_std]:
            raise VelocalError(
                f"no prior standard deviation of {', '.join(missing)}",
                where="adjustment",
                allowed=", ".join(self.prior_std),
                hint="give it a prior, or do not adjust it",
            )
        return np.array([self.prior_std[name] for name in names])

    def sigma_misclosure(self, by_phi: Array) -> Array:
        """Standard deviation of misclosures with derivative `by_phi` by the rotational angle."""
        return np.sqrt(self.noise_std_m**2 + (by_phi * self.angle_std_rad) ** 2)


def block_numbers(phi: Array, group: NDArray[np.integer], width: float) -> NDArray[np.int64]:
    """Number the blocks of neighbouring angles within a group (station and plane).

    Parameters
    ----------
    phi : ndarray, shape (n,)
        Rotational angles, radians.
    group : ndarray of int, shape (n,)
        Rows of different groups are never in one block.
    width : float
        Width of a block, radians.

    Returns
    -------
    ndarray of int, shape (n,)
        Numbers 0, 1, ... in the order of group and angle.
    """
    cells = int(np.ceil(2.0 * np.pi / width)) + 1
    cell = np.floor(np.mod(phi, 2.0 * np.pi) / width).astype(np.int64)
    used = np.bincount(group * cells + cell) > 0
    return np.asarray((np.cumsum(used) - 1)[group * cells + cell])
