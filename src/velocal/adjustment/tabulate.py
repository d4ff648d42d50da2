"""Results of all lasers as columns of a table, and corrections out of such columns."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import ADJUSTABLE, ADJUSTABLE_UNITS
from velocal.adjustment.result import Adjustment

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Corrections:
    """Corrections of all lasers by one adjustment.

    Attributes
    ----------
    value, std, noise_std : mapping of str to ndarray, shape (lasers,)
        Corrections, their standard deviations, and the part of these from noise; by parameter.
    observed : ndarray of bool, shape (lasers,)
        Whether the adjustment saw a laser at all.
    covariance, noise_covariance : mapping of (str, str) to ndarray, shape (lasers,)
        Of two parameters, and the part from noise; empty where they were not asked for.
    """

    value: Mapping[str, Array]
    std: Mapping[str, Array]
    noise_std: Mapping[str, Array]
    observed: NDArray[np.bool_]
    covariance: Mapping[tuple[str, str], Array] = field(default_factory=dict)
    noise_covariance: Mapping[tuple[str, str], Array] = field(default_factory=dict)


def corrections(results: Sequence[Adjustment]) -> dict[str, list[Any]]:
    """Columns of the adjustments of lasers 0, 1, ...: corrections, standard deviations, quality."""
    columns: dict[str, list[Any]] = {"laser_id": list(range(len(results)))}
    for number, name in enumerate(results[0].names):
        unit = ADJUSTABLE_UNITS[name]
        columns[f"{name}_correction_{unit}"] = [r.corrections[number] for r in results]
        columns[f"{name}_std_{unit}"] = [r.std[number] for r in results]
        columns[f"{name}_noise_std_{unit}"] = [r.noise_std[number] for r in results]
    columns |= {
        "count": [len(r.residuals) for r in results],
        "rank": [r.rank for r in results],
        "redundancy": [r.redundancy for r in results],
        "residual_std_m": [float(np.sqrt(r.variance)) for r in results],
        "variance_factor": [r.variance_factor for r in results],
        "variance_factor_p": [r.variance_factor_p for r in results],
        "condition": [r.condition for r in results],
        "least_redundancy_number": [min(r.redundancy_numbers, default=np.nan) for r in results],
        "held": [" ".join(r.held) for r in results],
        "iterations": [r.iterations for r in results],
        "converged": [int(r.converged) for r in results],
        "message": [r.message for r in results],
    }
    return columns


def covariances(results: Sequence[Adjustment]) -> dict[str, list[Any]]:
    """Columns of all covariances and correlations, a row per laser and pair of parameters.

    The column ``covariance`` is the sum of the columns of the sources; units are the product of
    those of the two parameters.
    """
    sources = list(dict.fromkeys(source for r in results for source in r.parts))
    names = ("laser_id", "first", "second", "covariance", "correlation", *sources)
    columns: dict[str, list[Any]] = {name: [] for name in names}
    for laser, r in enumerate(results):
        for i, j in itertools.combinations_with_replacement(range(len(r.names)), 2):
            columns["laser_id"].append(laser)
            columns["first"].append(r.names[i])
            columns["second"].append(r.names[j])
            columns["covariance"].append(r.covariance[i, j])
            columns["correlation"].append(r.correlation[i, j])
            for source in sources:
                part = r.parts.get(source)
                columns[source].append(0.0 if part is None else part[i, j])
    return columns


def read_corrections(
    columns: Mapping[str, NDArray[Any]], covariance: Mapping[str, NDArray[Any]] | None = None
) -> Corrections:
    """Corrections out of the columns that `corrections` and `covariances` made."""
    found: dict[str, dict[str, Array]] = {"correction": {}, "std": {}, "noise_std": {}}
    for name in ADJUSTABLE:
        for kind, values in found.items():
            column = f"{name}_{kind}_{ADJUSTABLE_UNITS[name]}"
            if column in columns:
                values[name] = np.asarray(columns[column], dtype=float)
    of_pairs = [{}, {}] if covariance is None else _of_pairs(covariance)
    return Corrections(
        found["correction"],
        found["std"],
        found["noise_std"],
        np.asarray(columns["count"]) > 0,
        *of_pairs,
    )


def _of_pairs(columns: Mapping[str, NDArray[Any]]) -> list[dict[tuple[str, str], Array]]:
    """Covariances, and their parts from noise, of two different parameters."""
    first, second = columns["first"], columns["second"]
    rows = {
        pair: np.isin(first, pair) & np.isin(second, pair) & (first != second)
        for pair in itertools.combinations(ADJUSTABLE, 2)
    }
    return [
        {pair: np.asarray(columns[name][of], dtype=float) for pair, of in rows.items() if of.any()}
        for name in ("covariance", "noise")
    ]
