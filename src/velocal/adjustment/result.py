"""Typed results: the adjustment of one laser, and the calibration of all lasers of a scanner."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.adjustment.functional import ADJUSTABLE, ADJUSTABLE_UNITS, split
from velocal.arrays import Array
from velocal.errors import VelocalError
from velocal.scanner.parameters import LaserParameters

#: Degrees of freedom at which Student's distribution is the normal one.
_NORMAL = 1e9
#: Columns of a table of covariances that name a pair of parameters; sources are the others.
_PAIR = ("laser_id", "first", "second", "covariance", "correlation")
#: Units of a summary for people, and their size in the units of the parameters.
_FOR_PEOPLE = {"m": ("cm", 1e-2), "rad": ("deg", np.pi / 180.0), "1": ("1e-3", 1e-3)}


@dataclass(frozen=True)
class LaserQuality:
    """How well the adjustment of one laser went.

    Attributes
    ----------
    count : int
        Number of observations.
    rank : int
        Number of combinations of parameters that the data determine.
    redundancy : int
        Observations minus rank; without the rows that a robust solver has rejected.
    residual_std_m : float
        Standard deviation of the residuals, metres.
    variance_factor : float
        Sum of squared residuals in units of their a-priori standard deviation, over the redundancy.
        It is far from 1 where the a-priori noise is the datasheet's; there is no test of it,
        because the residuals are correlated.
    condition : float
        Of the scaled design matrix.
    least_redundancy_number : float
        Smallest redundancy number of an observation.
    weakly_determined : tuple of str
        Parameters of which the data determine less than half. Solvers that truncate leave them at
        the initial value with the standard deviation of the prior, except for their share in a
        combination that is determined; `WithPrior` moves them as far as the data allow.
    iterations : int
        Linearisations used.
    converged : bool
        Whether the iteration converged.
    message : str
        What happened, in words.
    std_above_prior : tuple of str
        Parameters whose stated standard deviation, of all sources, is larger than the prior one:
        the data change them although the initial value is known better. Solvers that truncate
        decide by independent noise, see `PaperModel`.
    """

    count: int
    rank: int
    redundancy: int
    residual_std_m: float
    variance_factor: float
    condition: float
    least_redundancy_number: float
    weakly_determined: tuple[str, ...]
    iterations: int
    converged: bool
    message: str
    std_above_prior: tuple[str, ...] = field(default=(), kw_only=True)


@dataclass(frozen=True)
class Adjustment(LaserQuality):
    """Corrections of one laser with their uncertainty, and the attributes of `LaserQuality`.

    Attributes
    ----------
    names : tuple of str
        Adjusted parameters, in the order of the vectors and matrices below.
    corrections : ndarray, shape (u,)
        To be added to the initial parameters; metres and radians.
    parts : mapping of str to ndarray, shape (u, u)
        Covariance of the corrections by source: ``noise`` of the observations, ``prior`` (of what
        the data do not determine), ``pose``, ``planes``, ``flatness``, ``range_scale``,
        ``repeatability``.
    dof : ndarray, shape (u,)
        Degrees of freedom of the variance of each parameter in the noise part.
    non_estimable : tuple of str
        What is not determined, as combinations in units of the prior.
    singular_values : ndarray
        Of the scaled design matrix.
    residuals : ndarray, shape (n,)
        Misclosures after the adjustment, metres.
    redundancy_numbers : ndarray, shape (n,)
        Share of each misclosure that shows in its residual. Their sum is n minus the trace of the
        hat matrix, which is the redundancy, except for a solver with a prior.
    variance : float
        Sum of squared residuals, with the weights of a robust solver, over the redundancy, square
        metres; NaN without redundancy.
    """

    names: tuple[str, ...]
    corrections: Array
    parts: Mapping[str, Array]
    dof: Array
    non_estimable: tuple[str, ...]
    singular_values: Array
    residuals: Array
    redundancy_numbers: Array
    variance: float

    @property
    def covariance(self) -> Array:
        """Covariance of the corrections, all sources together, shape (u, u)."""
        return np.asarray(sum(self.parts.values()))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the corrections, shape (u, u)."""
        return _correlation(self.covariance)

    @property
    def std(self) -> Array:
        """Standard deviations of the corrections, shape (u,)."""
        return _std(self.covariance)

    @property
    def noise_std(self) -> Array:
        """The part of `std` from noise, which data of other positions average out, shape (u,)."""
        return _std(self.parts["noise"])

    @property
    def quality(self) -> LaserQuality:
        """Summary in numbers, without the arrays by observation."""
        return LaserQuality(
            **{each.name: getattr(self, each.name) for each in fields(LaserQuality)}
        )

    def interval(self, level: float = 0.95) -> Array:
        """Half widths of confidence intervals, shape (u,).

        Where the noise is estimated from few blocks, Student's quantile is used. Its degrees of
        freedom, by Welch and Satterthwaite, grow with the share of the other sources, whose sizes
        are known.

        Parameters
        ----------
        level : float
            Probability that an interval covers the truth.
        """
        from scipy.special import stdtrit  # here: many jobs import this module, few need it

        noise = np.diag(self.parts["noise"])
        total = np.diag(self.covariance)
        with np.errstate(invalid="ignore", divide="ignore"):
            dof = np.where(noise > 0, self.dof * (total / noise) ** 2, _NORMAL)
        quantile = stdtrit(np.clip(dof, 1.0, _NORMAL), 0.5 + level / 2.0)
        return np.asarray(quantile * self.std)


