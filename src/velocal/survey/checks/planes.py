"""Checks of the targets of walls and floor: do they span an area, is one of them wrong."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri, stdtrit

from velocal.arrays import Array
from velocal.errors import SurveyError
from velocal.geometry.planes import fit_plane, hull_patch
from velocal.survey.checks.findings import SIGNIFICANCE, Finding, severity
from velocal.survey.targets import Targets

#: Standard deviation of a built surface about its plane, metres: with few targets their deviations
#: cannot show it. DIN 18202 allows 5 mm over 1 m and 10 mm over 4 m for finished walls.
SURFACE_M = 0.005
#: Targets of a plane from which their own deviations show the size of those deviations.
ENOUGH = 8


def check_planes(
    planes: Targets, names: list[str], *, edge_m: float, sigma_m: float, where: str
) -> list[Finding]:
    """Check the targets of the planes that are used.

    Parameters
    ----------
    planes : Targets
        Grouped by plane.
    names : list of str
        Planes that are used.
    edge_m : float
        A beam must meet a plane this far inside the hull of its targets.
    sigma_m : float
        Standard deviation of a distance in the datasheet, metres.
    where : str
        Survey file.

    Returns
    -------
    list of Finding
    """
    found = []
    for name in names:
        targets = planes.of(name, where=where)
        found += _width(targets, edge_m, f"{where}, plane {name}")
        found += _wrong_target(targets, sigma_m, f"{where}, plane {name}")
    return found


def _width(targets: Targets, edge_m: float, where: str) -> list[Finding]:
    """Targets nearly on a line: no beam meets the plane far enough inside."""
    centred = targets.xyz - targets.xyz.mean(axis=0)
    patch = hull_patch(targets.group[0], fit_plane(centred, targets.isotropic_std()), centred)
    corners, normal = patch.corners, patch.plane.normal
    widths = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        across = np.cross(normal, (end - start) / np.linalg.norm(end - start))
        widths.append(np.ptp((corners - start) @ across))
    width = float(min(widths))
    if width > 2.0 * edge_m:
        return []
    return [
        Finding(
            "error", "extent of a plane", where,
            f"the targets lie nearly on one line: the strip that they span is {width * 100:.2g} cm "
            "wide, and no beam meets it far enough from its edges",
            allowed=f"more than {2 * edge_m * 100:g} cm (twice assignment.limits.edge_cm)",
            hint="Spread the targets over the whole plane, for a wall over its height too.",
        )
    ]  # fmt: skip


def _wrong_target(targets: Targets, sigma_m: float, where: str) -> list[Finding]:
    """The target that is farthest from the plane of the others, if that cannot be chance.

    Every target is compared with the plane of all others: with their scatter (Student's t of the
    externally studentised residual) where there are `ENOUGH`, and with the stated standard
    deviation and the flatness of a built surface in any case.
    """
    n = len(targets.name)
    if n < 4:
        return []
    points, std = targets.xyz - targets.xyz.mean(axis=0), targets.isotropic_std()
    worst, ratio = None, 1.0
    for i in range(n):
        others = np.arange(n) != i
        try:
            fit = fit_plane(points[others], std[others])
        except SurveyError:  # the others lie on a line
            continue
        residual = float(fit.plane.distance(points[i]))
        at = np.append(points[i], 1.0)
        factor = fit.variance_factor if n > 4 else 1.0
        spread = at @ fit.plane.covariance @ at
        stated = np.sqrt((std[i] ** 2 + spread) * (1.0 + SURFACE_M**2 / std[i] ** 2))
        limit = stated * -ndtri(SIGNIFICANCE / n / 2.0)
        if n >= ENOUGH:
            own = np.sqrt((std[i] ** 2 + spread) * factor)
            limit = max(limit, own * -stdtrit(n - 4, SIGNIFICANCE / n / 2.0))
        if abs(residual) > ratio * limit:
            worst, ratio = i, abs(residual) / limit
            effect, deviation = _effect(points, std, others), residual
    if worst is None:
        return []
    which = targets.name[worst]
    # Three points have no plane of their own that the fourth could contradict alone.
    doubt = "" if n > 4 else ", or another of the four"
    return [
        Finding(
            severity(effect, sigma_m), "targets of a plane", f"{where}, target {which}",
            f"this target{doubt} lies {abs(deviation) * 100:.3g} cm off the plane of the others, "
            f"and changes the plane by {effect * 100:.2g} cm",
            allowed=f"{abs(deviation) / ratio * 100:.2g} cm",
            hint="Does it belong to another plane, or has it a wrong coordinate? Correct or remove "
            "it.",
        )
    ]  # fmt: skip


def _effect(points: Array, std: Array, others: Array) -> float:
    """Root mean square distance of the targets' places from the plane of the others and of all."""
    kept = points[others]
    without, with_it = fit_plane(kept, std[others]).plane, fit_plane(points, std).plane
    same = np.sign(without.normal @ with_it.normal)
    difference = without.distance(kept) - same * with_it.distance(kept)
    return float(np.sqrt(np.mean(difference**2)))
