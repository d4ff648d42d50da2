"""The whole study in memory, for many seeds: the same functions as the workflow, fewer rotations.

Recordings still go through their bytes, in a file that is removed again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from velocal.adjustment.average import Member, average
from velocal.chain import adjust, observe
from velocal.evaluation.candidates import Candidate, Role, with_sets
from velocal.evaluation.statistics import ROTATIONS_FROM, statistics_table
from velocal.io import storage
from velocal.paper import agreement as comparison
from velocal.paper import tables
from velocal.paper.printed import tolerances_of_mean
from velocal.recording.recording import open_recording
from velocal.recording.returns import Returns
from velocal.recording.windows import single_rotations
from velocal.scanner.parameters import LaserParameters
from velocal.simulation import capture
from velocal.simulation.survey import field_book
from velocal.simulation.truth import factory_parameters
from velocal.simulation.world import World
from velocal.study.samples import SurveyedSample
from velocal.study.study import Study
from velocal.survey.network.survey import Survey, adjust_field_book


def lasers(world: World, study: Study, rotations: int) -> pd.DataFrame:
    """Statistics of every laser, before and after, as the workflow's `statistics/lasers.csv`.

    Parameters
    ----------
    world : World
        Its seed is the replica's.
    study : Study
        Samples, parameter sets and settings.
    rotations : int
        Rotations of a window; the configuration's are not used.

    Returns
    -------
    DataFrame
        Columns of `statistics_table`.
    """
    parts: list[pd.DataFrame] = []
    survey = adjust_field_book(field_book(world))
    for scanner in study.scanners:
        parts += _of_scanner(world, study, survey, scanner, rotations)
    return pd.concat(parts, ignore_index=True)


def agreement(world: World, study: Study, rotations: int) -> pd.DataFrame:
    """Entries of the tables and the statements that follow from them, beside the printed ones.

    Parameters
    ----------
    world, study, rotations
        As for `lasers`.

    Returns
    -------
    DataFrame
        Columns of `paper.agreement`.
    """
    summary = tables.summarised(lasers(world, study, rotations))
    every = pd.concat(
        [
            tables.formatted(tables.build(number, table, summary, simulated=True).frame)
            for number, table in study.config.tables.items()
        ]
    )
    shown = comparison.statistics_shown(summary, every)
    said = comparison.of_statements(comparison.said_by_tables(shown), partial=True)
    return pd.concat([comparison.of_cells(shown), said], ignore_index=True)


def spread(replicas: Mapping[int, pd.DataFrame]) -> pd.DataFrame:
    """Mean and standard deviation of every entry over seeds, beside the printed one.

    Parameters
    ----------
    replicas : mapping of int to DataFrame
        By seed, as `agreement` gives them.

    Returns
    -------
    DataFrame
        Columns item, paper, mean, std, minimum, maximum, seeds, difference (of the mean),
        tolerance (of the mean), within.
    """
    values = pd.DataFrame({s: each.set_index("item")["reproduced"] for s, each in replicas.items()})
    first = next(iter(replicas.values())).set_index("item").loc[values.index]
    tolerance = np.array([tolerances_of_mean()[item] for item in values.index])
    mean = values.mean(axis=1)
    difference = (mean - first["paper"]).round(3)
    return pd.DataFrame(
        {
            "item": values.index,
            "paper": first["paper"].to_numpy(),
            "mean": mean.round(3).to_numpy(),
            "std": values.std(axis=1).round(3).to_numpy(),
            "minimum": values.min(axis=1).to_numpy(),
            "maximum": values.max(axis=1).to_numpy(),
            "seeds": values.shape[1],
            "difference": difference.to_numpy(),
            "tolerance": tolerance,
            "within": np.where(difference.abs() <= tolerance, "true", "false"),
        }
    )


def _of_scanner(
    world: World, study: Study, survey: Survey, scanner: str, rotations: int
) -> Iterator[pd.DataFrame]:
    factory = factory_parameters(world, scanner)
    limits = study.assignment.limits.metric()
    sigma_m = study.sigma_cm(scanner) * 1e-2
    bin_deg = study.config.reduction.azimuth_bin_deg.get(scanner)
    adjustments: dict[str, list[Member]] = {}
    scans = {}
    at: dict[str, capture.Shots] = {}
    for sample in [s for s in study.surveyed.values() if s.scanner == scanner]:
        position = sample.position
        if position not in at:
            at = {position: capture.shots_at(world, scanner, position)}
        station = survey.station(scanner, position, study.assignment.planes, where="replica")
        for window, returns, single, origin in _windows(
            world, sample, rotations, study.validation.rotations, at[position]
        ):
            heading = {"scanner": scanner, "sample": sample.name, "window": window}
            # A bin may hold a single return, as there are fewer rotations.
            medians = returns.medians(azimuth_bin_deg=bin_deg, min_count=1)
            data = observe(medians, station, factory, limits)
            found = adjust(data, factory, study.adjustment(scanner), [station.uncertainty()])
            adjustments.setdefault(sample.name, []).append(Member(sample.name, position, found))
            pair = [Candidate(Role.FACTORY, factory), Candidate(Role.WINDOW, found.adjusted)]
            heading |= {"data": "calibration", ROTATIONS_FROM: "window"}
            yield pd.DataFrame(statistics_table(heading, pair, data, sigma_m))
            scans[sample.name, window] = observe(single.beams(), station, factory, limits), origin
    sets = _sets(study, scanner, factory, adjustments)
    for (name, window), (data, origin) in scans.items():
        heading = {"scanner": scanner, "sample": name, "window": window, "data": "validation"}
        heading |= {ROTATIONS_FROM: origin}
        yield pd.DataFrame(statistics_table(heading, with_sets(factory, sets), data, sigma_m))


def _sets(
    study: Study,
    scanner: str,
    factory: LaserParameters,
    adjustments: dict[str, list[Member]],
) -> dict[str, LaserParameters]:
    weights = study.average
    sets = {}
    for name, samples in study.parameter_sets[scanner].items():
        members = [member for sample in samples for member in adjustments[sample]]
        sets[name] = average(members, weights).adjusted
    return sets


def _windows(
    world: World, sample: SurveyedSample, rotations: int, singles: int, shots: capture.Shots
) -> Iterator[tuple[str, Returns, Returns, str]]:
    """Returns of every window and of its single rotations, decoded from a recording."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "recording.bin"
        # Some rotations lie between the windows, as in the study's recordings.
        length = 3 * rotations + rotations // 3 + 2
        blocks = capture.records(
            world, sample.scanner, sample.position, sample.name, length, shots=shots
        )
        storage.write_blocks(path, blocks)
        recording = open_recording(path, sample.scanner)
        for window in sample.windows:
            chosen = single_rotations(recording.rotations, window, rotations, singles, str(path))
            rate_hz = recording.rotations.rate_hz()
            single = replace(recording.returns(chosen.numbers), rotation_rate_hz=rate_hz)
            yield window, recording.returns(window, length=rotations), single, chosen.origin
