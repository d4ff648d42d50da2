"""Time of the adjustment of all lasers of a window against reading the window's files.

Usage: python benchmarks/adjustment.py [results] [sample] [window]
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import yaml

from velocal.adjustment.lasers import adjust_all
from velocal.io import schemas, storage
from velocal.simulation import truth, world
from velocal.study.adjustment import Adjustments
from velocal.survey.station import read_station

ROOT = Path(__file__).parents[1]


def main(results: Path, sample: str, window: str, position: str = "P2") -> None:
    """Print best times of several rounds, in turn, and their ratios."""
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text())["adjustment"]
    simulated = world.load(yaml.safe_load((ROOT / "config/world.yaml").read_text()))
    factory = truth.factory_parameters(simulated, "HDL-64E")
    station = read_station(results / f"survey/{position}.json")

    def read(kind: str, schema: object) -> Callable[[], object]:
        path = results / kind / sample / f"{window}.parquet"
        return lambda: storage.read_table(path, schema)

    columns, _ = storage.read_table(
        results / f"assigned/{sample}/{window}.parquet", schemas.ASSIGNED
    )
    data = station.observations(columns)

    def adjust(method: str) -> Callable[[], object]:
        chosen = Adjustments.model_validate(config | {"method": method})
        model = chosen.stochastic([station.uncertainty()])
        names, solver = chosen.parameters, chosen.solver()
        return lambda: adjust_all(data, factory, names, solver, model)

    work = {
        "read returns": read("returns", schemas.RETURNS),
        "read medians": read("medians", schemas.MEDIANS),
        "read assigned": read("assigned", schemas.ASSIGNED),
        "adjust, prior": adjust("prior"),
        "adjust, paper": adjust("paper"),
    }
    clocks = (time.perf_counter, time.process_time)
    best = {name: [float("inf")] * len(clocks) for name in work}
    for _ in range(7):
        for name, task in work.items():
            start = [clock() for clock in clocks]
            task()
            took = [clock() - then for clock, then in zip(clocks, start, strict=True)]
            best[name] = [min(pair) for pair in zip(best[name], took, strict=True)]
    print(f"{len(data.phi)} medians of {sample}, {window}; times, and shares of reading returns")
    whole, whole_cpu = best["read returns"]
    for name, (took, cpu) in best.items():
        print(
            f"{name:14} {took:8.4f} s {took / whole:6.3f}   "
            f"of all cores together {cpu:8.4f} s {cpu / whole_cpu:6.3f}"
        )


if __name__ == "__main__":
    arguments = sys.argv[1:]
    main(
        Path(arguments[0]) if arguments else ROOT / "results",
        arguments[1] if len(arguments) > 1 else "sa4",
        arguments[2] if len(arguments) > 2 else "middle",
    )
