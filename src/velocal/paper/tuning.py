"""Fit constants of the world to the printed tables: the calibration of the simulator.

It is what agreement with the paper rests on, and is kept so that it can be done again. The cells
of the tables, as means over some seeds, are observations with their tolerances as weights.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from velocal.arrays import Array
from velocal.paper.printed import CONTRADICTIONS
from velocal.paper.replicate import agreement, spread
from velocal.simulation.world import load
from velocal.study.study import Study

#: Step of the numerical derivatives, as a share of the constant: well above what the rounding of
#: the tables and the choice of the best set do.
STEP = 0.2


def value_at(content: Mapping[str, Any], path: str) -> float:
    """Constant of a world file at a path such as ``scanners/HDL-64E/errors/dl_cm``."""
    constant: Any = reduce(getitem, path.split("/"), content)
    return float(constant)


def with_values(content: Mapping[str, Any], values: Mapping[str, float]) -> dict[str, Any]:
    """Return a world file's content with other constants at some paths."""
    changed: dict[str, Any] = deepcopy(dict(content))
    for path, value in values.items():
        *folders, name = path.split("/")
        reduce(getitem, folders, changed)[name] = value
    return changed


def misfit(content: Mapping[str, Any], study: Study, seeds: Sequence[int], rotations: int) -> Array:
    """Difference of every entry's mean over seeds from the printed one, by its tolerance.

    Entries that contradict the rest of the paper are left out.

    Parameters
    ----------
    content : mapping
        Content of the world file.
    study : Study
    seeds : sequence of int
    rotations : int
        Of a window.

    Returns
    -------
    ndarray, shape (cells,)
    """
    world = load(content)
    cells = spread({s: agreement(replace(world, seed=s), study, rotations) for s in seeds})
    cells = cells[~cells["item"].isin(list(CONTRADICTIONS))]
    return np.asarray(cells["difference"] / cells["tolerance"], dtype=np.float64)


def tune(
    content: Mapping[str, Any],
    study: Study,
    seeds: Sequence[int],
    rotations: int,
    *,
    iterations: int,
    evaluate: Callable[..., Array] = misfit,
) -> pd.DataFrame:
    """Fit the constants that the world file names under ``tuned``.

    Parameters
    ----------
    content : mapping
        Content of the world file.
    study : Study
    seeds : sequence of int
        The same in every evaluation, so that the entries change smoothly.
    rotations : int
        Of a window.
    iterations : int
        Evaluations at new constants at most; each costs one more per constant for derivatives.
    evaluate : callable
        As `misfit`.

    Returns
    -------
    DataFrame
        Columns constant, before, after, misfit_before, misfit_after (root mean square).
    """
    paths = list(content["tuned"])
    start = np.array([value_at(content, path) for path in paths])
    # A constant near zero moves by tenths of its unit.
    scale = np.maximum(np.abs(start), 0.1)

    def residuals(x: Array) -> Array:
        values = dict(zip(paths, (x * scale).tolist(), strict=True))
        return evaluate(with_values(content, values), study, seeds, rotations)

    first = start / scale
    found = least_squares(
        residuals,
        first,
        diff_step=[STEP] * len(first),
        max_nfev=iterations,
        method="trf",
        loss="soft_l1",
    )

    def size(x: Array) -> float:
        return float(np.sqrt(np.mean(residuals(x) ** 2)))

    return pd.DataFrame(
        {
            "constant": paths,
            "before": start,
            "after": (found.x * scale).round(4),
            "misfit_before": size(first),
            "misfit_after": size(found.x),
        }
    )
