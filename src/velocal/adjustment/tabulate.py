"""Results of all lasers as columns of a table, and corrections out of such columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.result import Adjustment
from velocal.parameters import PARAMETERS, UNITS

Array = NDArray[np.float64]


def corrections(results: Sequence[Adjustment]) -> dict[str, list[Any]]:
    """Columns of the adjustments of lasers 0, 1, ...: corrections, standard deviations, quality."""
    columns: dict[str, list[Any]] = {"laser_id": list(range(len(results)))}
    for number, name in enumerate(results[0].names):
        unit = UNITS[name]
        columns[f"{name}_correction_{unit}"] = [r.corrections[number] for r in results]
        columns[f"{name}_std_{unit}"] = [r.std[number] for r in results]
    columns |= {
        "count": [len(r.residuals) for r in results],
        "rank": [r.rank for r in results],
        "redundancy": [r.redundancy for r in results],
        "residual_std_m": [float(np.sqrt(r.variance)) for r in results],
        "held": [" ".join(r.held) for r in results],
        "iterations": [r.iterations for r in results],
        "converged": [int(r.converged) for r in results],
        "message": [r.message for r in results],
    }
    return columns


def read_corrections(
    columns: Mapping[str, NDArray[Any]],
) -> tuple[dict[str, Array], dict[str, Array], NDArray[np.bool_]]:
    """Corrections and standard deviations by parameter, and which lasers were observed.

    The inverse of `corrections`, as far as averaging needs it.
    """
    adjusted = [name for name in PARAMETERS if f"{name}_correction_{UNITS[name]}" in columns]
    value = {n: np.asarray(columns[f"{n}_correction_{UNITS[n]}"], dtype=float) for n in adjusted}
    std = {n: np.asarray(columns[f"{n}_std_{UNITS[n]}"], dtype=float) for n in adjusted}
    return value, std, np.asarray(columns["count"]) > 0
