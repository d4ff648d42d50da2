"""Fit constants of drifts, shifts and distance errors to the printed tables, over many seeds.

These constants of the simulated world add one distance to all shots of a laser in a window. The
chain of the study therefore runs once for every seed, and for other constants the residuals are
only shifted: before a calibration by the added distance, and after it by the part that the
parameter set does not contain. This is quick enough to fit means over many seeds. A check with
one seed gave the same entries as the whole chain within 0.006 cm, 0.4 and 0.2 %.

The tuned constants are those of `tuned` in the world file that act in this way. Use seeds that
`make seeds` does not use, so that its means judge the constants. The world file is not changed.

Usage: python benchmarks/tune_drifts.py [first seed] [number of seeds]      (default 101 14)
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.optimize import least_squares

from velocal.adjustment.lasers import adjust_all
from velocal.chain import observe
from velocal.io.storage import write_blocks
from velocal.paper.printed import CONTRADICTIONS, TOLERANCES, TOLERANCES_OF_MEAN, printed_rows
from velocal.paper.tuning import value_at, with_values
from velocal.recording.recording import open_recording
from velocal.simulation import capture, truth, world
from velocal.simulation.survey import field_book
from velocal.study.reading import read_yaml
from velocal.study.samples import WINDOWS
from velocal.study.study import read_study
from velocal.survey.network.survey import adjust_field_book

SCANNER = "HDL-64E"
ROTATIONS = 12
#: Constants that a shift of the residuals cannot show.
OTHER = ("pattern", "noise")
#: One of this number of medians is used.
EVERY = 4
#: Steps of the fit, as shares of a constant; constants near zero move by tenths of their unit.
STEP = 0.1

STUDY = read_study(read_yaml(Path("config/config.yaml")), "config/config.yaml")
SAMPLES = {name: each for name, each in STUDY.surveyed.items() if each.scanner == SCANNER}
SETS = STUDY.parameter_sets[SCANNER]
ROWS = [row for row in printed_rows() if row.scanner == SCANNER]
ITEMS = [
    (row, quantity)
    for row in ROWS
    for quantity in TOLERANCES
    if row.item(quantity) not in CONTRADICTIONS
]


@dataclass(frozen=True)
class Residuals:
    """Residuals of a window with one calibration, of medians or of a single scan."""

    sample: str
    window: str
    calibration: str  # "before", "after", or the name of a set
    medians: bool
    s_m: np.ndarray
    per_m: np.ndarray  # change of s with the distance
    laser: np.ndarray

    def statistics(self, added_m: np.ndarray) -> tuple[float, ...]:
        """Mean over lasers of the root mean square (cm), shares within 2 and 6 cm (percent)."""
        s = (self.s_m + self.per_m * added_m[self.laser]) * 1e2
        count = np.bincount(self.laser, minlength=len(added_m))
        square = np.bincount(self.laser, s * s, minlength=len(added_m))
        seen = count > 0
        within = [100.0 * float(np.mean(np.abs(s) < limit)) for limit in (2.0, 6.0)]
        return float(np.mean(np.sqrt(square[seen] / count[seen]))), *within


def residuals(simulated: world.World) -> Iterator[Residuals]:
    """Run the chain of the study for one seed."""
    factory = truth.factory_parameters(simulated, SCANNER)
    survey = adjust_field_book(field_book(simulated))
    limits, settings = STUDY.assignment.limits.metric(), STUDY.adjustment(SCANNER)
    # Only corrections are of interest: what covariances need is left out.
    stochastic = replace(settings.stochastic(), block_rad=None, repeatability_m=0.0)
    corrections, scans, shots = {}, {}, {}

    def of(data, parameters, *names, medians):
        s = data.misclosure(parameters)
        moved = replace(data, distance_m=data.distance_m + 1e-3).misclosure(parameters)
        return Residuals(*names, medians, s, (moved - s) / 1e-3, data.laser_id)

    for name, sample in SAMPLES.items():
        if sample.position not in shots:
            shots = {sample.position: capture.shots_at(simulated, SCANNER, sample.position)}
        station = survey.station(SCANNER, sample.position, STUDY.assignment.planes, where=name)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "recording.bin"
            blocks = capture.records(
                simulated, SCANNER, sample.position, name, 3 * ROTATIONS + 6, shots[sample.position]
            )
            write_blocks(path, blocks)
            recording = open_recording(path, SCANNER)
            for window in WINDOWS:
                returns = recording.returns(window, length=ROTATIONS)
                bins = STUDY.config.reduction.azimuth_bin_deg[SCANNER]
                medians = returns.medians(azimuth_bin_deg=bins, min_count=1)
                data = observe(medians, station, factory, limits)
                scan = returns.beams(STUDY.validation.rotations)
                scans[name, window] = observe(scan, station, factory, limits)
                names = settings.parameters
                found = adjust_all(data, factory, names, settings.solver(), stochastic)
                values = np.array([one.corrections for one in found]).T
                corrections[name, window] = dict(zip(names, values, strict=True))
                after = factory.corrected(corrections[name, window])
                some = data.take(slice(None, None, EVERY))
                yield of(some, factory, name, window, "before", medians=True)
                yield of(some, after, name, window, "after", medians=True)
    for (name, window), scan in scans.items():
        yield of(scan, factory, name, window, "before", medians=False)
        for label, members in SETS.items():
            parts = [corrections[one, each] for one in members for each in WINDOWS]
            mean = {key: np.mean([part[key] for part in parts], axis=0) for key in parts[0]}
            yield of(scan, factory.corrected(mean), name, window, label, medians=False)


def added(simulated: world.World) -> dict[tuple[str, str, bool], np.ndarray]:
    """Distances that the constants add to the lasers, metres, for medians and for single scans."""
    errors, warmth = simulated.scanner(SCANNER).errors, simulated.warmth
    dl = truth.unit_truth(simulated, SCANNER).parameters.dl
    within = np.linspace(0.0, warmth.window_s, 20)
    found = {}
    for name, sample in SAMPLES.items():
        rng = simulated.rng("position", SCANNER, sample.position)
        shift = errors.shift_mean_cm.get(sample.position, 0.0)
        shift = (shift + rng.normal(0.0, errors.shift_cm, len(dl))) * 1e-2
        drift = truth.drift(simulated, SCANNER, name)
        for number, window in enumerate(WINDOWS):
            times = number * (warmth.duration_s - warmth.window_s) / 2.0 + within
            values = drift.at(times)
            found[name, window, True] = shift - dl + values.mean(axis=0)
            found[name, window, False] = shift - dl + values[0]
    return found


def entries(parts: list[Residuals], change: dict[tuple[str, str, bool], np.ndarray]) -> np.ndarray:
    """Entries of `ITEMS` after a change of the distances."""
    in_set = {
        label: np.mean([change[one, each, True] for one in members for each in WINDOWS], axis=0)
        for label, members in SETS.items()
    }
    found = {}
    for part in parts:
        moved = change[part.sample, part.window, part.medians]
        if part.medians and part.calibration == "after":
            moved = np.zeros_like(moved)  # its own adjustment contains it
        moved = moved - in_set.get(part.calibration, 0.0)
        key = part.medians, part.sample, part.window, part.calibration
        found[key] = part.statistics(moved)
    # As in the tables: the set of least mean.
    mean = {
        label: np.mean([found[False, s, w, label][0] for s in SAMPLES for w in WINDOWS])
        for label in SETS
    }
    best = min(SETS, key=lambda label: mean[label])
    values = []
    for row, quantity in ITEMS:
        medians = row.table == "II"
        shown = best if row.calibration == "after" and not medians else row.calibration
        numbers = found[medians, row.sample, row.window, shown]
        values.append(dict(zip(TOLERANCES, numbers, strict=True))[quantity])
    return np.array(values)


def main(first: int, count: int) -> None:
    """Print constants before and after, and the entries that are missed."""
    content = world.read(Path("config/world.yaml")).plain()
    paths = [
        path
        for path in content["tuned"]
        if not any(word in path for word in OTHER) and ("HDL-32E" not in path)
    ]
    start = np.array([value_at(content, path) for path in paths])
    scale = STEP * np.maximum(np.abs(start), 1.0)
    runs = []
    for seed in range(first, first + count):
        simulated = world.load(with_values(content, {"seed": seed}))
        runs.append((seed, list(residuals(simulated)), added(simulated)))
        print(f"seed {seed} is simulated", file=sys.stderr)
    printed = np.array([row.values[quantity] for row, quantity in ITEMS])
    tolerance = np.array([TOLERANCES_OF_MEAN[quantity] for _, quantity in ITEMS])

    def misfit(x: np.ndarray) -> np.ndarray:
        values = dict(zip(paths, (x * scale).tolist(), strict=True))
        found = []
        for seed, parts, before in runs:
            after = added(world.load(with_values(content, {**values, "seed": seed})))
            found.append(entries(parts, {key: after[key] - before[key] for key in before}))
        return (np.mean(found, axis=0) - printed) / tolerance

    def slopes(x: np.ndarray) -> np.ndarray:
        steps = np.eye(len(x))
        return np.column_stack([0.5 * (misfit(x + step) - misfit(x - step)) for step in steps])

    fitted = least_squares(misfit, start / scale, slopes, loss="soft_l1", max_nfev=6)
    for path, before, after in zip(paths, start, fitted.x * scale, strict=True):
        print(f"{path:45s} {before:8.3f} -> {after:8.3f}")
    for what, x in (("before", start / scale), ("after", fitted.x)):
        off = misfit(x)
        inside = int((np.abs(off) <= 1.0).sum())
        print(f"{what}: {inside} of {len(off)} means within, rms {np.sqrt(np.mean(off**2)):.3f}")


if __name__ == "__main__":
    given = [int(argument) for argument in sys.argv[1:]]
    main(*(given + [101, 14][len(given) :]))
