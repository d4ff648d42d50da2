"""Solver and stochastic model out of the key `adjustment` of a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from velocal.adjustment.lasers import Stochastic
from velocal.adjustment.solvers import PaperModel, Solver
from velocal.errors import ConfigError


def solver(config: Mapping[str, Any]) -> Solver:
    """Solver that `method` names.

    Raises
    ------
    ConfigError
        If there is no such method.
    """
    if config["method"] == "paper":
        return PaperModel(config.get("truncate_at"))
    raise ConfigError(f"adjustment.method: {config['method']!r}", allowed="paper")


def stochastic(config: Mapping[str, Any]) -> Stochastic:
    """A-priori standard deviations in metres and radians."""
    prior = {}
    for key, value in config["prior"].items():
        name, unit = key.rsplit("_", 1)
        prior[name] = value * (1e-2 if unit == "cm" else np.pi / 180.0)
    return Stochastic(config["noise_cm"] * 1e-2, prior)
