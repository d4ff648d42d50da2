"""Numbers of the tiny study that are frozen in tests/golden, and how a run differs from them."""

import shutil
from pathlib import Path

import pandas as pd

from velocal.evaluation.statistics import KEYS

GOLDEN = Path(__file__).parents[1] / "golden/tiny_study"

#: Frozen files, below the results and below `GOLDEN`.
FILES = (
    "statistics/summary.csv",
    "tables/table_2.csv",
    "tables/table_5.csv",
    "parameter_sets/HDL-64E/set1.csv",
    "parameter_sets/HDL-32E/set1.csv",
)

#: Largest differences between machines, whose packages may round in another way, by column. In a
#: table the last digit that is shown may change too. Other columns are not compared.
ROUNDING = {"rms_cm": 2e-3, "pooled_rms_cm": 2e-3, "complies_zero": 1, "complies_mean": 1}
ROUNDING |= {"complies_correlated": 1, "complies_holm": 1}
ROUNDING |= {"within_1sigma_pct": 0.2, "within_3sigma_pct": 0.2, "count": 3, "std_cm": 2e-3}
ROUNDING |= {"dl_m": 1e-5, "alpha_rad": 1e-6, "v_rad": 1e-6}
ROUNDING |= {"dl_std_m": 1e-5, "alpha_std_rad": 1e-6, "v_std_rad": 1e-6}
LAST_DIGIT = {"std_cm": 0.011}

#: Columns that say what a row is about, and have to be equal.
LABELS = (*KEYS, "table", "calibration", "laser_id")


def _read(path: Path) -> pd.DataFrame:
    table = pd.read_csv(path, keep_default_na=False)
    return table.set_index([name for name in LABELS if name in table]).sort_index()


def differences(name: str, results: Path) -> list[str]:
    """One line per column of a file that is not as frozen, with its largest difference."""
    frozen, found = _read(GOLDEN / name), _read(results / name)
    if not found.index.equals(frozen.index):
        return [f"{name}: other rows than the frozen ones"]
    lines = []
    for column in frozen.columns.intersection(list(ROUNDING)):
        allowed = (LAST_DIGIT if name.startswith("tables/") else {}).get(column, ROUNDING[column])
        old, new = frozen[column].astype(float), found[column].astype(float)
        off = ~((new - old).abs() <= allowed)  # NaN is a difference
        if off.any():
            row = (new - old).abs().idxmax()
            lines.append(
                f"{name}: {column} differs in {off.sum()} of {len(off)} rows; "
                f"{row}: frozen {old[row]:.6g}, found {new[row]:.6g}"
            )
    return lines


def freeze(results: Path) -> None:
    """Make the numbers of a run the frozen ones."""
    for name in FILES:
        (GOLDEN / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(results / name, GOLDEN / name)