@dataclass(frozen=True)
class CalibrationSet:
    """Calibration of all lasers of a scanner with its covariance.

    Attributes
    ----------
    names : tuple of str
        Adjusted parameters, in the order of the vectors and matrices below.
    initial : LaserParameters
        Parameters that the corrections belong to.
    corrections : ndarray, shape (lasers, u)
        To be added to the initial parameters; metres and radians. Zero for a laser that was not
        observed.
    observed : ndarray of bool, shape (lasers,)
        Whether there are observations of the laser.
    sources : mapping of str to ndarray, shape (lasers, u, u)
        Covariance of the corrections by source, see `Adjustment.parts`; empty where it is not
        known.
    quality : tuple of LaserQuality
        By laser; empty for a mean of several sets.
    """

    names: tuple[str, ...]
    initial: LaserParameters
    corrections: Array
    observed: NDArray[np.bool_]
    sources: Mapping[str, Array] = field(default_factory=dict)
    quality: tuple[LaserQuality, ...] = ()

    @classmethod
    def from_adjustments(
        cls, results: Sequence[Adjustment], initial: LaserParameters
    ) -> CalibrationSet:
        """Put the adjustments of all lasers together.

        Parameters
        ----------
        results : sequence of Adjustment
            By laser.
        initial : LaserParameters
            Where the adjustments started.

        Returns
        -------
        CalibrationSet
            With all sources of covariance, and the quality of every laser.
        """
        names = list(dict.fromkeys(source for one in results for source in one.parts))
        zero = np.zeros((len(results[0].names),) * 2)
        return cls(
            names=results[0].names,
            initial=initial,
            corrections=np.array([one.corrections for one in results]),
            observed=np.array([len(one.residuals) > 0 for one in results]),
            sources={
                name: _symmetric(np.array([one.parts.get(name, zero) for one in results]))
                for name in names
            },
            quality=tuple(one.quality for one in results),
        )

    @classmethod
    def from_columns(
        cls,
        columns: Mapping[str, NDArray[Any]],
        initial: LaserParameters,
        covariance: Mapping[str, NDArray[Any]] | None = None,
    ) -> CalibrationSet:
        """Read what `to_columns` and `covariance_columns` gave.

        Parameters
        ----------
        columns : mapping of str to ndarray
            Columns of corrections and quality, a row per laser.
        initial : LaserParameters
            Where the adjustment started.
        covariance : mapping of str to ndarray, optional
            Columns of covariances; without them `sources` is empty.

        Returns
        -------
        CalibrationSet
            With parameters in the order of `functional.ADJUSTABLE`.

        Raises
        ------
        VelocalError
            If a column is missing, or the number of lasers is not that of `initial`.
        """
        present = {name: f"{name}_correction_{ADJUSTABLE_UNITS[name]}" for name in ADJUSTABLE}
        names = tuple(name for name, column in present.items() if column in columns)
        values = [np.asarray(columns[present[name]], dtype=float) for name in names]
        if not names or any(len(value) != len(initial) for value in values):
            raise VelocalError(
                f"corrections of {', '.join(names) or 'no parameter'} for "
                f"{len(values[0]) if values else 0} lasers",
                where="columns of an adjustment",
                allowed=f"corrections for {len(initial)} lasers",
            )
        of = fields(LaserQuality)
        rows = zip(*(_column(columns, each.name) for each in of), strict=True)
        quality = tuple(
            LaserQuality(
                **{e.name: _READ[str(e.type)](value) for e, value in zip(of, row, strict=True)}
            )
            for row in rows
        )
        return cls(
            names=names,
            initial=initial,
            corrections=np.column_stack(values),
            observed=np.array([one.count > 0 for one in quality]),
            sources={} if covariance is None else _matrices(covariance, names, len(initial)),
            quality=quality,
        )

    def __len__(self) -> int:
        return len(self.corrections)

    @property
    def adjusted(self) -> LaserParameters:
        """Initial parameters with the corrections added; without a range scale."""
        return split(self.corrections, self.names, self.initial)[0]

    @property
    def range_scale(self) -> Array | None:
        """Range scale of every laser, shape (lasers,); None where it was not adjusted."""
        return split(self.corrections, self.names, self.initial)[1]

    @property
    def covariance(self) -> Array:
        """Covariance of the corrections, all sources together; NaN where it is not known.

        Shape (lasers, u, u).
        """
        if not self.sources:
            return np.full((*self.corrections.shape, len(self.names)), np.nan)
        return np.asarray(sum(self.sources.values()))

    @property
    def std(self) -> Array:
        """Standard deviations of the corrections, shape (lasers, u)."""
        return _std(self.covariance)

    @property
    def noise_std(self) -> Array:
        """The part of `std` from noise, shape (lasers, u); NaN where it is not known."""
        noise = self.sources.get("noise")
        return np.full(self.corrections.shape, np.nan) if noise is None else _std(noise)

    def std_by_name(self) -> dict[str, Array]:
        """Standard deviations, shape (lasers,), by parameter."""
        return dict(zip(self.names, self.std.T, strict=True))

    def covariance_by_pair(self) -> dict[tuple[str, str], Array]:
        """Covariances of two different parameters of a laser, shape (lasers,), by pair."""
        covariance = self.covariance
        return {
            (self.names[i], self.names[j]): covariance[:, i, j]
            for i, j in itertools.combinations(range(len(self.names)), 2)
        }

    def to_columns(self) -> dict[str, list[Any]]:
        """Columns of corrections, standard deviations and quality, a row per laser."""
        columns: dict[str, list[Any]] = {"laser_id": list(range(len(self)))}
        std, noise_std = self.std, self.noise_std
        for number, name in enumerate(self.names):
            unit = ADJUSTABLE_UNITS[name]
            columns[f"{name}_correction_{unit}"] = self.corrections[:, number].tolist()
            columns[f"{name}_std_{unit}"] = std[:, number].tolist()
            columns[f"{name}_noise_std_{unit}"] = noise_std[:, number].tolist()
        for each in fields(LaserQuality):
            columns[each.name] = [getattr(one, each.name) for one in self.quality]
        for listed in ("weakly_determined", "std_above_prior"):
            columns[listed] = [" ".join(names) for names in columns[listed]]
        columns["converged"] = [int(value) for value in columns["converged"]]
        return columns

    def covariance_columns(self) -> dict[str, list[Any]]:
        """Columns of all covariances and correlations, a row per laser and pair of parameters.

        The column ``covariance`` is the sum of the columns of the sources. Units are the product
        of those of the two parameters.
        """
        pairs = itertools.combinations_with_replacement(range(len(self.names)), 2)
        first, second = np.array(list(pairs)).T
        n, named = len(self), np.array(self.names)

        def column(matrices: Array) -> list[float]:
            return matrices[:, first, second].ravel().tolist()

        columns: dict[str, list[Any]] = {
            "laser_id": np.repeat(np.arange(n), len(first)).tolist(),
            "first": np.tile(named[first], n).tolist(),
            "second": np.tile(named[second], n).tolist(),
            "covariance": column(self.covariance),
            "correlation": column(_correlation(self.covariance)),
        }
        return columns | {name: column(matrices) for name, matrices in self.sources.items()}

    def summary(self) -> str:
        """Describe the calibration in a few lines for people."""
        lines = [f"{len(self)} lasers, {int(self.observed.sum())} of them observed"]
        if self.quality:
            lines[0] += f", {sum(one.converged for one in self.quality)} converged"
        lines.append("parameter  unit  mean correction  its spread  median std  weakly determined")
        seen, std = self.observed, self.std
        for number, name in enumerate(self.names):
            unit, size = _FOR_PEOPLE[ADJUSTABLE_UNITS[name]]
            own = self.corrections[seen, number] / size
            median = np.median(std[seen, number]) / size if seen.any() else np.nan
            mean, spread = (own.mean(), own.std()) if len(own) else (np.nan, np.nan)
            weak = sum(name in one.weakly_determined for one in self.quality)
            lines.append(
                f"{name:9}  {unit:4}  {mean:15.3f}  {spread:10.3f}  {median:10.3f}  "
                f"{weak if self.quality else '-':>17}"
            )
        return "\n".join(lines)


