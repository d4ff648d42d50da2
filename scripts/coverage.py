"""Compare stated standard deviations with true errors in the simulated world."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from velocal.adjustment.solvers import GaussHelmert, PaperModel, WithPrior
from velocal.io import storage
from velocal.io.scripts import run
from velocal.simulation import world
from velocal.simulation.coverage import (
    cramer_rao,
    observable_only,
    of_unit,
    outcome,
    summary,
    white_only,
)
from velocal.simulation.draws import full_draws, geometry, white_draws
from velocal.study.adjustment import Adjustment

#: Position of each scanner, and the step from one simulated laser to the next.
POSITIONS, EVERY = {"HDL-64E": "P2", "HDL-32E": "P5"}, {"HDL-64E": 5, "HDL-32E": 3}
SEED = 1


def main(
    *,
    world_file: Path,
    coverage: Path,
    adjustment: Mapping[str, Adjustment],
    runs: int,
) -> None:
    """Write errors, stated standard deviations and coverage by case, scanner and parameter."""
    simulated, rows = world.read(world_file), []
    for scanner in [name for name in POSITIONS if name in adjustment]:
        names = adjustment[scanner].parameters
        config = adjustment[scanner].stochastic()
        white = white_only(config)
        at = geometry(simulated, scanner, POSITIONS[scanner], every=EVERY[scanner])
        # The data of most lasers do not separate v from dl: these are checked without v.
        for some in (names, tuple(name for name in names if name != "v")):
            seen = observable_only(at, white, some)
            bound = cramer_rao(seen, white, some)
            draws = white_draws(seen, white, some, 8 * runs, SEED)
            found = summary(outcome(draws, seen, some, GaussHelmert(), white), bound)
            case = {"case": f"white: {' '.join(some)}", "scanner": scanner}
            rows += [case | {"method": "gauss_helmert"} | row for row in found]
        every = list(full_draws(at, config, names, runs, SEED))
        for kind, model, method, solver, n in (
            ("unit", of_unit(config, at.errors), "prior", WithPrior(), runs),
            ("unit", of_unit(config, at.errors), "paper", PaperModel(truncate_at=1.0), runs // 4),
            ("configured", config, "prior", WithPrior(), runs // 4),
        ):
            case = {"case": f"full: sizes {kind}", "scanner": scanner, "method": method}
            rows += [case | row for row in summary(outcome(every[:n], at, names, solver, model))]
    storage.write_csv(coverage, pd.DataFrame(rows).round(7))


if "snakemake" in globals():
    run(main, snakemake)
