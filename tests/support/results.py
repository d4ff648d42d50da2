"""Made-up statistics of a study like the paper's."""

import numpy as np
import pandas as pd

from velocal.evaluation.candidates import Role
from velocal.evaluation.statistics import statistics_columns, summary_row
from velocal.study.figures import Table
from velocal.study.windows import WINDOWS

SAMPLES = {"HDL-64E": ("sa1", "sa2", "sa3", "sa4"), "HDL-32E": ("sa5", "sa6")}
SETS = {"HDL-64E": ("set1", "set2", "set3"), "HDL-32E": ("set1",)}
N_LASERS = {"HDL-64E": 64, "HDL-32E": 32}
#: Standard deviation of s in cm; set2 is the best of the HDL-64E.
STD_CM = {"set1": 2.2, "set2": 1.9, "set3": 2.0}
#: The same of the factory's calibration and of the adjustment of the window itself.
STD_CM_OF_ROLE = {Role.FACTORY: 3.5, Role.WINDOW: 1.2}

TABLES = {
    "2": Table(scanner="HDL-64E", samples=["sa3", "sa4"], data="calibration"),
    "3": Table(scanner="HDL-32E", samples=["sa5"], data="calibration"),
    "4": Table(scanner="HDL-64E", samples=["sa1", "sa2", "sa3", "sa4"], data="validation"),
    "5": Table(scanner="HDL-32E", samples=["sa5", "sa6"], data="validation"),
}


def statistics() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Statistics of all lasers and of all windows; laser 7 of each scanner hits nothing."""
    random = np.random.default_rng(5)
    parts, rows = [], []
    for scanner, samples in SAMPLES.items():
        factory, window = ((role, "", std) for role, std in STD_CM_OF_ROLE.items())
        sets = [(Role.SET, name, STD_CM[name]) for name in SETS[scanner]]
        calibrations = {"calibration": [factory, window], "validation": [factory, *sets]}
        for data, candidates in calibrations.items():
            for sample in samples:
                for window in WINDOWS:
                    heading = {"scanner": scanner, "sample": sample, "window": window, "data": data}
                    heading |= {"rotations_from": "outside" if data == "validation" else "window"}
                    lasers = _lasers(random, N_LASERS[scanner])
                    for role, name, std_cm in candidates:
                        own = heading | {"role": role.value, "parameter_set": name}
                        s = random.normal(0.0, std_cm * 1e-2, len(lasers))
                        phi = np.linspace(0.0, 6.0, len(lasers))
                        table = statistics_columns(own, s, lasers, N_LASERS[scanner], 0.02, phi)
                        parts.append(pd.DataFrame(table))
                        rows.append({**own, **summary_row(table)})
    return pd.concat(parts, ignore_index=True), pd.DataFrame(rows)


def _lasers(random: np.random.Generator, n_lasers: int) -> np.ndarray:
    """Lasers of the residuals of a window, more or fewer of them in each."""
    return np.repeat(np.delete(np.arange(n_lasers), 6), random.integers(20, 30))
