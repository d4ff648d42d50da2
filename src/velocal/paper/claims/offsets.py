"""Whether corrections of voff and hoff are far below sigma."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from velocal.adjustment.average import Member, average
from velocal.adjustment.functional import ADJUSTABLE_UNITS
from velocal.adjustment.lasers import find_corrections
from velocal.adjustment.observations import Observations
from velocal.adjustment.result import CalibrationSet
from velocal.adjustment.stochastic import SurveyUncertainty
from velocal.arrays import Array
from velocal.chain import adjust
from velocal.evaluation.methods import WALL
from velocal.paper.claims.verdict import QUANTILE, SHOWN, Judgement, Verdict, rms
from velocal.scanner.parameters import LaserParameters
from velocal.study.adjustment import Adjustment

#: Offsets, in the order in which they are judged.
OFFSETS = ("voff", "hoff")
#: What is adjusted, and the prior standard deviation of an offset: the datasheet's sigma.
NAMES, PRIOR_CM = ("dl", "alpha", "v", *OFFSETS), 2.0


@dataclass(frozen=True)
class FiveParameters:
    """Adjustments of five parameters on the medians of one window.

    Attributes
    ----------
    configured : CalibrationSet
        With the study's solver and stochastic model.
    as_printed : ndarray, shape (lasers, 5)
        Corrections with the paper's pseudo-inverse at machine precision, on walls only.
    """

    configured: CalibrationSet
    as_printed: Array


def adjust_five(
    data: Observations,
    factory: LaserParameters,
    settings: Adjustment,
    survey: Sequence[SurveyUncertainty],
) -> FiveParameters:
    """Adjust voff and hoff too.

    Parameters
    ----------
    data : Observations
    factory : LaserParameters
    settings : Adjustment
        The study's; offsets get a prior standard deviation of `PRIOR_CM`.
    survey : sequence of SurveyUncertainty
        Of every station.

    Returns
    -------
    FiveParameters
    """
    prior = settings.prior.model_copy(update={f"{name}_cm": PRIOR_CM for name in OFFSETS})
    five = settings.model_copy(update={"parameters": NAMES, "prior": prior})
    walls = data.take(np.abs(data.normal[:, 2]) < WALL)
    exact = five.model_copy(update={"method": "paper", "truncate_at": None})
    as_printed, _ = find_corrections(walls, factory, NAMES, exact.solver(), exact.stochastic())
    return FiveParameters(adjust(data, factory, five, survey), as_printed)


def table(
    scanner: str,
    sample: str,
    windows: Sequence[FiveParameters],
    truth: LaserParameters | None = None,
) -> pd.DataFrame:
    """Corrections of voff and hoff of a sample, the mean over its windows, per laser.

    Parameters
    ----------
    scanner, sample : str
    windows : sequence of FiveParameters
    truth : LaserParameters, optional
        True parameters, where they are known.

    Returns
    -------
    DataFrame
        Columns ``scanner``, ``sample``, ``laser`` (counted from 1), ``laser_id``, and for voff,
        hoff and alpha the correction, its ``_std`` and its ``_true`` value in cm or deg; and
        ``correlation`` of hoff with alpha; and ``voff_printed_cm`` and ``hoff_printed_cm``, the
        largest correction of a window with the paper's pseudo-inverse.
    """
    mean = average([Member(sample, "", each.configured) for each in windows])
    columns: dict[str, object] = {"scanner": scanner, "sample": sample}
    columns |= {"laser": 1 + np.arange(len(mean)), "laser_id": np.arange(len(mean))}
    for name in (*OFFSETS, "alpha"):
        at = mean.names.index(name)
        unit, factor = SHOWN[ADJUSTABLE_UNITS[name]]
        columns[f"{name}_{unit}"] = factor * mean.corrections[:, at]
        columns[f"{name}_std_{unit}"] = factor * mean.std[:, at]
        known = np.nan if truth is None else getattr(truth, name) - getattr(mean.initial, name)
        columns[f"{name}_true_{unit}"] = factor * known
    hoff, alpha = mean.names.index("hoff"), mean.names.index("alpha")
    for name in OFFSETS:
        at = mean.names.index(name)
        printed = np.abs([each.as_printed[:, at] for each in windows])
        columns[f"{name}_printed_cm"] = 1e2 * printed.max(axis=0)
    covariance = mean.covariance
    columns["correlation"] = covariance[:, hoff, alpha] / (mean.std[:, hoff] * mean.std[:, alpha])
    return pd.DataFrame(columns)


def judge(offsets: pd.DataFrame, sigma_cm: float) -> list[Judgement]:
    """Judge whether corrections of voff and hoff are far below sigma.

    Parameters
    ----------
    offsets : DataFrame
        Tables of `table`, one below the other.
    sigma_cm : float
        Standard deviation of the datasheet.
    """
    judgements = []
    for name, why in zip(OFFSETS, (_why_voff(offsets), _why_hoff(offsets)), strict=True):
        size = offsets[f"{name}_cm"].abs()
        bound = size + QUANTILE * offsets[f"{name}_std_cm"]
        largest = "; ".join(
            f"{sample} {rms(own):.2f}, {own.max():.2f}"
            for sample, own in size.groupby(offsets["sample"], sort=False)
        )
        if (size > sigma_cm).any():
            verdict = Verdict.FAILS
        else:
            verdict = Verdict.HOLDS if (bound < sigma_cm).all() else Verdict.OPEN
        judgements.append(
            Judgement(
                name,
                f"Corrections in cm, rms and largest: {largest}. {int((size < sigma_cm).sum())} of "
                f"{len(size)} are below sigma, {int((bound < sigma_cm).sum())} with their whole "
                "interval. With the pseudo-inverse at machine precision, on walls only, the "
                f"largest one is {offsets[f'{name}_printed_cm'].max():.0f} cm.",
                "95 % intervals with the stated covariance. Holds if all are within sigma "
                f"({sigma_cm:g} cm); does not hold if a correction is larger; else it cannot be "
                "judged.",
                verdict,
                why,
            )
        )
    return judgements


def _why_voff(offsets: pd.DataFrame) -> str:
    return (
        "A wall says nothing about a height: there the column of voff is zero, and on the floor it "
        "is nearly that of v. The corrections are small because the solver leaves at zero what the "
        "data do not determine (median standard deviation "
        f"{offsets['voff_std_cm'].median():.1f} cm), and not because the offsets are known."
    )


def _why_hoff(offsets: pd.DataFrame) -> str:
    why = (
        "At one position hoff is hardly distinguished from alpha (median correlation "
        f"{offsets['correlation'].median():+.2f}), so that an error of one goes with an error of "
        "the other."
    )
    if offsets["hoff_true_cm"].isna().any():
        return why
    errors = {
        name: offsets[f"{name}_{unit}"] - offsets[f"{name}_true_{unit}"]
        for name, unit in (("alpha", "deg"), ("hoff", "cm"))
    }
    return why + (
        f" The true correction of hoff is {offsets['hoff_true_cm'].abs().max():.2g} cm, so that "
        f"every correction is an error. These errors ({rms(errors['hoff']):.2f} cm rms) have a "
        f"correlation of {np.corrcoef(errors['hoff'], errors['alpha'])[0, 1]:+.2f} with those of "
        f"alpha ({rms(errors['alpha']):.2f} deg rms)."
    )
