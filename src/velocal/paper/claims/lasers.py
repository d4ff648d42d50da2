"""How many lasers comply, and whether every laser becomes better."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from velocal.paper.best_set import BEFORE, shown_after
from velocal.paper.claims.verdict import Judgement, Verdict
from velocal.paper.printed import printed_statements
from velocal.study.figures import Table


def judge_count(lasers: pd.DataFrame, summary: pd.DataFrame, validation: Table) -> Judgement:
    """Judge how many lasers of the HDL-64E comply in the indoor validation.

    Parameters
    ----------
    lasers, summary : DataFrame
        Statistics of all lasers, and of all windows.
    validation : Table
        Table IV in the configuration.
    """
    printed = printed_statements().set_index("item").loc["lasers_after_validation_64"]
    after = shown_after(summary, validation.scanner, validation.samples, "validation", "tables")
    rows = _of(after.rows(lasers), validation)
    per_row = rows.groupby(["sample", "window"], sort=False)["complies_zero"].sum()
    always = int((rows.groupby("laser_id")["complies_zero"].min() == 1).sum())
    mean = float(per_row.mean())
    by_sample = "; ".join(
        f"{sample} {count:.1f}"
        for sample, count in per_row.groupby("sample", sort=False).mean().items()
    )
    close = abs(mean - printed["paper"]) <= printed["tolerance"]
    return Judgement(
        "lasers_36",
        f"Mean over the {len(per_row)} rows of Table IV: {mean:.1f} (from {per_row.min()} to "
        f"{per_row.max()}); by sample: {by_sample}. In all rows: {always}.",
        "Lasers whose variance about zero is below sigma squared by a one-sided chi-square test "
        "at 5 %, which takes residuals as independent, as in the paper. Holds if the mean is "
        f"within {printed['tolerance']:g} of {printed['paper']:g}.",
        Verdict.HOLDS if close else Verdict.FAILS,
        "We read the number as a mean over the rows. At the position that was not calibrated at "
        "fewer lasers comply than at the other one, and hardly any complies in every row.",
    )


def _of(rows: pd.DataFrame, selection: Table) -> pd.DataFrame:
    """Rows of a table of the configuration."""
    own = (rows["scanner"] == selection.scanner) & (rows["data"] == selection.data)
    return rows[own & rows["sample"].isin(selection.samples)]


def judge_better(
    lasers: pd.DataFrame, summary: pd.DataFrame, tables: Mapping[str, Table]
) -> Judgement:
    """Judge whether the standard deviation of every laser becomes smaller.

    Parameters
    ----------
    lasers, summary : DataFrame
        Statistics of all lasers, and of all windows.
    tables : mapping of str to Table
        Entries of the configuration, by number.
    """
    texts, worse_anywhere = [], 0
    for selection in tables.values():
        after = shown_after(summary, selection.scanner, selection.samples, selection.data, "tables")
        groups = {"all": selection.samples} | {
            sample: (sample,) for sample in selection.samples if len(selection.samples) > 1
        }
        counts = []
        for label, samples in groups.items():
            part = selection.model_copy(update={"samples": tuple(samples)})
            before_cm, after_cm = (
                _pooled_rms(_of(shown.rows(lasers), part)) for shown in (BEFORE, after)
            )
            change = (after_cm - before_cm).dropna()
            counts.append(f"{label} {int((change > 0).sum())} of {len(change)}")
            if label == "all":
                worse_anywhere += int((change > 0).sum())
                counts[0] += f" (by {max(change.max(), 0.0):.2f} cm at most)"
        texts.append(f"{selection.scanner}, {selection.data}: {', '.join(counts)}")
    return Judgement(
        "better",
        f"Lasers that become worse: {'; '.join(texts)}.",
        "Root mean square of all residuals of a laser, before and after. Holds if it becomes "
        "smaller for every laser.",
        Verdict.FAILS if worse_anywhere else Verdict.HOLDS,
        "On the data that were adjusted on, least squares makes every residual smaller on average. "
        "Elsewhere a laser whose factory values were good already takes over shifts of the "
        "calibration's position and drifts of its samples. The figures per laser mark these lasers."
        if worse_anywhere
        else "Every laser becomes better.",
    )


def _pooled_rms(rows: pd.DataFrame) -> pd.Series:
    """Root mean square of all residuals of every laser over the windows."""
    count = rows["count"].astype(float)
    square = (count * rows["rms_cm"].astype(float) ** 2).groupby(rows["laser_id"]).sum()
    return (square / count.groupby(rows["laser_id"]).sum()) ** 0.5
