"""Solver and stochastic model out of the key `adjustment` of a configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from velocal.adjustment.robust import Robust
from velocal.adjustment.solvers import (
    GaussHelmert,
    OrdinaryLeastSquares,
    PaperModel,
    Solver,
    WithPrior,
)
from velocal.adjustment.stochastic import Stochastic, SurveyUncertainty
from velocal.errors import ConfigError

#: Methods by name; each takes the key `truncate_at`, of which some make no use.
METHODS: dict[str, Callable[[float | None], Solver]] = {
    "prior": lambda _: WithPrior(),
    "paper": lambda truncate_at: PaperModel(truncate_at=truncate_at),
    "gauss_helmert": lambda truncate_at: GaussHelmert(truncate_at=truncate_at),
    "least_squares": lambda _: OrdinaryLeastSquares(),
}
_FACTOR = {"cm": 1e-2, "deg": np.pi / 180.0}


def solver(config: Mapping[str, Any]) -> Solver:
    """Solver that `method` names, robust if `robust` says so.

    Raises
    ------
    ConfigError
        If there is no such method.
    """
    try:
        base = METHODS[config["method"]](config.get("truncate_at"))
    except KeyError:
        raise ConfigError(
            f"adjustment.method: {config['method']!r}", allowed=", ".join(METHODS)
        ) from None
    return Robust(base=base, kind=config["robust"]) if config.get("robust") else base


def stochastic(config: Mapping[str, Any], survey: Sequence[SurveyUncertainty] = ()) -> Stochastic:
    """Stochastic model in metres and radians."""
    prior = {}
    for key, value in config["prior"].items():
        name, unit = key.removesuffix("_per_m").rsplit("_", 1)
        prior[name] = value * _FACTOR[unit]
    block = config.get("block_deg")
    return Stochastic(
        noise_std_m=config["noise_cm"] * 1e-2,
        prior_std=prior,
        angle_std_rad=np.deg2rad(config.get("angle_deg", 0.0)),
        block_rad=None if block is None else np.deg2rad(block),
        range_scale=config.get("range_scale_cm_per_m", 0.0) * 1e-2,
        repeatability_m=config.get("repeatability_cm", 0.0) * 1e-2,
        survey=tuple(survey),
    )
