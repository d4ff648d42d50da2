"""Outdoor validation: the panels of all samples together, and what is shown before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from velocal.evaluation.candidates import IDENTITY
from velocal.paper.best_set import BEFORE, best_set
from velocal.scanner.models import scanner_named

#: Columns of the rows of panels that are the same in all rows of a sample.
HEADING = ("kind", "scanner", "sample")


def summarise(panels: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Reduce the rows of all panels.

    Parameters
    ----------
    panels : DataFrame
        Columns `HEADING` and those of `panels.panel_rows`.

    Returns
    -------
    samples : DataFrame
        A row per sample and calibration: means over the panels of ``distance_m`` and ``rms_cm``,
        sums of ``points`` and ``trimmed``, ``lasers`` of the panel that fewest see. ``shown`` is
        "before", "after" (the best set of the kind and scanner), or empty.
    means : DataFrame
        A row per kind, scanner and calibration: number of ``samples``, mean ``rms_cm``, ``shown``.

    Raises
    ------
    VelocalError
        If the samples of a kind and scanner do not have the same sets, or none.
    """
    samples = (
        panels.groupby([*HEADING, *IDENTITY], sort=False)
        .agg(
            distance_m=("distance_m", "mean"),
            points=("points", "sum"),
            trimmed=("trimmed", "sum"),
            lasers=("lasers", "min"),
            rms_cm=("rms_cm", "mean"),
        )
        .reset_index()
        .assign(shown="")
    )
    for (kind, scanner), group in samples.groupby(["kind", "scanner"], sort=False):
        names = ", ".join(dict.fromkeys(group["sample"]))
        after = best_set(group, f"{scanner}, {kind} samples {names}", "outdoor")
        for label, shown in (("before", BEFORE), ("after", after)):
            samples.loc[shown.rows(group).index, "shown"] = label
    means = (
        samples.groupby(["kind", "scanner", *IDENTITY, "shown"], sort=False)
        .agg(samples=("sample", "size"), rms_cm=("rms_cm", "mean"))
        .reset_index()
    )
    return samples, means


def before_and_after(rows: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """Put what is shown before and after side by side.

    Parameters
    ----------
    rows : DataFrame
        Samples or means, as `summarise` gives them.
    keys : sequence of str
        Columns that tell the rows of the result from each other.

    Returns
    -------
    DataFrame
        The columns of the row before but for its calibration, ``before_cm``, ``after_cm``, and
        ``parameter_set`` of the row after.
    """
    before, after = (rows[rows["shown"] == label] for label in ("before", "after"))
    before = before.drop(columns=[*IDENTITY, "shown"]).rename(columns={"rms_cm": "before_cm"})
    after = after.rename(columns={"rms_cm": "after_cm"})
    return before.merge(
        after[[*keys, "after_cm", "parameter_set"]], on=list(keys), validate="one_to_one"
    )


def facts(means: pd.DataFrame) -> list[dict[str, Any]]:
    """Means that are shown, as ``item`` and ``value``: outdoor_real_after_32 and its like."""
    found = []
    for row in means[means["shown"] != ""].to_dict(orient="records"):
        short = scanner_named(row["scanner"]).short_name
        item = f"outdoor_{row['kind']}_{row['shown']}_{short}"
        found.append({"item": item, "value": row["rms_cm"]})
    return found
