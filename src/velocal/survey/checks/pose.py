"""Checks of the targets of a scanner's base: global test, data snooping, handedness, units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from velocal.adjustment.nuisance import by_pose
from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.geometry.planes import Patch
from velocal.geometry.rigid import RigidAdjustment, RigidTransformation, adjust_rigid, skew
from velocal.reduction.assignment import Limits
from velocal.survey.checks.findings import SEVERE, SIGNIFICANCE, Finding, severity
from velocal.survey.station import Station
from velocal.survey.targets import Targets, common

#: No instrument measures targets better than this, metres (a laser tracker reaches 15 um).
FINEST_M = 1e-5
#: Largest extent of the targets on a base, metres. On a vehicle they may be some metres apart; a
#: base of 0.1 m in centimetres is larger.
LARGEST_BASE_M = 8.0
#: Shares of the way from the centre of a patch to its corners at which effects are computed.
_SHARES = (0.0, 0.5, 0.9)
#: Largest effect of one point, metres: beams along a plane would exceed every other.
_LARGEST_M = 1.0
_MIRROR = np.diag([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class Probes:
    """Points on the planes of a station at which the effect of a pose is computed.

    Attributes
    ----------
    point, normal : ndarray, shape (n, 3)
        Scanner frame, metres; unit normal of the plane of each.
    towards : ndarray, shape (n,)
        ``n . u`` with the direction u from the origin.
    """

    point: Array
    normal: Array
    towards: Array

    @classmethod
    def of(cls, patches: Sequence[Patch], incidence_rad: float, max_range_m: float) -> Probes:
        """Points of patches that beams reach.

        Parameters
        ----------
        patches : sequence of Patch
            Scanner frame.
        incidence_rad : float
            Largest angle between beam and normal.
        max_range_m : float
            Largest range of the scanner.
        """
        points, normals = [], []
        for patch in patches:
            centre = patch.corners.mean(axis=0)
            found = np.vstack([centre + share * (patch.corners - centre) for share in _SHARES])
            points.append(found)
            normals.append(np.broadcast_to(patch.plane.normal, found.shape))
        point, normal = np.concatenate(points), np.concatenate(normals)
        length = np.linalg.norm(point, axis=1)
        towards = np.einsum("ni,ni->n", point, normal) / length
        seen = (np.abs(towards) >= np.cos(incidence_rad)) & (length <= max_range_m)
        return cls(point[seen], normal[seen], towards[seen])

    def std(self, pose: RigidTransformation) -> float:
        """Standard deviation of distances to the planes by that of a pose, metres; 0 of no points.

        Parameters
        ----------
        pose : RigidTransformation
            ``T_scanner_site`` with its covariance.
        """
        by = by_pose(self.point, self.normal, self.towards, pose.translation)
        variance = np.einsum("ni,ij,nj->n", by, pose.covariance, by)
        return float(np.sqrt(np.mean(variance))) if len(variance) else 0.0

    def change(self, before: RigidTransformation, after: RigidTransformation) -> float:
        """Root mean square change of distances to the planes by that of a pose, metres.

        It is 0 where there are no points.

        Parameters
        ----------
        before, after : RigidTransformation
            ``T_scanner_site``.
        """
        turn = after.rotation @ before.rotation.T
        shift = after.translation - turn @ before.translation
        direction = self.point / np.linalg.norm(self.point, axis=1)[:, None]
        offset = -np.einsum("ni,ni->n", self.point, self.normal)
        normal = self.normal @ turn.T
        with np.errstate(divide="ignore", invalid="ignore"):
            length = (normal @ shift - offset) / np.einsum("ni,ni->n", direction, normal)
        change = np.abs(length - np.linalg.norm(self.point, axis=1))
        if not len(change):
            return 0.0
        return float(np.sqrt(np.mean(np.minimum(np.nan_to_num(change, nan=1.0), _LARGEST_M) ** 2)))


def check_pose(
    base_site: Targets,
    base_scanner: Targets,
    station: Station,
    *,
    limits: Limits,
    max_range_m: float,
    sigma_m: float,
    where: str,
) -> list[Finding]:
    """Check the targets of a base and the pose that they give.

    Parameters
    ----------
    base_site, base_scanner : Targets
        Targets of the base at the position, and in the scanner frame.
    station : Station
        What was adjusted from them.
    limits : Limits
        Limits of the assignment.
    max_range_m : float
        Largest range of the scanner.
    sigma_m : float
        Standard deviation of a distance in the datasheet, metres.
    where : str
        Files and position, for the findings.

    Returns
    -------
    list of Finding
    """
    site, scanner = common(base_site, base_scanner, where=where)
    fit = adjust_rigid(site.xyz, scanner.xyz, site.covariance(), scanner.covariance())
    if of_units := _too_large(site, scanner, where) or _other_unit(site, scanner, where):
        return of_units
    if min(site.std.min(), scanner.std.min()) < FINEST_M:
        return []  # `check_finest` says it, and all tests would fail
    probes = Probes.of(station.patches, limits.incidence_rad, max_range_m)
    found = _uncertain(fit, probes, limits, sigma_m, where)
    if fit.redundancy == 0:
        return found
    squares = fit.variance_factor * fit.redundancy
    if squares > chdtri(fit.redundancy, SIGNIFICANCE):
        found += _mirrored(site, scanner, squares, fit.redundancy, where) or _one_target(
            site, scanner, fit, probes, sigma_m, where
        )
    return found


def check_finest(targets: Targets, where: str) -> list[Finding]:
    """Check that the standard deviations of a file are in millimetres.

    Parameters
    ----------
    targets : Targets
        All targets of the file.
    where : str
        File.
    """
    smallest = float(targets.std.min())
    if smallest >= FINEST_M:
        return []
    return [
        Finding(
            "error", "standard deviations", where,
            f"the standard deviation {smallest * 1e3:g} mm is smaller than that of any instrument",
            allowed=f"{FINEST_M * 1e3:g} mm or more",
            hint="State standard deviations in millimetres; these look like metres.",
        )
    ]  # fmt: skip


def _uncertain(
    fit: RigidAdjustment, probes: Probes, limits: Limits, sigma_m: float, where: str
) -> list[Finding]:
    """A pose that is known far less well than the scanner measures.

    It is an error where its expanded uncertainty (k = 2) exceeds the limit of the assignment: the
    beams of a correct survey would then be taken for those of something else.
    """
    pose = fit.transformation
    std = probes.std(pose)
    if std <= SEVERE * sigma_m:
        return []
    # The axis about which the rotation is known least.
    turn = np.sqrt(np.linalg.eigvalsh(pose.covariance[:3, :3]))
    hint = "Put the targets of the base farther from each other, or measure them better."
    if turn[2] > 5.0 * turn[1]:
        hint = "The targets of the base lie nearly on one line: add one off it."
    return [
        Finding(
            "error" if 2.0 * std > limits.distance_m else "warning", "pose", where,
            f"the targets of the base give the rotation to {np.rad2deg(turn[2]):.2g} deg only: by "
            f"this alone the distances to the planes are uncertain by {std * 100:.2g} cm",
            allowed=f"{SEVERE * sigma_m * 100:g} cm, {SEVERE:g} sigma of the datasheet",
            hint=hint,
        )
    ]  # fmt: skip


def _too_large(site: Targets, scanner: Targets, where: str) -> list[Finding]:
    """A base that is larger than any on which a scanner stands."""
    size = min(float(np.ptp(each.xyz, axis=0).max()) for each in (site, scanner))
    if size <= LARGEST_BASE_M:
        return []
    return [
        Finding(
            "error", "units", where,
            f"the targets of the base are {size:.3g} m from each other",
            allowed=f"{LARGEST_BASE_M:g} m at most",
            hint="State coordinates in metres; these look like millimetres or centimetres.",
        )
    ]  # fmt: skip


def _other_unit(site: Targets, scanner: Targets, where: str) -> list[Finding]:
    """Coordinates of the two frames in different units."""
    size_site, size_scanner = (
        float(np.linalg.norm(each.xyz - each.xyz.mean(axis=0))) for each in (site, scanner)
    )
    power = round(np.log10(size_site / size_scanner))
    factor = size_site / size_scanner / 10.0**power
    if power == 0 or not 0.8 < factor < 1.25:
        return []
    larger, times = ("site", power) if power > 0 else ("scanner", -power)
    return [
        Finding(
            "error", "units", where,
            f"the base is {10**times:g} times larger in the {larger} frame than in the other",
            hint="State all coordinates in metres.",
        )
    ]  # fmt: skip


def mirrored_fit(site: Targets, scanner: Targets) -> tuple[RigidTransformation, float]:
    """Fit a reflection: the best map from site to scanner that changes the handedness.

    Parameters
    ----------
    site, scanner : Targets
        The same targets in both frames.

    Returns
    -------
    transformation : RigidTransformation
        Its matrix has the determinant -1; its covariance is not used.
    squares : float
        Weighted sum of squared residuals.
    """
    turn = np.kron(np.eye(len(site.name)), _MIRROR)
    of_site = turn @ site.covariance() @ turn.T
    fit = adjust_rigid(site.xyz @ _MIRROR, scanner.xyz, of_site, scanner.covariance())
    found = fit.transformation
    improper = RigidTransformation(found.rotation @ _MIRROR, found.translation, found.covariance)
    return improper, fit.variance_factor * fit.redundancy if fit.redundancy else 0.0


def _mirrored(
    site: Targets, scanner: Targets, squares: float, redundancy: int, where: str
) -> list[Finding]:
    """Coordinates of different handedness: a reflection fits far better than a rotation."""
    _, reflected = mirrored_fit(site, scanner)
    if squares - reflected < chdtri(redundancy, SIGNIFICANCE):
        return []
    return [
        Finding(
            "error", "handedness", where,
            "the targets of the base fit their mirror image far better than themselves: sums of "
            f"squares {reflected:.3g} and {squares:.3g} for a redundancy of {redundancy}",
            allowed="right-handed coordinates in both frames",
            hint="Two axes are exchanged or the sign of one is wrong, in the scanner frame or in "
            "the site frame. In the scanner frame Y is forward, X to the right, Z up.",
        )
    ]  # fmt: skip


def _one_target(
    site: Targets,
    scanner: Targets,
    fit: RigidAdjustment,
    probes: Probes,
    sigma_m: float,
    where: str,
) -> list[Finding]:
    """Targets that disagree: the one that does so most, or all of them.

    The statistic of a target is that of an error in all its coordinates (Baarda's data snooping for
    three observations together): w' N^-1 w with w = E' P e and N = E' P Q_ee P E.
    """
    n, pose = len(site.name), fit.transformation
    turn = np.kron(np.eye(n), pose.rotation)
    weight = np.linalg.inv(scanner.covariance() + turn @ site.covariance() @ turn.T)
    a = np.concatenate([np.hstack([-skew(p), np.eye(3)]) for p in site.xyz @ pose.rotation.T])
    reduced = weight - weight @ a @ np.linalg.solve(a.T @ weight @ a, a.T @ weight)
    w = (weight @ fit.residuals.ravel()).reshape(n, 3)
    values = np.array(
        [
            w[i] @ np.linalg.pinv(reduced[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], 1e-6) @ w[i]
            for i in range(n)
        ]
    )
    worst = int(np.argmax(values))
    ratio = float(np.sqrt(fit.variance_factor))
    text = (
        f"the targets of the base disagree by {ratio:.2g} times their standard deviations (largest "
        f"residual {np.abs(fit.residuals).max() * 1e3:.2g} mm)"
    )
    hint = "Measure the base again, or state the standard deviations that it really has."
    if n > 3 and values[worst] > chdtri(3, SIGNIFICANCE / n):
        keep = [i for i in range(n) if i != worst]
        try:
            rest = adjust_rigid(
                site.xyz[keep], scanner.xyz[keep],
                site.take(keep).covariance(), scanner.take(keep).covariance(),
            )  # fmt: skip
        except SurveyError:  # the others lie on a line
            rest = fit
        effect = probes.change(pose, rest.transformation)
        return [
            Finding(
                severity(effect, sigma_m), "targets of the base",
                f"{where}, target {site.name[worst]}",
                f"{text}; without this target the distances to the planes change by "
                f"{effect * 100:.2g} cm",
                hint=f"Correct or remove {site.name[worst]}. {hint}",
            )
        ]  # fmt: skip
    effect = ratio * probes.std(pose)
    return [
        Finding(
            severity(effect, sigma_m), "targets of the base", where,
            f"{text}; the distances to the planes are uncertain by {effect * 100:.2g} cm",
            hint=hint,
        )
    ]  # fmt: skip