def _symmetric(covariance: Array) -> Array:
    """Matrices without what rounding adds to one of two equal elements, of which one is written."""
    return np.asarray(0.5 * (covariance + np.swapaxes(covariance, -1, -2)))


def _std(covariance: Array) -> Array:
    """Roots of the diagonals of matrices along the last two axes."""
    return np.asarray(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)))


def _correlation(covariance: Array) -> Array:
    std = _std(covariance)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(covariance / (std[..., :, None] * std[..., None, :]))


def _column(columns: Mapping[str, NDArray[Any]], name: str) -> NDArray[Any]:
    """One column; an error that names it if it is missing."""
    if name not in columns:
        raise VelocalError(
            f"column {name!r} is missing",
            where="columns of an adjustment",
            hint="run the adjustment again with this version",
        )
    return np.asarray(columns[name])


#: How a value of `LaserQuality` is read from a table, by its type. An empty text reads as NaN.
_READ: dict[str, Callable[[Any], Any]] = {
    "int": int,
    "float": float,
    "bool": bool,
    "str": lambda value: value if isinstance(value, str) else "",
    "tuple[str, ...]": lambda value: tuple(value.split()) if isinstance(value, str) else (),
}


def _matrices(
    columns: Mapping[str, NDArray[Any]], names: Sequence[str], lasers: int
) -> dict[str, Array]:
    """Covariance matrices (lasers, u, u) by source."""
    laser = _column(columns, "laser_id").astype(np.int64)
    pairs = [_column(columns, key) for key in ("first", "second")]
    if unknown := set().union(*pairs) - set(names):
        raise VelocalError(
            f"covariances of {', '.join(sorted(map(str, unknown)))}",
            where="columns of an adjustment",
            allowed=f"those of the corrections: {', '.join(names)}",
        )
    i, j = (np.array([names.index(name) for name in pair], dtype=np.int64) for pair in pairs)
    found = {}
    for source in (name for name in columns if name not in _PAIR):
        found[source] = np.full((lasers, len(names), len(names)), np.nan)
        found[source][laser, i, j] = found[source][laser, j, i] = columns[source]
    return found
