"""A surveyed position: pose of the scanner, and the planes of the field in its frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.lasers import Observations
from velocal.adjustment.stochastic import SurveyUncertainty
from velocal.errors import SurveyError
from velocal.geometry.planes import Patch, Plane, PlaneFit, fit_plane, hull_patch
from velocal.geometry.rigid import RigidAdjustment, RigidTransformation, adjust_rigid
from velocal.survey.targets import Targets, common

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Station:
    """Result of the survey of one position.

    Attributes
    ----------
    pose : RigidAdjustment
        ``T_scanner_field`` with residuals and covariance.
    base_targets : tuple of str
        Targets that the pose was adjusted from.
    planes : list of PlaneFit
        In the scanner frame, in the order of `patches`.
    patches : list of Patch
        The same, bounded by the hulls of their targets.
    """

    pose: RigidAdjustment
    base_targets: tuple[str, ...]
    planes: list[PlaneFit]
    patches: list[Patch]


def plane_covariances(targets: Targets) -> dict[str, Array]:
    """Covariance (4, 4) of normal and offset of every plane, in the frame of its targets.

    With what the targets have in common: errors of the control points and cameras shift and turn
    a plane, and do not average out over its targets.
    """
    found = {}
    for name in dict.fromkeys(targets.group):
        part = targets.of(name, where=name)
        # Whoever uses a plane that its targets do not determine is told so.
        with suppress(SurveyError):
            fit = fit_plane(part.xyz, _isotropic(part), part.covariance())
            found[name] = fit.plane.covariance
    return found


def _isotropic(targets: Targets) -> Array:
    """Equal in all directions: the root of the mean variance of the three coordinates."""
    return np.asarray(np.sqrt(np.mean(targets.std**2, axis=1)))


def adjust_station(
    planes: Targets,
    base_scanner: Targets,
    base_field: Targets,
    names: Sequence[str],
    *,
    covariances: Mapping[str, Array] | None = None,
    where: str,
) -> Station:
    """Adjust pose and planes of a position.

    Parameters
    ----------
    planes : Targets
        Targets of walls and floor in the field frame, grouped by plane.
    base_scanner, base_field : Targets
        Targets of the scanner's base in the scanner frame and in the field frame.
    names : sequence of str
        Planes to use.
    covariances : mapping of str to ndarray, shape (4, 4), optional
        Of normal and offset of planes in the field frame (`plane_covariances`); from the
        standard deviations of their targets alone where there is none.
    where : str
        Survey file, for errors.

    Raises
    ------
    SurveyError
        If targets are too few or lie on a line.
    """
    field, scanner = common(base_field, base_scanner, where=where)
    pose = adjust_rigid(field.xyz, scanner.xyz, field.covariance(), scanner.covariance())
    fits, patches = [], []
    for name in names:
        targets = planes.of(name, where=where)
        points = pose.transformation.apply(targets.xyz)
        fit = fit_plane(points, _isotropic(targets))
        if covariances and name in covariances:
            moved = pose.transformation.plane_matrix()
            known = moved @ covariances[name] @ moved.T
            fit = replace(fit, plane=replace(fit.plane, covariance=known))
        fits.append(fit)
        patches.append(hull_patch(name, fit, points))
    return Station(pose, field.name, fits, patches)


def as_dict(station: Station) -> dict[str, Any]:
    """Plain mapping of a station, for JSON; `patches_of` reads it back."""
    pose = station.pose
    return {
        "pose": {
            "name": "T_scanner_field",
            "rotation": pose.transformation.rotation,
            "translation_m": pose.transformation.translation,
            "covariance_rad_m": pose.transformation.covariance,
            "targets": list(station.base_targets),
            "residuals_m": pose.residuals,
            "variance_factor": pose.variance_factor,
            "redundancy": pose.redundancy,
        },
        "planes": [
            {
                "name": patch.name,
                "normal": patch.plane.normal,
                "offset_m": patch.plane.offset,
                "covariance": patch.plane.covariance,
                "abc_per_m": patch.plane.general_form() if patch.plane.offset else None,
                "corners_m": patch.corners,
                "targets": len(fit.residuals),
                "flatness_mean_m": fit.flatness_mean_m,
                "flatness_max_m": fit.flatness_max_m,
                "variance_factor": fit.variance_factor,
            }
            for patch, fit in zip(station.patches, station.planes, strict=True)
        ],
    }


def patches_of(content: Mapping[str, Any]) -> list[Patch]:
    """Patches out of what `as_dict` gave."""
    return [
        Patch(
            plane["name"],
            Plane(np.array(plane["normal"]), plane["offset_m"], np.array(plane["covariance"])),
            np.array(plane["corners_m"]),
        )
        for plane in content["planes"]
    ]


def pose_of(content: Mapping[str, Any]) -> RigidTransformation:
    """``T_scanner_field`` out of what `as_dict` gave."""
    pose = content["pose"]
    return RigidTransformation(
        np.array(pose["rotation"]),
        np.array(pose["translation_m"]),
        np.array(pose["covariance_rad_m"]),
    )


def uncertainty_of(content: Mapping[str, Any]) -> SurveyUncertainty:
    """How sure pose and planes are, out of what `as_dict` gave.

    Targets deviate from a plane by their own errors and by those of the surface: what is more
    than the first, as the variance factor tells, is flatness (root mean square, from the mean
    deviation of a normal distribution, which the fit of three numbers to n targets has lessened).
    Three targets show none. The plane follows its level and slope, so that its own covariance is
    left as it is.
    """
    pose, planes = content["pose"], content["planes"]
    factor = np.array([plane["variance_factor"] for plane in planes], dtype=float)
    excess = np.where(np.isfinite(factor), np.maximum(factor, 1.0), 1.0)
    targets = np.array([plane["targets"] for plane in planes], dtype=float)
    deviation = np.array([plane["flatness_mean_m"] for plane in planes])
    deviation = deviation * np.sqrt(targets / np.maximum(targets - 3.0, 1.0))
    return SurveyUncertainty(
        translation=np.array(pose["translation_m"]),
        pose=np.array(pose["covariance_rad_m"]),
        planes=np.array([plane["covariance"] for plane in planes]),
        flatness_m=deviation * np.sqrt(np.pi / 2.0 * (1.0 - 1.0 / excess)),
    )


def observations(columns: Mapping[str, NDArray[Any]], patches: Sequence[Patch]) -> Observations:
    """Observations of assigned returns: columns of `schemas.ASSIGNED` with their planes."""
    normals = np.stack([patch.plane.normal for patch in patches])
    offsets = np.array([patch.plane.offset for patch in patches])
    plane = columns["plane"].astype(np.int64)
    return Observations(
        columns["distance_m"],
        columns["phi_rad"],
        columns["laser_id"],
        normals[plane],
        offsets[plane],
        plane,
    )
