"""Size and power of the variance tests for correlated residuals: the tables of docs/model.md.

Usage: python benchmarks/variance_test.py [--write]

Residuals are drawn at the azimuths of the study's medians, and of a single rotation. It takes about
ten minutes; --write puts the tables into the document.
"""

import re
import sys
from pathlib import Path

import numpy as np

from velocal.evaluation.statistics import ALPHA, laser_statistics
from velocal.evaluation.variance_test import correlated_variance_test, holm
from velocal.io.markup import markdown_table
from velocal.simulation import draws, world
from velocal.simulation.patterns import Residuals

ROOT = Path(__file__).parents[1]
DOC = ROOT / "docs/model.md"
BEGIN = "<!-- numbers: variance_test (made by python benchmarks/variance_test.py --write) -->"
END = "<!-- end -->"
SIGMA_M, RUNS = 0.02, 200
#: Scanner, position and step of azimuth in degrees; what it is like.
PLACES = {
    "HDL-64E, P2, medians": ("HDL-64E", "P2", 0.09),
    "HDL-64E, P1, medians": ("HDL-64E", "P1", 0.09),
    "HDL-32E, P5, medians": ("HDL-32E", "P5", 0.1),
    "HDL-64E, P2, one rotation": ("HDL-64E", "P2", 0.17),
}
FIRST = next(iter(PLACES))
WORLD = Residuals(kind="smooth", length_deg=0.5)
SIZES = [
    *(
        (FIRST, Residuals(kind="smooth", length_deg=length))
        for length in (0.25, 0.5, 1.0, 2.0, 4.0)
    ),
    *((FIRST, Residuals(kind="rough", length_deg=length)) for length in (0.5, 1.75, 4.0)),
    (FIRST, Residuals(kind="smooth", length_deg=0.5, white=0.5)),
    (FIRST, Residuals(kind="smooth", length_deg=0.5, white=1.0)),
    (FIRST, Residuals(kind="smooth", length_deg=4.0, white=0.5)),
    (FIRST, Residuals(kind="smooth", length_deg=0.5, shift=0.5)),
    (FIRST, Residuals(kind="rough", length_deg=4.0, shift=0.5)),
    *((place, WORLD) for place in list(PLACES)[1:3]),
    *((place, Residuals(kind="smooth", length_deg=2.0)) for place in list(PLACES)[1:3]),
    ("HDL-64E, P2, one rotation", Residuals(kind="smooth", length_deg=0.5, white=0.7)),
]
RMS_CM = (1.8, 1.7, 1.6, 1.4, 1.2, 1.0)
#: Lengths (degrees) of the lasers of a scanner that has all of them.
MIXED = (0.25, 0.5, 1.0, 2.0, 4.0)
POWERS = [WORLD, Residuals(kind="smooth", length_deg=2.0), Residuals(kind="rough", length_deg=1.75)]


def shares(at: draws.Geometry, population: Residuals, rms_m: float, runs: int) -> list[float]:
    """Per cent of lasers that pass, and of runs in which any laser passes with Holm's method.

    Returns
    -------
    list of float
        By the paper's test, by that for correlated residuals, and by Holm's method; per cent of
        runs; median of the effective number of residuals.
    """
    n_lasers = len(at.factory)
    seen = np.bincount(at.laser_id, minlength=n_lasers) > 0
    rng = np.random.default_rng(2015)
    passed, any_laser, effective = [], [], []
    for _ in range(runs):
        s = rms_m * population.draw(rng, at.phi, at.laser_id, n_lasers)
        paper = laser_statistics(s, at.laser_id, n_lasers, SIGMA_M).complies_zero
        test = correlated_variance_test(s, at.phi, at.laser_id, n_lasers, SIGMA_M)
        together = holm(test.p, ALPHA)
        passed.append([paper[seen], test.p[seen] < ALPHA, together[seen]])
        any_laser.append(together.any())
        effective.append(np.nanmedian(test.effective_count))
    of_lasers = 100.0 * np.mean(passed, axis=(0, 2))
    return [*of_lasers, 100.0 * float(np.mean(any_laser)), float(np.median(effective))]


