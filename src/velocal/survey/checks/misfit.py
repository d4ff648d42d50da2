"""Whether the medians contradict the pose, a plane, or the calibration file.

All errors that are known beforehand are adjusted together: those of the lasers (their priors), what
all lasers have in common, the pose (covariance of its targets), the planes (covariance of theirs).
What remains is tested for one more unknown at a time, as data snooping does: a shift of a plane, a
change of the pose, errors of the lasers beyond their priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtr

from velocal.adjustment.functional import design
from velocal.adjustment.nuisance import by_plane
from velocal.adjustment.stochastic import Stochastic
from velocal.arrays import Array
from velocal.scanner.models import Scanner
from velocal.scanner.parameters import LaserParameters
from velocal.survey.checks.cells import Cells
from velocal.survey.checks.findings import SEVERE, SIGNIFICANCE, Finding, severity
from velocal.survey.station import Station

#: Standard deviation of what all lasers measure too long at a position, metres: not known.
_COMMON_M = 1.0
#: Shift of distances on one surface against another, of all lasers and of each, metres (estimated
#: from real recordings).
_SURFACE_M = 0.004
#: Share by which a vertical shift may differ from the height of the origin to be explained by it:
#: the limits of the assignment cut the largest residuals.
_SAME_HEIGHT = 0.35
#: Parameters whose errors have priors here, and those of the priors that are not given.
_PARAMETERS = {"dl": 0.02, "alpha": np.deg2rad(0.2), "v": np.deg2rad(0.2)}


@dataclass(frozen=True)
class Misfit:
    """One tested group of unknowns.

    Attributes
    ----------
    value : ndarray, shape (r,)
        Estimate of the unknowns.
    std : ndarray, shape (r,)
        Their standard deviations; infinite where they cannot be determined.
    statistic : float
        Chi-square distributed, if the unknowns are zero.
    dof : int
    effect_m : float
        Root mean square change of the distances in question, metres.
    """

    value: Array
    std: Array
    statistic: float
    dof: int
    effect_m: float

    def log_p(self) -> float:
        """Logarithm of the probability of such a statistic by chance."""
        return float(np.log(chdtrc(self.dof, self.statistic))) if self.dof else 0.0


@dataclass(frozen=True)
class Misfits:
    """All tests of one sample.

    Attributes
    ----------
    pose : Misfit
        Change of the pose beyond its covariance: rotation vector (rad) and translation (m).
    height : Misfit
        Shift of the scanner along its own Z axis beyond the covariance of the pose, metres.
    planes : tuple of Misfit
        Shift of every plane towards the scanner beyond its covariance, metres.
    lasers : dict of str to float
        Root mean square of the errors of the lasers over the standard deviation of their prior,
        by parameter; what all lasers have in common is left out.
    """

    pose: Misfit
    height: Misfit
    planes: tuple[Misfit, ...]
    lasers: dict[str, float]


def misfits(
    cells: Cells, parameters: LaserParameters, station: Station, stochastic: Stochastic
) -> Misfits:
    """Adjust what is known with its uncertainty, and test what remains.

    Parameters
    ----------
    cells : Cells
        Of one sample.
    parameters : LaserParameters
        Of the factory.
    station : Station
    stochastic : Stochastic
        Priors of the lasers; noise and survey are taken from `cells` and `station`.
    """
    lasers, of_laser = np.unique(cells.laser_id, return_inverse=True)
    n, k, m = len(cells), len(lasers), len(station.planes)
    offset = np.array([patch.plane.offset for patch in station.patches])[cells.plane]
    direction_length = np.linalg.norm(cells.point, axis=1)
    _, matrix = design(
        direction_length, cells.phi, cells.laser_id, parameters, cells.normal, offset
    )
    prior = {name: stochastic.prior_std.get(name, std) for name, std in _PARAMETERS.items()}
    own = np.array(list(prior.values()))
    own[0] = np.hypot(own[0], stochastic.repeatability_m)
    of_cell = matrix[:, :3] * own
    scale = direction_length * stochastic.range_scale
    # Every unknown is divided by its standard deviation: the prior is the unit matrix.
    columns = np.zeros((n, 4 * k))
    for j in range(3):
        columns[np.arange(n), of_laser * 4 + j] = of_cell[:, j]
    columns[np.arange(n), of_laser * 4 + 3] = scale
    shift = np.zeros((n, k * m))
    shift[np.arange(n), of_laser * m + cells.plane] = _SURFACE_M
    on_plane = (cells.plane[:, None] == np.arange(m)).astype(float)
    # What all lasers have in common: distance, yaw and tilt of the angles, range scale, and shifts
    # of the surfaces along the beam and across the plane.
    common = np.column_stack(
        [
            np.full(n, _COMMON_M),
            of_cell[:, 1:],
            scale,
            _SURFACE_M * on_plane,
            _SURFACE_M * on_plane / cells.towards[:, None],
        ]
    )
    to_pose = cells.by_pose(station)
    pose = to_pose @ _root(station.pose.covariance)
    of_plane = by_plane(cells.point, cells.towards)
    planes = np.zeros((n, 4 * m))
    for number, patch in enumerate(station.patches):
        rows = cells.plane == number
        planes[rows, 4 * number : 4 * number + 4] = of_plane[rows] @ _root(patch.plane.covariance)
    known = np.hstack([columns, shift, common, pose, planes])
    flat = np.array([each.flatness_std_m for each in station.planes])[cells.plane]
    variance = cells.spread**2 + (flat / cells.towards) ** 2 + _SURFACE_M**2
    weighted = known / variance[:, None]
    normal = weighted.T @ known + np.eye(known.shape[1])
    inverse = np.linalg.inv(normal)
    observed = -cells.s
    right = weighted.T @ observed

    def test(extra: Array) -> Misfit:
        mixed = weighted.T @ extra
        information = extra.T @ (extra / variance[:, None]) - mixed.T @ inverse @ mixed
        gradient = extra.T @ (observed / variance) - mixed.T @ (inverse @ right)
        values, vectors = np.linalg.eigh(information)
        # Directions in which the data say less than a metre or a radian are no part of the test.
        told = values > 1.0
        turned = vectors[:, told]
        covariance = (turned / values[told]) @ turned.T
        value = covariance @ gradient
        change = extra @ value
        rows = np.any(extra != 0.0, axis=1)
        effect = float(np.sqrt(np.mean(change[rows] ** 2))) if rows.any() else 0.0
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        std[~told.any()] = np.inf
        statistic = float(gradient @ value)
        return Misfit(value, std, statistic, int(told.sum()), effect)

    solution = inverse @ right
    ratios = {}
    for j, name in enumerate(prior):
        at = np.arange(k) * 4 + j
        # What the data have added to the prior: x ~ N(0, prior - posterior).
        gained = float(np.sum(1.0 - np.diag(inverse)[at]))
        square = float(np.sum(solution[at] ** 2))
        ratios[name] = float(np.sqrt(square / gained)) if gained > 1.0 else 0.0
    towards_scanner = on_plane / cells.towards[:, None]
    return Misfits(
        pose=test(to_pose),
        height=test(to_pose[:, 5:]),
        planes=tuple(test(towards_scanner[:, [number]]) for number in range(m)),
        lasers=ratios,
    )


def check_misfits(
    tests: Misfits, station: Station, sigma_m: float, *, n_tests: int, where: str
) -> list[Finding]:
    """Find what the medians contradict: the most improbable of pose and planes, and the lasers.

    Parameters
    ----------
    tests : Misfits
    station : Station
    sigma_m : float
        Standard deviation of a distance in the datasheet, metres.
    n_tests : int
        Tests of this kind in the study, which share the significance.
    where : str
        Sample and position.

    Returns
    -------
    list of Finding
    """
    found, limit = [], float(np.log(SIGNIFICANCE / n_tests))
    groups = [tests.pose, *tests.planes]
    worst = int(np.argmin([each.log_p() for each in groups]))
    if groups[worst].log_p() < limit:
        group = groups[worst]
        found.append(
            _of_pose(group, station, sigma_m, where)
            if worst == 0
            else _of_plane(group, worst - 1, station, sigma_m, where)
        )
        return found
    name, ratio = max(tests.lasers.items(), key=lambda item: item[1])
    if ratio > SEVERE:
        found.append(
            Finding(
                "error", "errors of the lasers", where,
                f"the errors of {name} are {ratio:.2g} times as large as adjustment.prior states",
                allowed=f"at most {SEVERE:g} times",
                hint="Is the calibration file that of this unit, and the prior right?",
            )
        )  # fmt: skip
    return found


def _of_pose(group: Misfit, station: Station, sigma_m: float, where: str) -> Finding:
    turn = np.rad2deg(np.linalg.norm(group.value[:3]))
    # The change at the scanner, not at the origin of the site.
    at_scanner = group.value[3:] - np.cross(group.value[:3], station.pose.translation)
    shift = np.linalg.norm(at_scanner) * 100
    return Finding(
        severity(group.effect_m, sigma_m), "pose against the medians", where,
        f"the medians say that the scanner is turned by {turn:.2g} deg and shifted by "
        f"{shift:.2g} cm against its surveyed pose, more than the targets of its base allow: the "
        f"distances to the planes change by {group.effect_m * 100:.2g} cm",
        hint="Check the coordinates of the base, in both frames.",
    )  # fmt: skip


def _of_plane(group: Misfit, number: int, station: Station, sigma_m: float, where: str) -> Finding:
    patch, shift, std = station.patches[number], float(group.value[0]), float(group.std[0])
    side = "nearer to" if shift > 0 else "farther from"
    return Finding(
        severity(group.effect_m, sigma_m), "plane against the medians",
        f"{where}, plane {patch.name}",
        f"the medians say that the plane lies {abs(shift) * 100:.2g} +- {std * 100:.1g} cm {side} "
        f"the scanner than surveyed: its distances change by {group.effect_m * 100:.2g} cm",
        hint="Check the coordinates of this plane, the height of the base, and whether the surface "
        "has changed since the survey.",
    )  # fmt: skip


def _root(covariance: Array) -> Array:
    """Root R of a covariance, R R' = C; it may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def check_origin(
    tests: Sequence[Misfits], scanner: Scanner, sigma_m: float, *, n_tests: int
) -> list[Finding]:
    """Test whether the base was measured from its bottom instead of from the origin of the frame.

    All positions of the scanner then have the same vertical shift, whose size is known: they are
    tested together, and for this shift only.

    Parameters
    ----------
    tests : sequence of Misfits
        Of one sample per position.
    scanner : Scanner
    sigma_m : float
        Standard deviation of a distance in the datasheet, metres.
    n_tests : int
        Tests of this kind in the study, which share the significance.

    Returns
    -------
    list of Finding
        None or one.
    """
    expected = scanner.origin_height_m
    told = [each.height for each in tests if each.height.dof]
    if expected == 0.0 or not told:
        return []
    weight = np.array([1.0 / each.std[0] ** 2 for each in told])
    up = -float(weight @ [each.value[0] for each in told] / weight.sum())
    std = float(1.0 / np.sqrt(weight.sum()))
    significant = ndtr(-up / std) < SIGNIFICANCE / n_tests
    if not significant or abs(up - expected) > max(3.0 * std, _SAME_HEIGHT * expected):
        return []
    effect = max(each.effect_m for each in told)
    return [
        Finding(
            severity(effect, sigma_m), "origin of the scanner frame", f"scanner {scanner.name}",
            f"the medians say that the origin is {up * 1e3:.3g} +- {std * 1e3:.1g} mm above where "
            f"the base puts it: distances change by {effect * 100:.2g} cm",
            allowed="coordinates of the base that are counted from the origin",
            hint=f"Are the coordinates of the base counted from its bottom? The origin is "
            f"{expected * 1e3:g} mm above it: subtract that from z in the scanner frame.",
        )
    ]  # fmt: skip
