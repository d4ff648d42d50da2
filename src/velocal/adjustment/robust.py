"""Robust solvers: rows that disagree with the others get a smaller weight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from velocal.adjustment.linear import Step, System
from velocal.adjustment.solvers import Solver
from velocal.arrays import Array

#: The median absolute deviation of a normal distribution is its standard deviation over this.
MAD_PER_STD = 1.4826


def huber(size: Array, limit: float = 1.345) -> Array:
    """Huber's weights of standardised residuals: 1 inside the limit, limit / size beyond."""
    return np.minimum(1.0, limit / np.maximum(size, 1e-300))


def igg(size: Array, inner: float = 1.5, outer: float = 3.0) -> Array:
    """Weights of the IGG III scheme: 1 inside, 0 beyond the outer limit, smooth between them."""
    safe = np.maximum(size, 1e-300)
    fall = inner / safe * ((outer - safe) / (outer - inner)) ** 2
    return np.where(size <= inner, 1.0, np.where(size >= outer, 0.0, fall))


def snooping(size: Array, limit: float = 3.29) -> Array:
    """Baarda's data snooping: rows whose test exceeds the limit (0.1 %) are left out."""
    return np.where(size > limit, 0.0, 1.0)


_WEIGHTS: dict[str, Callable[[Array], Array]] = {"huber": huber, "igg": igg, "snooping": snooping}


@dataclass(frozen=True, kw_only=True)
class Robust:
    """Another solver on rows that are weighted anew at every linearisation.

    The weights follow from the residuals at the current parameters, which are divided by their
    median absolute deviation; at the first linearisation their median is subtracted before. Data
    snooping also divides by the root of the redundancy number of each row. It may not converge
    where a row is just at the limit.

    Attributes
    ----------
    base : Solver
        Solves the reweighted system.
    kind : {"huber", "igg", "snooping"}
        Weight function.
    """

    base: Solver
    kind: Literal["huber", "igg", "snooping"] = "huber"

    def step(self, system: System, basis: Array | None = None) -> Step:
        """Solve one linearised system; see `Solver.step`."""
        residual = system.w / system.sigma_misclosure
        if not system.shift.any():
            # Nothing is adjusted yet, and the offset of the laser would hide the outliers.
            residual = residual - np.median(residual)
        spread = MAD_PER_STD * np.median(np.abs(residual))
        if spread <= 1e-12 * np.max(np.abs(system.w / system.sigma_misclosure), initial=1e-300):
            return self.base.step(system, basis)
        size = np.abs(residual) / spread
        if self.kind == "snooping":
            leverage = self.base.step(system, basis).leverage
            size = size / np.sqrt(np.maximum(1.0 - leverage, 1e-6))
        weight = _WEIGHTS[self.kind](size)
        root = np.sqrt(weight)
        weighted = replace(system, matrix=system.matrix * root[:, None], w=system.w * root)
        step = self.base.step(weighted, basis)
        return replace(step, influence=step.influence * root, row_weight=weight)

    def objective(self, system: System) -> float:
        """Zero: the weights change with every step, so that no sum is minimised throughout."""
        return 0.0

    def reduced(self, system: System, *, keep: bool = False) -> System:
        """Return the system itself: its weights are not known before it is solved."""
        return system
