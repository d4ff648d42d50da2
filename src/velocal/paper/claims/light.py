"""Whether the halogen light influences the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.special import chdtrc, chdtri, chndtrinc, ndtr

from velocal.adjustment.average import average
from velocal.adjustment.functional import ADJUSTABLE_UNITS
from velocal.adjustment.result import CalibrationSet
from velocal.evaluation.variance_test import holm_p
from velocal.paper.claims import LIGHT
from velocal.paper.claims.verdict import ALPHA, QUANTILE, SHOWN, Judgement, Verdict, rms
from velocal.study.windows import WINDOWS

#: Power at which the smallest effect is stated that a test finds.
POWER = 0.8


def differences(sets: Mapping[str, Sequence[CalibrationSet]]) -> pd.DataFrame:
    """Parameters with the halogen light minus without, per pair of samples, parameter and laser.

    Both samples were recorded at one position. Errors of the pose, of the planes and of their
    flatness, of a range scale, and what was left to the prior, are the same in both. What differs
    is the stated noise and the stated repeatability, each twice.

    Parameters
    ----------
    sets : mapping of str to sequence of CalibrationSet
        Adjustments of the windows, by sample.

    Returns
    -------
    DataFrame
        Columns ``without``, ``with``, ``parameter``, ``unit``, ``laser`` (counted from 1),
        ``laser_id``, ``difference``, ``std``, ``low``, ``high`` (95 % interval) and ``p_holm``
        (p-value, Holm over the lasers of a pair and parameter); centimetres and degrees.
    """
    rows = []
    for without, lit in LIGHT:
        first, second = (average(sets[name]) for name in (without, lit))
        own = [each for name in (without, lit) for each in sets[name]]
        variance = np.mean(
            [
                np.diagonal(each.sources["noise"] + each.sources["repeatability"], 0, 1, 2)
                for each in own
            ],
            axis=0,
        )
        seen = first.observed & second.observed
        for column, name in enumerate(first.names):
            unit, factor = SHOWN[ADJUSTABLE_UNITS[name]]
            std = np.where(seen, factor * np.sqrt(2.0 * variance[:, column]), np.nan)
            change = factor * (second.corrections - first.corrections)[:, column]
            with np.errstate(divide="ignore", invalid="ignore"):
                p = 2.0 * ndtr(-np.abs(change) / std)
            rows.append(
                pd.DataFrame(
                    {
                        "without": without, "with": lit, "parameter": name, "unit": unit,
                        "laser": 1 + np.arange(len(change)), "laser_id": np.arange(len(change)),
                        "difference": change, "std": std, "low": change - QUANTILE * std,
                        "high": change + QUANTILE * std,
                        "p_holm": holm_p(np.where(seen, p, np.nan)),
                    }
                )
            )  # fmt: skip
    return pd.concat(rows, ignore_index=True)


def judge(found: pd.DataFrame, drift: pd.DataFrame) -> Judgement:
    """Judge whether light influences the parameters.

    Parameters
    ----------
    found : DataFrame
        As `differences` gives it.
    drift : DataFrame
        Rows of `drift.drift_table`.
    """
    texts, p_values, effects = [], [], []
    for (without, lit, name), own in found.groupby(["without", "with", "parameter"], sort=False):
        seen = own[own["std"] > 0]
        n, stated = len(seen), rms(seen["std"])
        p_values.append(float(chdtrc(n, ((seen["difference"] / seen["std"]) ** 2).sum())))
        texts.append(
            f"{lit} - {without}, {name}: rms {rms(seen['difference']):.2g} {own['unit'].iloc[0]} "
            f"(stated {stated:.2g}, p {p_values[-1]:.2g})"
        )
        if name == "dl":
            shift = chndtrinc(chdtri(n, ALPHA), n, 1.0 - POWER)
            effects.append(stated * float(np.sqrt(shift / n)))
    smallest = float(holm_p(np.array(p_values)).min())
    rejected = int((found["p_holm"] < ALPHA).sum())
    dl = found[found["parameter"] == "dl"]
    pairs = dl.pivot_table(index="laser_id", columns="with", values="difference").to_numpy()
    together = float(np.corrcoef(pairs.T)[0, 1])
    means = ", ".join(f"{mean:+.2f}" for mean in dl.groupby("with")["difference"].mean())
    return Judgement(
        "light",
        f"{'; '.join(texts)}. Single lasers that differ (Holm): {rejected}. The differences of dl "
        f"in both pairs have a correlation of {together:+.2f} over the lasers.",
        "Chi-square over the lasers with the stated noise and repeatability of both samples, Holm "
        f"over {len(p_values)} tests, smallest p {smallest:.2g}. Holds if none is below {ALPHA:g}. "
        f"An influence on dl of {max(effects):.1f} cm rms would be found with a probability of "
        f"{100 * POWER:.0f} %.",
        Verdict.FAILS if smallest < ALPHA else Verdict.HOLDS,
        "With and without light, samples differ by "
        + ("more" if smallest < ALPHA else "no more")
        + f" than recordings do anyway. The mean differences of dl ({means} cm) contain the "
        "warm-up of scanners that began cold or warm; between the last windows they are "
        f"{_at_the_end(drift)} cm. The stated noise of the angles is mostly a pattern that repeats "
        "in both samples, so that the test of alpha and v is a weak one. Every pair differs in "
        "light and in time, and the samples cannot separate the two.",
    )


def _at_the_end(drift: pd.DataFrame) -> str:
    """Mean differences of dl between the last windows of the pairs, for people."""
    last = drift[drift["window"] == WINDOWS[-1]].groupby("sample")["change_cm"].mean()
    # A distance that is measured longer needs a smaller dl.
    return ", ".join(f"{last[without] - last[lit]:+.2f}" for without, lit in LIGHT)
