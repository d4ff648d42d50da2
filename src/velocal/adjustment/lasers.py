"""Adjustment of all lasers of a scanner, each on its own, at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment import nuisance, quality
from velocal.adjustment.core import Block, Evaluation, iterate
from velocal.adjustment.functional import ADJUSTABLE, design, misclosure
from velocal.adjustment.result import Adjustment
from velocal.adjustment.solvers import Solver
from velocal.adjustment.stochastic import Stochastic, block_numbers
from velocal.scanner.beam import laser_beams
from velocal.scanner.parameters import LaserParameters

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Observations:
    """Distances to planes whose lasers are adjusted, from one or several stations.

    Attributes
    ----------
    distance_m, phi, laser_id : ndarray, shape (n,)
        Raw distance (metres), rotational angle (radians), laser.
    normal : ndarray, shape (n, 3)
        Unit normal of the plane of each, in the scanner frame of its station.
    offset : ndarray, shape (n,)
        Its offset, metres.
    plane : ndarray of int, shape (n,), or None
        Plane among those of the station; None where there is one only.
    station : ndarray of int, shape (n,), or None
        Station; None where there is one only.
    """

    distance_m: Array
    phi: Array
    laser_id: NDArray[np.integer]
    normal: Array
    offset: Array
    plane: NDArray[np.integer] | None = None
    station: NDArray[np.integer] | None = None

    @property
    def plane_number(self) -> NDArray[np.integer]:
        """`plane`, zeros where it is None."""
        return np.zeros(len(self.phi), dtype=np.int64) if self.plane is None else self.plane

    @property
    def station_number(self) -> NDArray[np.integer]:
        """`station`, zeros where it is None."""
        return np.zeros(len(self.phi), dtype=np.int64) if self.station is None else self.station

    def take(self, rows: slice | NDArray[np.integer] | NDArray[np.bool_]) -> Observations:
        """Some of the observations."""
        return Observations(
            self.distance_m[rows],
            self.phi[rows],
            self.laser_id[rows],
            self.normal[rows],
            self.offset[rows],
            self.plane_number[rows],
            self.station_number[rows],
        )

    def of(self, laser: int) -> Observations:
        """Observations of one laser."""
        return self.take(self.laser_id == laser)

    def misclosure(self, parameters: LaserParameters, scale: Array | None = None) -> Array:
        """Distance s along the beam of every observation, metres, shape (n,)."""
        return misclosure(
            self._scaled(scale), self.phi, self.laser_id, parameters, self.normal, self.offset
        )

    def design(
        self, parameters: LaserParameters, scale: Array | None = None
    ) -> tuple[Array, Array]:
        """Misclosures and design matrix; see `functional.design`."""
        s, matrix = design(
            self._scaled(scale), self.phi, self.laser_id, parameters, self.normal, self.offset
        )
        matrix[:, ADJUSTABLE.index("scale")] = self.distance_m
        return s, matrix

    def _scaled(self, scale: Array | None) -> Array:
        return self.distance_m if scale is None else self.distance_m * (1 + scale[self.laser_id])


def joined(stations: Sequence[Observations]) -> Observations:
    """Observations of several stations, to be adjusted together."""
    return Observations(
        np.concatenate([each.distance_m for each in stations]),
        np.concatenate([each.phi for each in stations]),
        np.concatenate([each.laser_id for each in stations]),
        np.concatenate([each.normal for each in stations]),
        np.concatenate([each.offset for each in stations]),
        np.concatenate([each.plane_number for each in stations]),
        np.concatenate([np.full(len(each.phi), i) for i, each in enumerate(stations)]),
    )


def split(
    x: Array, names: Sequence[str], initial: LaserParameters
) -> tuple[LaserParameters, Array | None]:
    """Parameters and range scale out of corrections, shape (lasers, u)."""
    change = dict(zip(names, x.T, strict=True))
    scale = change.pop("scale", None)
    return initial.corrected(change), scale


def adjust_all(
    observations: Observations,
    initial: LaserParameters,
    names: Sequence[str],
    solver: Solver,
    stochastic: Stochastic,
    *,
    max_iterations: int = 50,
    tolerance: float = 1e-4,
) -> list[Adjustment]:
    """Adjust the parameters `names` of every laser on its own observations.

    Parameters
    ----------
    observations : Observations
        Of all lasers.
    initial : LaserParameters
        Where to start.
    names : sequence of str
        Parameters to adjust, out of `functional.ADJUSTABLE`.
    solver : Solver
        Method.
    stochastic : Stochastic
        A-priori knowledge.
    max_iterations : int
        Largest number of linearisations.
    tolerance : float
        The iteration ends when no correction changes by more than this times its prior standard
        deviation (or itself, if that is larger).

    Returns
    -------
    list of Adjustment
        By laser; with rank 0 and all parameters held where a laser has no observations.
    """
    # Rows of a laser together, so that everything below is a slice; those of a station in the
    # order of the angle.
    order = np.lexsort((observations.phi, observations.station_number, observations.laser_id))
    data = observations.take(order)
    data = replace(data, normal=np.asfortranarray(data.normal))
    columns = [ADJUSTABLE.index(name) for name in names]
    by_alpha = ADJUSTABLE.index("alpha")
    prior_std = np.array([stochastic.prior_std[name] for name in names])

    sizes = np.bincount(data.laser_id, minlength=len(initial))
    ends = np.cumsum(sizes)
    # One number for all rows: parameters of the laser are then numbers as well.
    of_laser = [
        replace(data.take(slice(end - size, end)), laser_id=np.asarray(laser))
        for laser, (end, size) in enumerate(zip(ends, sizes, strict=True))
    ]
    n = len(order)
    spare = [Evaluation(np.empty(n), np.empty((len(names), n)).T, np.empty(n)) for _ in range(2)]
    kept: list[tuple[Array, Evaluation]] = []

    def model(x: Array) -> Evaluation:
        """Evaluate anew only the lasers whose parameters have changed since the last time."""
        changed = np.any(x != kept[0][0], axis=1) if kept else np.ones(len(x), dtype=bool)
        # Into the evaluation before the last: the last is in use. Fresh memory costs more time
        # than what is computed into it.
        adjusted, found = split(x, names, initial), spare.pop()
        if not changed.all():
            last = kept[0][1]
            found.w[:], found.matrix[:], found.row_std[:] = last.w, last.matrix, last.row_std
        # Arrays of one laser stay in the cache of the processor, those of all do not.
        for laser in np.flatnonzero(changed & (sizes > 0)):
            rows = slice(ends[laser] - sizes[laser], ends[laser])
            found.w[rows], design = of_laser[laser].design(*adjusted)
            found.matrix.T[:, rows] = design.T[columns]
            found.row_std[rows] = stochastic.row_std(design[:, by_alpha])
        spare.extend(evaluation for _, evaluation in kept)
        kept[:] = [(x.copy(), found)]
        return found

    x, final, blocks = iterate(
        model,
        np.zeros((len(initial), len(names))),
        sizes.tolist(),
        solver,
        prior_std,
        max_iterations=max_iterations,
        tolerance=tolerance,
    )
    parameters, scale = split(x, names, initial)
    point, towards = np.empty((3, n)).T, np.empty(n)
    for own, block in zip(of_laser, blocks, strict=True):
        direction, origin = laser_beams(own.phi, data.laser_id[block.rows], parameters)
        length = own._scaled(scale) + parameters.dl[own.laser_id] - final.w[block.rows]
        point[block.rows] = origin + length[:, None] * direction
        towards[block.rows] = np.einsum("ni,ni->n", direction, own.normal)
    by = nuisance.derivatives(
        stochastic,
        point=point,
        normal=data.normal,
        towards=towards,
        distance_m=data.distance_m,
        phi=data.phi,
        laser_id=data.laser_id,
        station=data.station_number,
        plane=data.plane_number,
    )
    noise = _block_covariance(data, blocks, final, stochastic)
    results = []
    for laser, block in enumerate(blocks):
        rows = block.rows
        if block.step is None:
            results.append(_unobserved(names, prior_std))
            continue
        results.append(
            _quality(
                names,
                x[laser],
                block,
                Evaluation(final.w[rows], final.matrix[rows], final.row_std[rows]),
                stochastic,
                by.of(rows),
                None if noise is None else (noise[0][laser], noise[1][laser]),
            )
        )
    return results


def adjust_laser(
    observations: Observations,
    laser: int,
    initial: LaserParameters,
    names: Sequence[str],
    solver: Solver,
    stochastic: Stochastic,
) -> Adjustment:
    """Adjust one laser; see `adjust_all`."""
    return adjust_all(observations.of(laser), initial, names, solver, stochastic)[laser]


def _block_covariance(
    data: Observations, blocks: Sequence[Block], final: Evaluation, stochastic: Stochastic
) -> tuple[Array, Array] | None:
    """`quality.block_covariance` of all lasers; None where rows are independent, or none are."""
    steps = [block.step for block in blocks if block.step is not None]
    if stochastic.block_rad is None or not steps:
        return None
    weights = [step.row_weight for step in steps if step.row_weight is not None]
    laser, station, plane = data.laser_id.astype(int), data.station_number, data.plane_number
    group = (laser * (int(station.max()) + 1) + station) * (int(plane.max()) + 1) + plane
    return quality.block_covariance(
        np.concatenate([step.gain for step in steps], axis=1),
        final.w,
        block_numbers(data.phi, group, stochastic.block_rad),
        final.matrix,
        final.row_std,
        laser,
        np.array([0 if block.step is None else block.step.rank for block in blocks]),
        np.concatenate(weights) if weights else None,
    )


def _quality(
    names: Sequence[str],
    corrections: Array,
    block: Block,
    final: Evaluation,
    stochastic: Stochastic,
    by: nuisance.Derivatives,
    correlated: tuple[Array, Array] | None,
) -> Adjustment:
    """Result of one laser with all its quality; noise and freedom of `correlated` if there are."""
    step = block.step
    assert step is not None
    residuals, weight = final.w, step.row_weight
    if weight is None:
        weight = np.ones(len(residuals))
    redundancy = int(np.count_nonzero(weight)) - step.rank
    squares = float(np.sum(weight * (residuals / final.row_std) ** 2))
    factor = squares / redundancy if redundancy > 0 else float("nan")
    if correlated is None or redundancy <= 0:
        known = factor if redundancy > 0 else 1.0
        noise = quality.independent_covariance(step, final.row_std, known)
        freedom = np.full(len(names), float(max(redundancy, 1)))
    else:
        noise, freedom = correlated
    parts = {"noise": noise, "prior": step.prior_part}
    parts |= dict(
        nuisance.contributions(step.gain, stochastic, by, scale_adjusted="scale" in names)
    )
    held = quality.held(names, step)
    combinations = quality.open_combinations(names, step)
    message = block.message
    if combinations:
        message += f"; rank {step.rank} of {len(names)}, left to the prior: "
        message += "; ".join(combinations)
    return Adjustment(
        names=tuple(names),
        corrections=corrections,
        parts=parts,
        freedom=freedom,
        rank=step.rank,
        held=held,
        open_combinations=combinations,
        condition=quality.condition(step),
        singular_values=step.singular_values[step.singular_values > 0.0],
        residuals=residuals,
        redundancy_numbers=1.0 - step.leverage,
        variance=float(weight @ residuals**2) / redundancy if redundancy > 0 else float("nan"),
        variance_factor=factor,
        variance_factor_p=quality.variance_factor_test(factor, redundancy),
        redundancy=redundancy,
        iterations=block.iterations,
        converged=block.converged,
        message=message,
    )


def _unobserved(names: Sequence[str], prior_std: Array) -> Adjustment:
    """Result of a laser without observations."""
    u, nan = len(names), float("nan")
    zero = np.zeros((u, u))
    return Adjustment(
        names=tuple(names),
        corrections=np.zeros(u),
        parts={"noise": zero, "prior": np.diag(prior_std**2)},
        freedom=np.ones(u),
        rank=0,
        held=tuple(names),
        open_combinations=tuple(names),
        condition=float("inf"),
        singular_values=np.zeros(u),
        residuals=np.zeros(0),
        redundancy_numbers=np.zeros(0),
        variance=nan,
        variance_factor=nan,
        variance_factor_p=nan,
        redundancy=0,
        iterations=0,
        converged=False,
        message="no observations",
    )
