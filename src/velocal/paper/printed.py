"""The paper's printed numbers: its tables, the numbers in its text, and their tolerances.

The paper is Zalud, Kocmanova, Burian, Jilek, Kalvoda, Kopecny, "Effective Calibration and
Evaluation of Parameters in a 3D Proximity Rotating Scanner" (Elektronika ir Elektrotechnika,
2015). ``data/tables.csv`` holds Tables II to V as printed, ``data/statements.csv`` the numbers in
its text, each with a tolerance of its own, ``data/claims.csv`` what it says without a number of a
table.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

_FOLDER = Path(__file__).parent / "data"
TABLES, STATEMENTS = _FOLDER / "tables.csv", _FOLDER / "statements.csv"
KNOWN_MISSES = _FOLDER / "known_misses.csv"
CLAIMS, OUTDOOR_SEEDS = _FOLDER / "claims.csv", _FOLDER / "outdoor_seeds.csv"

#: What the item of a statement begins with in the agreement.
PREFIX = "text "

#: Columns that say which row of which table it is.
LABELS = ("table", "scanner", "sample", "window", "calibration")

#: Quantities of a table, and how far a reproduced one may be from the printed one: some three
#: seeds' standard deviations of the simulated world for std, less for the shares.
TOLERANCES = {"std_cm": 0.3, "within_1sigma_pct": 6.0, "within_3sigma_pct": 2.5}

#: How far the mean over many seeds may be from the printed one.
TOLERANCES_OF_MEAN = {"std_cm": 0.15, "within_1sigma_pct": 4.0, "within_3sigma_pct": 1.5}

#: Data behind each table: medians that were adjusted on, or single scans.
DATA = {"II": "calibration", "III": "calibration", "IV": "validation", "V": "validation"}

#: Samples behind labels that contradict the paper's own list of samples, by table, calibration
#: and printed label. Table III calls its only sample sa5 before and sa6 after; sa5 is the one that
#: was calibrated on. Table V labels the rows of the HDL-32E sc3, sa3, sa4, of which sa3 and sa4
#: are samples of the HDL-64E; its samples are sa5 and sa6, and the paper does not say in which
#: order: sa5 first is assumed. Labels that are not here stand for themselves.
READING = {
    ("III", "before", "sa5"): "sa5",
    ("III", "after", "sa6"): "sa5",
    ("V", "before", "sc3"): "sa5",
    ("V", "before", "sa3"): "sa5",
    ("V", "before", "sa4"): "sa6",
    ("V", "after", "sa3"): "sa5",
    ("V", "after", "sa4"): "sa6",
}

#: Printed entries that contradict the rest of the paper, by item. They are kept as printed and
#: judged like all others.
CONTRADICTIONS = {
    "II HDL-64E sa3 beginning after within_1sigma_pct": (
        "67.4 % within 1 sigma cannot stand beside a standard deviation about zero of 1.2 cm. "
        "Either the deviation is about an offset of some 1.5 cm (a scanner warming up), or it is "
        "a misprint of 87.4 %."
    ),
    "III HDL-32E sa5 end before std_cm": (
        "3.4 cm stands beside shares of residuals that fit 2.3 to 2.4 cm: 48.5 % within 1 sigma "
        "and all within 3 sigma, as in the rows above it. A misprint of 2.3 or 2.4 is likely."
    ),
}


@dataclass(frozen=True)
class PrintedRow:
    """A row of the paper's Tables II to V.

    Attributes
    ----------
    table, scanner, sample, window, calibration : str
        As printed; `calibration` is "before" or "after".
    values : dict of str to float
        By quantity, see `TOLERANCES`.
    """

    table: str
    scanner: str
    sample: str
    window: str
    calibration: str
    values: dict[str, float]

    @property
    def reproduced_sample(self) -> str:
        """Sample that the label is read as."""
        return READING.get((self.table, self.calibration, self.sample), self.sample)

    @property
    def key(self) -> tuple[str, ...]:
        """Where the reproduced row is found: its `LABELS`."""
        return self.table, self.scanner, self.reproduced_sample, self.window, self.calibration

    def item(self, quantity: str) -> str:
        """Name of a cell, as in "II HDL-64E sa3 beginning before std_cm"."""
        return (
            f"{self.table} {self.scanner} {self.sample} {self.window} {self.calibration} {quantity}"
        )


def printed_rows() -> list[PrintedRow]:
    """Tables II to V as printed, row by row."""
    rows = pd.read_csv(TABLES)[[*LABELS, *TOLERANCES]].itertuples(index=False)
    return [
        PrintedRow(
            table, scanner, sample, window, label, dict(zip(TOLERANCES, values, strict=True))
        )
        for table, scanner, sample, window, label, *values in rows
    ]


def printed_statements() -> pd.DataFrame:
    """Statements as printed: item, what, where, paper, unit, tolerance, tolerance_of_mean."""
    return pd.read_csv(STATEMENTS, comment="#")


def known_misses(path: Path = KNOWN_MISSES, rotations: int | None = None) -> dict[str, str]:
    """Items of the study (seed 2015) that are known to be missed, each with the reason.

    Parameters
    ----------
    path : Path
        CSV with the columns item, rotations and reason. A row with a number of rotations is for
        simulated recordings of this length only: windows of other recordings have other noise, and
        an item near its tolerance may be within it.
    rotations : int, optional
        Rotations of the simulated recordings; without it all rows are meant.

    Returns
    -------
    dict of str to str
        Reasons by item.
    """
    rows = pd.read_csv(path, dtype={"rotations": "Int64"})
    if rotations is not None:
        rows = rows[rows["rotations"].isna() | (rows["rotations"] == rotations).fillna(False)]
    return dict(zip(rows["item"], rows["reason"], strict=True))


def printed_claims() -> pd.DataFrame:
    """Claims of the paper that no table answers: item, where, claim (in our words)."""
    return pd.read_csv(CLAIMS)


def outdoor_seeds() -> pd.DataFrame:
    """Outdoor samples of seeds of the simulated world, before and after.

    Columns kind, scanner, sample, distance_m, before_cm, after_cm and seed; made by
    ``benchmarks/outdoor_seeds.py``.
    """
    return pd.read_csv(OUTDOOR_SEEDS)


def tolerances_of_mean() -> dict[str, float]:
    """By item of the agreement, how far the mean over many seeds may be from the printed one."""
    rows = printed_statements()
    cells = {
        row.item(quantity): tolerance
        for row in printed_rows()
        for quantity, tolerance in TOLERANCES_OF_MEAN.items()
    }
    return cells | {
        PREFIX + str(item): float(tolerance)
        for item, tolerance in zip(rows["item"], rows["tolerance_of_mean"], strict=True)
    }
