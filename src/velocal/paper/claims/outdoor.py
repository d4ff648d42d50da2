"""By how much residuals outdoors become smaller, and where they do not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from velocal.paper.claims.verdict import ALPHA, Judgement, Verdict
from velocal.paper.outdoor import before_and_after
from velocal.paper.printed import outdoor_seeds, printed_statements
from velocal.scanner.models import scanner_named

#: Distance at which the paper saw no gain, metres.
EXCEPTION_M = 25

#: What the paper says of means outdoors: kind, scanner, reduction in per cent.
REDUCTIONS = {
    "smaller_30": ("ideal", "HDL-64E", 30.0),
    "smaller_20_64": ("real", "HDL-64E", 20.0),
    "smaller_20_32": ("real", "HDL-32E", 20.0),
}


def judge_reductions(means: pd.DataFrame) -> list[Judgement]:
    """Judge by how much residuals outdoors become smaller.

    Parameters
    ----------
    means : DataFrame
        Means of the outdoor validation, as `outdoor.summarise` gives them.
    """
    shown = before_and_after(means, ["kind", "scanner"]).set_index(["kind", "scanner"])
    statements = printed_statements().set_index("item")["paper"]
    seeds = outdoor_seeds()
    judgements = []
    for item, (kind, scanner, claimed) in REDUCTIONS.items():
        first, last = (float(shown[name][kind, scanner]) for name in ("before_cm", "after_cm"))
        of_seeds = seeds[(seeds["kind"] == kind) & (seeds["scanner"] == scanner)]
        sums = of_seeds.groupby("seed")[["before_cm", "after_cm"]].mean()
        every = _reduction(sums["before_cm"], sums["after_cm"]).to_numpy()
        low, high = _for_one_more(every)
        before, after = (
            float(statements[f"outdoor_{kind}_{when}_{scanner_named(scanner).short_name}"])
            for when in ("before", "after")
        )
        rounding = 0.05
        judgements.append(
            Judgement(
                item,
                f"Study: {first:.2f} to {last:.2f} cm, {_reduction(first, last):.1f} % smaller. "
                f"{len(every)} seeds of the world: {every.mean():.1f} % on average, standard "
                f"deviation {every.std(ddof=1):.1f} %.",
                f"95 % range of one more seed: {low:.0f} to {high:.0f} %. Holds if it contains "
                f"{claimed:g} %.",
                Verdict.HOLDS if low <= claimed <= high else Verdict.FAILS,
                f"The paper's own numbers, {before:g} to {after:g} cm, are "
                f"{_reduction(before, after):.1f} % smaller (from "
                f"{_reduction(before - rounding, after + rounding):.0f} to "
                f"{_reduction(before + rounding, after - rounding):.0f} % within their rounding). "
                "From unit to unit the reduction varies by more than that.",
            )
        )
    return judgements


def judge_25_m(samples: pd.DataFrame) -> Judgement:
    """Judge whether residuals outdoors become smaller except at 25 m.

    Parameters
    ----------
    samples : DataFrame
        Samples of the outdoor validation, as `outdoor.summarise` gives them.
    """
    ours = _ideal(before_and_after(samples, ["kind", "scanner", "sample"]))
    seeds = _ideal(outdoor_seeds())
    texts, gains = [], {}
    for metres, own in seeds.groupby("metres"):
        mean, half = float(own["change"].mean()), _half_width(own["change"].to_numpy())
        gains[metres] = mean + half < 0.0
        texts.append(f"{metres} m {mean:+.0f} [{mean - half:+.0f}, {mean + half:+.0f}]")
    study = ours.groupby("metres")["change"].mean()
    without = [f"{metres} m" for metres, gain in gains.items() if not gain]
    there = seeds[seeds["metres"] == EXCEPTION_M]
    return Judgement(
        "except_25m",
        f"Change in per cent, study: {', '.join(f'{m} m {c:+.0f}' for m, c in study.items())}. "
        f"Mean of {seeds['seed'].nunique()} seeds with its 95 % interval: {', '.join(texts)}.",
        "t-intervals over the seeds. Holds if the residuals become smaller on average at every "
        f"distance but at {EXCEPTION_M} m.",
        Verdict.HOLDS if without == [f"{EXCEPTION_M} m"] else Verdict.FAILS,
        f"On average the world gives no gain at {' and '.join(without) or 'no distance'}. The "
        "factory calibrates at 25.04 m; a calibration at 2 to 5 m replaces its error there by "
        "that of the range scale, which is as large and stays the same beyond. From seed to seed "
        f"the change at {EXCEPTION_M} m has a standard deviation of {there['change'].std():.0f} %: "
        f"the study's own is a draw with {_at_exception(ours):.2f} cm after calibration, where "
        f"the seeds have {there['after_cm'].mean():.2f} cm on average.",
    )


def _ideal(rows: pd.DataFrame) -> pd.DataFrame:
    """Ideal scenes with whole metres and the change in per cent."""
    own = rows[rows["kind"] == "ideal"]
    return own.assign(
        metres=own["distance_m"].round().astype(int),
        change=-_reduction(own["before_cm"], own["after_cm"]),
    )


def _at_exception(rows: pd.DataFrame) -> float:
    return float(rows.loc[rows["metres"] == EXCEPTION_M, "after_cm"].mean())


def _reduction(before: Any, after: Any) -> Any:
    """By how many per cent a standard deviation has become smaller."""
    return 100.0 * (1.0 - after / before)


def _half_width(values: NDArray[np.floating]) -> float:
    """Half width of the 95 % interval of a mean."""
    n = len(values)
    return float(stdtrit(n - 1, 1.0 - ALPHA / 2.0) * np.std(values, ddof=1) / np.sqrt(n))


def _for_one_more(values: NDArray[np.floating]) -> tuple[float, float]:
    """Range in which one more draw lies with a probability of 95 %."""
    half = _half_width(values) * np.sqrt(len(values) + 1.0)
    return float(np.mean(values)) - half, float(np.mean(values)) + half
