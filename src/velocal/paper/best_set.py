"""Which calibration a table or figure shows as "after": the one place that chooses it.

The paper shows its best parameter set per table. It chooses it on the validation data themselves,
so that its numbers are a little better than those of a set that is chosen beforehand. Only what
reproduces the paper does so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from velocal.errors import VelocalError
from velocal.evaluation.candidates import Role


@dataclass(frozen=True)
class Shown:
    """Calibration that is shown.

    Attributes
    ----------
    role : Role
    parameter_set : str
        Name of the set; empty for the other roles.
    means_cm : mapping of str to float
        Mean ``rms_cm`` of every set that the choice was made from.
    """

    role: Role
    parameter_set: str = ""
    means_cm: Mapping[str, float] = field(default_factory=dict)

    @property
    def identity(self) -> dict[str, str]:
        """Columns `IDENTITY`."""
        return {"role": self.role.value, "parameter_set": self.parameter_set}

    def rows(self, table: pd.DataFrame) -> pd.DataFrame:
        """Rows of a table with the columns ``role`` and ``parameter_set`` that belong to it."""
        own = (table["role"] == self.role.value) & (table["parameter_set"] == self.parameter_set)
        return table[own]


#: What is shown as "before".
BEFORE = Shown(Role.FACTORY)


def best_set(rows: pd.DataFrame, of_what: str, where: str) -> Shown:
    """Choose the parameter set of least mean ``rms_cm``, the first of equal ones.

    Calibrations of a unit are chosen from where there is no parameter set: the paper's tables show
    the paper's sets.

    Parameters
    ----------
    rows : DataFrame
        Columns ``role``, ``parameter_set`` and ``rms_cm``; one row of every set for each window or
        sample. Rows of other roles are left out.
    of_what : str
        Scanner and samples, for errors.
    where : str
        Key of the configuration, for errors.

    Returns
    -------
    Shown

    Raises
    ------
    VelocalError
        If there is no set, if the sets were not validated on the same data, or if every set lacks
        residuals somewhere.
    """
    sets = rows[rows["role"] == Role.SET.value]
    role = Role.UNIT if sets.empty else Role.SET
    sets = rows[rows["role"] == role.value]
    groups = {str(name): group for name, group in sets.groupby("parameter_set", sort=False)}
    counts = {name: len(group) for name, group in groups.items()}
    if len(set(counts.values())) != 1:
        raise VelocalError(
            f"{of_what}: "
            + (
                f"rows per parameter set are {counts}"
                if counts
                else "no parameter set was validated"
            ),
            where=where,
            allowed="one or more sets, each validated on the same data",
        )
    # A set that lacks residuals anywhere has no mean.
    means = {name: float(np.mean(group["rms_cm"].to_numpy())) for name, group in groups.items()}
    finite = {name: mean for name, mean in means.items() if np.isfinite(mean)}
    if not finite:
        raise VelocalError(
            f"{of_what}: a window without residuals",
            where=where,
            hint="No return of it was assigned to a plane: look at assignment.limits.",
        )
    return Shown(role, min(finite, key=lambda name: finite[name]), means)


def shown_after(
    summary: pd.DataFrame, scanner: str, samples: Sequence[str], data: str, where: str
) -> Shown:
    """Calibration that a table or figure of some samples shows as "after".

    Parameters
    ----------
    summary : DataFrame
        Statistics of all windows.
    scanner : str
    samples : sequence of str
    data : {"calibration", "validation"}
        Medians have the adjustment of their own window if there is one, all others the best set.
    where : str
        Key of the configuration, for errors.

    Returns
    -------
    Shown

    Raises
    ------
    VelocalError
        As `best_set`.
    """
    chosen = (summary["data"] == data) & (summary["scanner"] == scanner)
    chosen &= summary["sample"].isin(list(samples))
    if data == "calibration" and not (summary[chosen]["role"] == Role.UNIT.value).any():
        return Shown(Role.WINDOW)
    return best_set(summary[chosen], f"{scanner}, samples {', '.join(samples)}", where)
