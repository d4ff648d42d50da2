"""The whole chain as functions: simulated packets in, adjustments out."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import yaml

from velocal.adjustment.lasers import adjust_all
from velocal.adjustment.observations import Observations
from velocal.adjustment.result import Adjustment
from velocal.adjustment.solvers import Solver
from velocal.adjustment.stochastic import Stochastic
from velocal.io import schemas, storage
from velocal.recording.returns import write_returns
from velocal.recording.scan import inspect
from velocal.reduction.assignment import Limits, assigned_rows
from velocal.reduction.medians import binned_medians
from velocal.scanner.beam import Beams
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import LaserParameters
from velocal.simulation import capture, survey, truth, world
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.station import Station

WORLD = Path(__file__).parents[2] / "config/world.yaml"
LIMITS = Limits(0.25, 0.05, 1.396)


def study_world() -> world.World:
    return world.load(yaml.safe_load(WORLD.read_text()))


@dataclass
class Loop:
    """What came out, and the truth to hold it against."""

    observations: Observations
    factory: LaserParameters
    true: LaserParameters
    adjustments: list[Adjustment]


def run(
    simulated: world.World,
    scanner: str,
    position: str,
    folder: Path,
    *,
    rotations: int,
    names: tuple[str, ...],
    planes: tuple[str, ...],
    solver: Solver,
    stochastic: Stochastic,
    from_stream: bool = False,
) -> Loop:
    """Packets -> file -> returns -> medians -> planes -> adjustments of all lasers.

    The factory's calibration is that of the world, or what the recording's status bytes hold of it.
    """
    recording, parquet = folder / "recording.bin", folder / "returns.parquet"
    with recording.open("wb") as file:
        for block in capture.records(simulated, scanner, position, "loop", rotations):
            file.write(block)
    known = SCANNERS[scanner]
    inspection = inspect(recording)
    index = inspection.index
    chosen = np.flatnonzero(index.complete)
    write_returns(recording, index, chosen, known, parquet)
    columns, facts = storage.read_table(parquet, schemas.RETURNS)
    medians = binned_medians(
        columns["azimuth"],
        columns["laser_id"],
        columns["distance"],
        lasers_per_firing=known.lasers_per_firing,
        bin_ticks=known.azimuth_bin_ticks,
        min_count=3,
    )
    surveyed = adjust_field_book(survey.field_book(simulated))
    station = Station.adjust(
        surveyed.planes,
        surveyed.base_scanner[scanner].targets,
        surveyed.base_site[position],
        planes,
        where="loop",
    )
    factory = truth.factory_parameters(simulated, scanner)
    if from_stream:
        factory = inspection.status.calibration(str(recording))
    beams = Beams.from_ticks(asdict(medians), known, facts["rotation_rate_hz"])
    rows = assigned_rows(beams, factory, station.patches, LIMITS)
    data = station.observations(rows)
    return Loop(
        data,
        factory,
        truth.unit_truth(simulated, scanner).parameters,
        adjust_all(data, factory, names, solver, stochastic),
    )
