"""From observations to targets: control points, planes, and scanner bases in both frames.

The steps are those of the paper: a free network for the control points, a bundle adjustment of
the images for the targets of the planes, an intersection of directions for the base at every
position, each with the control points and their full covariance as observations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from velocal.adjustment.quality import variance_factor_test
from velocal.errors import SurveyError
from velocal.survey.network.adjust import Network, adjust_network
from velocal.survey.network.field_book import FieldBook
from velocal.survey.network.model import ControlPoints
from velocal.survey.network.normal_equations import DEFECT
from velocal.survey.station import Station
from velocal.survey.targets import COORDINATES, SurveyCovariances, Targets

FREE = f"inner constraints over the control points, {DEFECT} freedoms"
FIXED = "control points with their covariance, same inner constraints"


@dataclass(frozen=True)
class MeanCoordinates:
    """Means of repeated coordinates.

    Attributes
    ----------
    targets : Targets
        Means. Their standard deviations are estimated from the repetitions, for each coordinate
        from all targets together; without repetitions they are the stated ones.
    redundancy : int
    variance_factor, probability : float
        Of the stated standard deviations; NaN without redundancy.
    """

    targets: Targets
    redundancy: int
    variance_factor: float
    probability: float


@dataclass(frozen=True)
class Survey:
    """An adjusted survey.

    Attributes
    ----------
    control_network, target_network : Network
        Of the control points, and of the targets of the planes; the same without images.
    base_networks : dict of str to Network
        By position.
    base_scanner : dict of str to MeanCoordinates
        By scanner: targets of its base in the scanner frame.
    control_points, planes : Targets
        In the site frame.
    base_site : dict of str to Targets
        By position: targets of the base in the site frame, with the covariance of all coordinates.
    """

    control_network: Network
    target_network: Network
    base_networks: dict[str, Network]
    base_scanner: dict[str, MeanCoordinates]
    control_points: Targets
    planes: Targets
    base_site: dict[str, Targets]

    def station(self, scanner: str, position: str, planes: Sequence[str], *, where: str) -> Station:
        """Adjust pose and planes of a position.

        Parameters
        ----------
        scanner, position : str
        planes : sequence of str
            Planes to use.
        where : str
            File or study, for errors.

        Raises
        ------
        SurveyError
            If targets are too few or lie on a line.
        """
        return Station.adjust(
            self.planes,
            self.base_scanner[scanner].targets,
            self.base_site[position],
            planes,
            covariances=self.planes.plane_covariances(),
            where=where,
        )

    def covariances(self) -> SurveyCovariances:
        """Covariances of all coordinates of the bases, and of the planes."""
        bases = {name: (part.name, part.covariance()) for name, part in self.base_site.items()}
        return SurveyCovariances(bases, self.planes.plane_covariances())

    def to_json(self) -> dict[str, Any]:
        """Quality of every adjustment, and all points with their covariances.

        This is the content of the file ``survey/network.json``.
        """
        networks = {"control points": (self.control_network, self.control_points, FREE)}
        if self.target_network is not self.control_network:
            networks["targets"] = (self.target_network, self.planes, FIXED)
        for position, network in self.base_networks.items():
            networks[f"base at {position}"] = (network, self.base_site[position], FIXED)
        rows = [
            {
                "adjustment": name,
                "datum": datum,
                **_quality(targets, network),
                "largest_normalised_residual": network.largest_residual,
                "largest_normalised_residual_of": network.largest_residual_of,
                "iterations": network.iterations,
                "setups_m": network.setups,
            }
            for name, (network, targets, datum) in networks.items()
        ]
        rows += [
            {
                "adjustment": f"base of {name}",
                "datum": "frame of the scanner, repeated readings",
                **_quality(found.targets, found),
            }
            for name, found in self.base_scanner.items()
        ]
        kinds = {
            "control point": [self.control_points],
            "target": [self.planes],
            "base target": list(self.base_site.values()),
        }
        points = [
            {
                "kind": kind,
                "group": group,
                "name": name,
                "xyz_m": xyz,
                "covariance_mm2": block * 1e6,
            }
            for kind, parts in kinds.items()
            for part in parts
            for group, name, xyz, block in zip(
                part.group, part.name, part.xyz, part.blocks(), strict=True
            )
        ]
        return {"adjustments": rows, "points": points}


def adjust_field_book(book: FieldBook, *, where: str = "survey", a_priori: bool = False) -> Survey:
    """Adjust everything that was observed.

    Parameters
    ----------
    book : FieldBook
    where : str
        Folder or file, for errors.
    a_priori : bool
        Give standard deviations as they follow from the stated ones of the observations, not
        scaled by the estimated variance factors.

    Raises
    ------
    SurveyError
        If a network is not connected, or a target of a plane was never observed.
    """
    names = book.control.name
    control = adjust_network(book.control, book.polar, where=f"{where}: network")
    known = ControlPoints(names, *control.part(names, a_priori=a_priori))
    surveyed = control
    if len(book.images.setup):
        surveyed = adjust_network(known, images=book.images, where=f"{where}: images")
    for target, plane in book.planes.items():
        if target not in surveyed.name:
            raise SurveyError(f"target {target!r} of {plane!r} was never observed", where=where)
    bases, base_site = {}, {}
    for position, polar in book.base_polar.items():
        bases[position] = adjust_network(known, polar, where=f"{where}: base at {position}")
        own = [name for name in bases[position].name if name not in names]
        base_site[position] = _targets(bases[position], own, [position] * len(own), a_priori)
    return Survey(
        control_network=control,
        target_network=surveyed,
        base_networks=bases,
        base_scanner={n: _means(part, a_priori) for n, part in book.base_coordinates.items()},
        control_points=_targets(control, names, ["control"] * len(names), a_priori),
        planes=_targets(surveyed, list(book.planes), list(book.planes.values()), a_priori),
        base_site=base_site,
    )


def _targets(
    network: Network, names: Sequence[str], group: Sequence[str], a_priori: bool
) -> Targets:
    xyz, covariance = network.part(names, a_priori=a_priori)
    std = np.sqrt(np.diag(covariance)).reshape(-1, 3)
    return Targets(tuple(names), tuple(group), xyz, std, covariance)


def _means(repeated: Targets, a_priori: bool) -> MeanCoordinates:
    """Means of repeated coordinates, with standard deviations from their scatter."""
    names = tuple(dict.fromkeys(repeated.name))
    number = np.array([names.index(name) for name in repeated.name])
    count = np.bincount(number).astype(float)[:, None]
    mean, std = np.zeros((len(names), 3)), np.zeros((len(names), 3))
    np.add.at(mean, number, repeated.xyz / count[number])
    np.add.at(std, number, repeated.std**2 / count[number] ** 2)
    std = np.sqrt(std)
    scatter = ((repeated.xyz - mean[number]) / repeated.std) ** 2
    dof = len(number) - len(names)
    factor = scatter.sum(axis=0) / dof if dof else np.ones(3)
    if not a_priori:
        std *= np.sqrt(factor)
    total = float(factor.mean()) if dof else float("nan")
    targets = Targets(names, tuple(repeated.group[: len(names)]), mean, std)
    return MeanCoordinates(targets, 3 * dof, total, variance_factor_test(total, 3 * dof))


def accuracy(survey: Survey) -> dict[str, list[Any]]:
    """Largest standard deviation of a coordinate of every kind of point, as the paper states it.

    Returns
    -------
    dict
        Columns ``item``, ``value_mm``, ``points``, ``worst`` (the point), ``coordinate``.
    """
    groups = {
        "control_points": [survey.control_points],
        "targets": [survey.planes],
        "base_field": list(survey.base_site.values()),
        "base_scanner": [found.targets for found in survey.base_scanner.values()],
    }
    columns: dict[str, list[Any]] = {
        name: [] for name in ("item", "value_mm", "points", "worst", "coordinate")
    }
    for item, parts in groups.items():
        if not parts:
            continue
        std = np.concatenate([part.std for part in parts])
        row, axis = np.unravel_index(int(np.argmax(std)), std.shape)
        label = [
            f"{group} {name}" for p in parts for group, name in zip(p.group, p.name, strict=True)
        ]
        columns["item"].append(item)
        columns["value_mm"].append(float(std[row, axis] * 1e3))
        columns["points"].append(len(std))
        columns["worst"].append(label[row])
        columns["coordinate"].append(COORDINATES[axis][0])
    return columns


def _quality(targets: Targets, found: Network | MeanCoordinates) -> dict[str, Any]:
    return {
        "points": len(targets.name),
        "largest_std_mm": float(targets.std.max() * 1e3),
        "mean_std_mm": (targets.std.mean(axis=0) * 1e3),
        "redundancy": found.redundancy,
        "variance_factor": found.variance_factor,
        "global_test_probability": found.probability,
    }
