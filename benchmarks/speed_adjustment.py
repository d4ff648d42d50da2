"""Speed of the adjustments: the paper's, laser by laser, against SciPy; and that of a unit."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from speed_measure import Measures, table

from velocal.adjustment.lasers import adjust_all, find_corrections
from velocal.adjustment.observations import Observations
from velocal.adjustment.solvers import PaperModel
from velocal.adjustment.unit.adjust import adjust_unit
from velocal.adjustment.unit.settings import UnitSettings
from velocal.arrays import joined_rows
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters
from velocal.simulation.independent.plan import Plan
from velocal.simulation.independent.trial import Trial, draw
from velocal.study.adjustment import Adjustment

Array = NDArray[np.float64]
NAMES = ("dl", "alpha", "v")
#: SciPy's default, 1e-8, ends farther from the solution than velocal does.
TOLERANCE = 1e-12


class OneLaser:
    """Misclosures of one laser and their derivatives, as a user of SciPy would write them."""

    def __init__(self, data: Observations, factory: LaserParameters, laser: int) -> None:
        own = data.laser_id == laser
        self.length, self.phi = data.distance_m[own], data.phi[own]
        self.normal, self.offset = data.normal[own], data.offset[own]
        self.start = np.array([getattr(factory, name)[laser] for name in NAMES])
        self.voff, self.hoff = factory.voff[laser], factory.hoff[laser]

    def _facing(self, x: Array) -> tuple[Array, ...]:
        """Normals along and across the beams, and the ranges to the planes."""
        _, alpha, v = self.start + x
        sine, cosine = np.sin(self.phi - alpha), np.cos(self.phi - alpha)
        n_x, n_y, n_z = self.normal.T
        along, across = n_x * sine + n_y * cosine, n_y * sine - n_x * cosine
        towards = np.cos(v) * along + np.sin(v) * n_z
        to_plane = -(self.hoff * across + self.voff * n_z + self.offset) / towards
        return along, across, towards, to_plane

    def misclosure(self, x: Array) -> Array:
        """Distances along the beams from planes to points at corrections x."""
        return self.length + (self.start + x)[0] - self._facing(x)[-1]

    def jacobian(self, x: Array) -> Array:
        """Derivatives of the misclosures by dl, alpha and v, shape (n, 3)."""
        v = (self.start + x)[2]
        along, across, towards, to_plane = self._facing(x)
        by_alpha = (to_plane * across * np.cos(v) - self.hoff * along) / towards
        by_v = to_plane * (np.cos(v) * self.normal[:, 2] - np.sin(v) * along) / towards
        return np.column_stack([np.ones_like(by_v), by_alpha, by_v])


def with_scipy(data: Observations, factory: LaserParameters, *, derivatives: bool) -> Array:
    """Corrections of all lasers by `scipy.optimize.least_squares`, shape (lasers, 3)."""
    found = np.zeros((len(factory), len(NAMES)))
    for laser in np.unique(data.laser_id):
        one = OneLaser(data, factory, laser)
        jac = one.jacobian if derivatives else "2-point"
        found[laser] = least_squares(
            one.misclosure, np.zeros(3), jac=jac, method="lm",
            ftol=TOLERANCE, xtol=TOLERANCE, gtol=TOLERANCE,
        ).x  # fmt: skip
    return found


def paper(trial: Trial) -> tuple[Observations, dict[str, Callable[[], Array]]]:
    """Medians of one window, and the paper's adjustment on them by several programs.

    The solver is the paper's with its pseudo-inverse. Walls and floor determine all parameters, so
    that it is ordinary least squares.
    """
    data, factory = trial.stations[0].windows[0], trial.factory
    stochastic = Adjustment.recommended(SCANNERS[trial.scanner]).stochastic()
    given = data, factory, NAMES, PaperModel(truncate_at=None), stochastic
    return data, {
        "velocal": lambda: find_corrections(*given)[0],
        "velocal, with its quality": lambda: np.array(
            [one.corrections for one in adjust_all(*given)]
        ),
        "SciPy, with derivatives": partial(with_scipy, data, factory, derivatives=True),
        "SciPy, finite differences": partial(with_scipy, data, factory, derivatives=False),
    }


def adjustment(rounds: int) -> str:
    """Table of the paper's adjustment of a window, and of the adjustment of a unit."""
    measures, rows = Measures(), []
    data, works = paper(draw(Plan(scanner="HDL-64E", stations=1), seed=1))
    ours = works["velocal"]()
    for name, work in works.items():
        measures.add(f"all lasers of a window, {name}", work)
    units = {}
    for stations in (1, 2):
        trial = draw(Plan(scanner="HDL-64E", stations=stations, every=2), seed=1)
        settings = UnitSettings.recommended(SCANNERS["HDL-64E"], factory=trial.factory)
        measured = [each.survey.of_unit(joined_rows(each.windows)) for each in trial.stations]
        name = f"a unit, {stations} station{'s' * (stations > 1)}"
        units[name] = str(sum(len(joined_rows(each.windows).phi) for each in trial.stations))
        measures.add(name, partial(adjust_unit, measured, trial.factory, settings))
    measures.run(rounds)
    for name, work in works.items():
        full = f"all lasers of a window, {name}"
        dl, *angles = np.abs(work() - ours).max(axis=0)
        apart = [f"{1e6 * dl:.2g}", f"{1e3 * np.rad2deg(max(angles)):.2g}"]
        ratio = measures.ratio("all lasers of a window, velocal", full)
        rows.append([full, str(len(data.phi)), measures.time_of(full), ratio, *apart])
    rows += [[name, count, measures.time_of(name), "", "", ""] for name, count in units.items()]
    headings = [
        "what is adjusted", "medians", "ms", "times as long as velocal",
        "largest difference of dl, um", "of angles, mdeg",
    ]  # fmt: skip
    return table(headings, rows)