def mixed(at: draws.Geometry) -> str:
    """Size of the test where lasers are correlated over different lengths, in a sentence."""
    n_lasers = len(at.factory)
    rng = np.random.default_rng(2015)
    own = np.arange(n_lasers) % len(MIXED)
    passed = []
    for _ in range(RUNS // 2):
        drawn = [
            Residuals(kind="smooth", length_deg=k).draw(rng, at.phi, at.laser_id, n_lasers)
            for k in MIXED
        ]
        s = SIGMA_M * np.choose(own[at.laser_id], drawn)
        test = correlated_variance_test(s, at.phi, at.laser_id, n_lasers, SIGMA_M)
        passed.append(test.p < ALPHA)
    of_laser = 100.0 * np.mean(passed, axis=0)
    by_length = ", ".join(f"{of_laser[own == i].mean():.1f}" for i in range(len(MIXED)))
    lengths = ", ".join(f"{k:g}" for k in MIXED)
    return (
        f"If the lasers of one scanner have the lengths {lengths} deg, {by_length} % of them pass, "
        f"and {of_laser.mean():.1f} % of all ({FIRST}, {RUNS // 2} runs)."
    )


def described(population: Residuals) -> list[str]:
    """Cells of a population."""
    kind = {"smooth": "exp(-d²/4k²)", "rough": "exp(-d/k)"}[population.kind]
    if population.white == 1.0:
        kind = "none"
    return [kind, f"{population.length_deg:g}", f"{population.white:g}", f"{population.shift:g}"]


def main() -> None:
    """Print the tables, or write them into the document."""
    simulated = world.read(ROOT / "config/world.yaml")
    at = {
        name: draws.geometry(simulated, scanner, position, step_deg=step)
        for name, (scanner, position, step) in PLACES.items()
    }
    rows = []
    for place, population in SIZES:
        paper, alone, _, any_laser, effective = shares(at[place], population, SIGMA_M, RUNS)
        n = np.bincount(at[place].laser_id)
        numbers = [f"{np.median(n):.0f}", f"{effective:.0f}", f"{paper:.1f}", f"{alone:.1f}"]
        rows.append([place, *described(population), *numbers, f"{any_laser:.1f}"])
    head = ["residuals", "correlation", "k (deg)", "noise", "shift", "n", "effective n"]
    head += ["paper's test", "correlated", "any laser, Holm"]
    tables = [markdown_table(head, rows, [False, False, *[True] * 8])]
    rows = []
    for population in POWERS:
        for rms_cm in RMS_CM:
            found = shares(at[FIRST], population, rms_cm * 1e-2, RUNS // 10)
            rows.append(
                [*described(population)[:2], f"{rms_cm:g}", *(f"{v:.0f}" for v in found[:3])]
            )
    head = ["correlation", "k (deg)", "true rms (cm)", "paper's test", "correlated", "Holm"]
    tables.append(markdown_table(head, rows, [False, *[True] * 5]))
    counts = (
        f"Size: per cent of lasers that pass although their true rms is {SIGMA_M * 1e2:g} cm "
        f"({RUNS} runs of all lasers); last column: per cent of runs in which any laser passes."
    )
    power = f"Power: per cent of lasers that pass ({FIRST}, {RUNS // 10} runs)."
    text = "\n".join([counts, "", *tables[0], "", mixed(at[FIRST]), "", power, "", *tables[1]])
    print(text)
    if "--write" in sys.argv[1:]:
        page = DOC.read_text(encoding="utf-8")
        block = f"{BEGIN}\n\n{text}\n\n{END}"
        found = re.sub(f"{re.escape(BEGIN)}.*?{re.escape(END)}", lambda _: block, page, flags=re.S)
        DOC.write_text(found, encoding="utf-8")


if __name__ == "__main__":
    main()
