"""From observations to targets: control points, planes, bases in the field and in the scanner.

The steps are those of the paper: a free network for the control points, a bundle adjustment of
the images for the targets of the planes, an intersection of directions for the base at every
position, each with the control points and their full covariance as observations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.quality import variance_factor_test
from velocal.errors import SurveyError
from velocal.survey.network.adjust import Network, adjust_network
from velocal.survey.network.model import DEFECT
from velocal.survey.network.observations import FieldBook
from velocal.survey.targets import COORDINATES, Targets

Array = NDArray[np.float64]

FREE = f"inner constraints over the control points, {DEFECT} freedoms"
FIXED = "control points with their covariance, same inner constraints"


@dataclass(frozen=True)
class Readings:
    """Means of repeated readings.

    Attributes
    ----------
    targets : Targets
        Means; their standard deviations are estimated from the repetitions, for each coordinate
        from all targets together, or are the stated ones if nothing was read twice.
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
    control, field : Network
        Of the control points, and of the targets of the planes; the same without images.
    bases : dict of str to Network
        By position.
    readings : dict of str to Readings
        By scanner.
    control_points, planes : Targets
    base_field : dict of str to Targets
        By position, with the covariance of all coordinates.
    """

    control: Network
    field: Network
    bases: dict[str, Network]
    readings: dict[str, Readings]
    control_points: Targets
    planes: Targets
    base_field: dict[str, Targets]


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
        If a network does not hold together, or a target of a plane was never observed.
    """
    names = book.control.name
    control = adjust_network(book.control, book.network, where=f"{where}: network")
    known = control.control(names, a_priori=a_priori)
    field = control
    if len(book.images.setup):
        field = adjust_network(known, rays=book.images, where=f"{where}: images")
    for target in book.planes:
        if target not in field.name:
            raise SurveyError(f"target {target!r} of {book.planes[target]!r} was never observed",
                              where=where)  # fmt: skip
    bases, base_field = {}, {}
    for position, sights in book.base_sights.items():
        bases[position] = adjust_network(known, sights, where=f"{where}: base at {position}")
        own = [name for name in bases[position].name if name not in names]
        base_field[position] = _targets(bases[position], own, [position] * len(own), a_priori)
    return Survey(
        control,
        field,
        bases,
        {name: _mean(part, a_priori) for name, part in book.base_readings.items()},
        _targets(control, names, ["control"] * len(names), a_priori),
        _targets(field, list(book.planes), list(book.planes.values()), a_priori),
        base_field,
    )


def _targets(
    network: Network, names: Sequence[str], group: Sequence[str], a_priori: bool
) -> Targets:
    points, rows = network.rows(names)
    covariance = (network.cofactor if a_priori else network.covariance)[np.ix_(rows, rows)]
    std = np.sqrt(np.diag(covariance)).reshape(-1, 3)
    return Targets(tuple(names), tuple(group), network.xyz[points], std, covariance)


def _mean(readings: Targets, a_priori: bool) -> Readings:
    """Means of repeated readings, and what their scatter tells."""
    names = tuple(dict.fromkeys(readings.name))
    number = np.array([names.index(name) for name in readings.name])
    count = np.bincount(number).astype(float)[:, None]
    mean, std = np.zeros((len(names), 3)), np.zeros((len(names), 3))
    np.add.at(mean, number, readings.xyz / count[number])
    np.add.at(std, number, readings.std**2 / count[number] ** 2)
    std = np.sqrt(std)
    scatter = ((readings.xyz - mean[number]) / readings.std) ** 2
    freedom = len(number) - len(names)
    factor = scatter.sum(axis=0) / freedom if freedom else np.ones(3)
    if not a_priori:
        std *= np.sqrt(factor)
    total = float(factor.mean()) if freedom else float("nan")
    targets = Targets(names, tuple(readings.group[: len(names)]), mean, std)
    return Readings(targets, 3 * freedom, total, variance_factor_test(total, 3 * freedom))


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
        "base_field": list(survey.base_field.values()),
        "base_scanner": [readings.targets for readings in survey.readings.values()],
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


def as_dict(survey: Survey) -> dict[str, Any]:
    """Quality of every adjustment, and what a picture of the network needs, for JSON."""
    networks = {"control points": (survey.control, survey.control_points, FREE)}
    if survey.field is not survey.control:
        networks["targets"] = (survey.field, survey.planes, FIXED)
    for position, network in survey.bases.items():
        networks[f"base at {position}"] = (network, survey.base_field[position], FIXED)
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
        {"adjustment": f"base of {name}", "datum": "frame of the scanner, repeated readings",
         **_quality(found.targets, found)}
        for name, found in survey.readings.items()
    ]  # fmt: skip
    return {
        "adjustments": rows,
        "points": [
            {
                "kind": kind,
                "group": group,
                "name": name,
                "xyz_m": xyz,
                "covariance_mm2": block * 1e6,
            }
            for kind, parts in (
                ("control point", [survey.control_points]),
                ("target", [survey.planes]),
                ("base target", survey.base_field.values()),
            )
            for part in parts
            for group, name, xyz, block in zip(
                part.group, part.name, part.xyz, part.blocks(), strict=True
            )
        ],
    }


def _quality(targets: Targets, found: Network | Readings) -> dict[str, Any]:
    return {
        "points": len(targets.name),
        "largest_std_mm": float(targets.std.max() * 1e3),
        "mean_std_mm": (targets.std.mean(axis=0) * 1e3),
        "redundancy": found.redundancy,
        "variance_factor": found.variance_factor,
        "global_test_probability": found.probability,
    }


def covariances(targets: Mapping[str, Targets]) -> dict[str, Any]:
    """Covariances of all coordinates of the targets of every group, for JSON."""
    return {
        name: {"targets": part.name, "covariance_m2": part.covariance()}
        for name, part in targets.items()
    }
