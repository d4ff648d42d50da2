"""Whether the result is the same at the beginning, in the middle and at the end of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from scipy.special import ndtr

from velocal.evaluation.candidates import Role
from velocal.evaluation.variance_test import holm_p
from velocal.paper.claims.verdict import ALPHA, Judgement, Verdict
from velocal.paper.printed import printed_rows
from velocal.scanner.models import scanner_named

#: A change is negligible if it adds less than 5 % to a standard deviation, that is, if its root
#: mean square is below this share of it.
NEGLIGIBLE = float(np.sqrt(1.05**2 - 1.0))


def judge(drift: pd.DataFrame, summary: pd.DataFrame) -> list[Judgement]:
    """Judge whether windows of a recording give the same, for both scanners.

    Parameters
    ----------
    drift : DataFrame
        Rows of `drift.drift_table`.
    summary : DataFrame
        Statistics of all windows.
    """
    after = summary[(summary["data"] == "calibration") & (summary["role"] == Role.WINDOW.value)]
    judgements = []
    for scanner, of_scanner in drift.groupby("scanner", sort=False):
        texts, unstable = [], []
        for sample, own in of_scanner.groupby("sample", sort=False):
            change, std = (
                own.pivot_table(index="window", columns="laser_id", values=name, sort=False)
                for name in ("change_cm", "std_cm")
            )
            size, first, last = max(
                (float(np.sqrt(((change.loc[b] - change.loc[a]) ** 2).mean())), str(a), str(b))
                for a, b in combinations(change.index, 2)
            )
            moved = change.loc[last] - change.loc[first]
            error = np.sqrt(std.loc[last] ** 2 + std.loc[first] ** 2)
            p = holm_p(np.asarray(2.0 * ndtr(-np.abs(np.asarray(moved / error, dtype=float)))))
            level = float(after[after["sample"] == sample]["rms_cm"].mean())
            unstable += [str(sample)] if size > NEGLIGIBLE * level else []
            texts.append(
                f"{sample}, {first} to {last}: rms {size:.2g} cm (mean {moved.mean():+.2g}), "
                f"{100 * size / level:.0f} % of {level:.2g} cm; {int((p < ALPHA).sum())} of "
                f"{len(p)} lasers differ"
            )
        short = scanner_named(str(scanner)).short_name
        judgements.append(
            Judgement(
                f"windows_{short}",
                "Largest change of the measured distances between two windows: "
                + "; ".join(texts)
                + ".",
                "Differences of the same medians, with the scatter of blocks of 5 deg, Holm over "
                f"the lasers. Holds if in every sample the root mean square is below "
                f"{100 * NEGLIGIBLE:.0f} % of the standard deviation after calibration, that is, "
                "if it adds less than 5 % to it.",
                Verdict.FAILS if unstable else Verdict.HOLDS,
                _why(unstable, short),
            )
        )
    return judgements


def _why(unstable: Sequence[str], short: str) -> str:
    if not unstable:
        return "Single lasers change by amounts that can be measured, but not by enough to matter."
    why = (
        f"Not in {' and '.join(unstable)}: distances follow the temperature of the scanner "
        "(drift/drift.png), which had not reached its steady value."
    )
    printed = [
        f"{row.values['std_cm']:g}"
        for row in printed_rows()
        if (row.table, row.sample, row.calibration) == ("IV", "sa1", "after")
        and scanner_named(row.scanner).short_name == short
    ]
    if printed:
        why += (
            f" The paper's Table IV shows the same: after calibration {', '.join(printed)} cm at "
            "the beginning, in the middle and at the end of sa1."
        )
    return why
