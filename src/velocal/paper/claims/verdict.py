"""What a verdict on a claim of the paper is, and the table of all of them.

Every verdict follows from the numbers by a rule that stands beside it; none is written by hand.
They are verdicts on the simulated world, not on the authors' recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pandas as pd

from velocal.errors import VelocalError
from velocal.io.markup import markdown_table
from velocal.paper.printed import printed_claims
from velocal.paper.tables import SIMULATED

#: Significance of all tests, and its two-sided quantile of the normal distribution.
ALPHA, QUANTILE = 0.05, 1.959964
#: Unit for people, and how many of it are one of the unit inside, by unit.
SHOWN = {"m": ("cm", 1e2), "rad": ("deg", 180.0 / np.pi)}


class Verdict(StrEnum):
    """What the numbers say of a claim."""

    HOLDS = "holds"
    FAILS = "does not hold in our world"
    OPEN = "cannot be judged"


@dataclass(frozen=True)
class Judgement:
    """Verdict on a claim, and what it rests on.

    Attributes
    ----------
    item : str
        Claim, as in ``data/claims.csv``.
    computed : str
        The numbers, in words.
    test : str
        The test or interval, and the rule of the verdict.
    verdict : Verdict
    explanation : str
        Why it is so.
    """

    item: str
    computed: str
    test: str
    verdict: Verdict
    explanation: str


def table(judgements: Sequence[Judgement]) -> pd.DataFrame:
    """Put claims and verdicts together, in the order of the claims.

    Raises
    ------
    VelocalError
        If a claim has no verdict, or more than one.
    """
    claims = printed_claims()
    found = [judgement.item for judgement in judgements]
    if sorted(found) != sorted(claims["item"]):
        raise VelocalError(
            f"verdicts on {', '.join(found)}",
            where="claims of the paper",
            allowed=f"one on each of {', '.join(claims['item'])}",
        )
    rows = pd.DataFrame([vars(judgement) for judgement in judgements])
    return claims.merge(rows.assign(verdict=rows["verdict"].astype(str)), on="item")


def markdown(claims: pd.DataFrame, *, simulated: bool) -> str:
    """Claims as Markdown.

    Parameters
    ----------
    claims : DataFrame
        As `table` gives it.
    simulated : bool
        Whether a note says that the recordings are simulated.
    """
    columns = ["claim", "where", "computed", "test", "verdict", "explanation"]
    lines = ["**Claims of the paper that its tables do not answer.**", ""]
    lines += markdown_table(
        [name.capitalize() for name in columns],
        claims[columns].astype(str).to_numpy().tolist(),
        [False] * len(columns),
    )
    if simulated:
        lines += ["", f"The verdicts are on the simulated world. {SIMULATED}"]
    return "\n".join(lines) + "\n"


def rms(values: pd.Series) -> float:
    """Root mean square."""
    return float(np.sqrt((values**2).mean()))
