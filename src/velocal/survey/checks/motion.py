"""Whether the scanner moved between two windows, or two recordings at one position."""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from velocal.survey.checks.cells import Cells
from velocal.survey.checks.findings import SIGNIFICANCE, Finding, severity
from velocal.survey.station import Station

#: Least number of cells that both windows have.
_LEAST = 50


def check_motion(
    before: Cells,
    after: Cells,
    station: Station,
    *,
    tick_m: float,
    sigma_m: float,
    n_tests: int,
    where: str,
) -> list[Finding]:
    """Test whether the pose is the same in two windows.

    A change of s has a part of every laser (warming up), which is free, and one by the pose. The
    errors of lasers and survey are the same in both windows and drop out. A change below one tick
    of the distance is not reported, however significant it is.

    Parameters
    ----------
    before, after : Cells
        Of two windows.
    station : Station
    tick_m : float
        One tick of the distance, metres.
    sigma_m : float
        Standard deviation of a distance in the datasheet, metres.
    n_tests : int
        Tests of this kind in the study, which share the significance.
    where : str
        Both windows, for the finding.

    Returns
    -------
    list of Finding
        None or one.
    """
    _, first, second = np.intersect1d(before.key, after.key, return_indices=True)
    if len(first) < _LEAST:
        return []
    change = after.s[second] - before.s[first]
    weight = np.sqrt(1.0 / (1.0 / before.count[first] + 1.0 / after.count[second]))
    _, laser = np.unique(before.laser_id[first], return_inverse=True)
    by_pose = before.by_pose(station)[first]
    # Rotations about the scanner, not about the origin of the site.
    t = station.pose.translation
    about = np.eye(6)
    about[3:, :3] = np.array([[0, t[2], -t[1]], [-t[2], 0, t[0]], [t[1], -t[0], 0]])
    full = by_pose @ about
    reduced, seen = (
        _without_lasers(full, laser, weight),
        _without_lasers(change[:, None], laser, weight)[:, 0],
    )
    values, vectors = np.linalg.eigh(reduced.T @ reduced)
    told = values > 1e-6 * values[-1]
    turned = vectors[:, told]
    pose = turned @ ((turned.T @ (reduced.T @ seen)) / values[told])
    rank = int(told.sum())
    explained = float(np.sum((reduced @ pose) ** 2))
    left = float(seen @ seen) - explained
    dof = len(seen) - int(laser.max()) - 1 - rank
    if dof < rank:
        return []
    statistic = explained / rank / (left / dof)
    effect = float(np.sqrt(np.mean((full @ pose) ** 2)))
    if fdtrc(rank, dof, statistic) > SIGNIFICANCE / n_tests or effect < tick_m:
        return []
    turn, shift = np.rad2deg(np.linalg.norm(pose[:3])), np.linalg.norm(pose[3:]) * 100
    return [
        Finding(
            severity(effect, sigma_m), "motion of the scanner", where,
            f"the scanner has turned by {turn:.2g} deg and moved by {shift:.2g} cm: the distances "
            f"to the planes change by {effect * 100:.2g} cm",
            allowed=f"{tick_m * 100:g} cm, one tick of the distance",
            hint="Fix the scanner, let nobody touch it, and record again; the base must be "
            "surveyed for the position that is recorded.",
        )
    ]  # fmt: skip


def _without_lasers(columns: np.ndarray, laser: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weighted columns without the weighted mean of every laser."""
    total = np.bincount(laser, weight**2)
    mean = np.stack(
        [np.bincount(laser, weight**2 * column) / total for column in columns.T], axis=1
    )
    return np.asarray((columns - mean[laser]) * weight[:, None])
