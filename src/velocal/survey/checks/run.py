"""All checks of a study: its survey files, and its recordings against them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from velocal.adjustment.stochastic import Stochastic
from velocal.arrays import joined_rows
from velocal.reduction.assignment import Limits
from velocal.scanner.beam import Beams
from velocal.scanner.models import Scanner, scanner_named
from velocal.scanner.parameters import LaserParameters
from velocal.survey.checks.cells import Cells
from velocal.survey.checks.findings import Finding
from velocal.survey.checks.hits import (
    ALLOWED,
    SHARE,
    Hits,
    PlaneHits,
    check_hits,
    explain,
    missed,
    plane_hits,
)
from velocal.survey.checks.misfit import Misfits, check_misfits, check_origin, misfits
from velocal.survey.checks.motion import check_motion
from velocal.survey.checks.planes import check_planes
from velocal.survey.checks.pose import check_finest, check_pose
from velocal.survey.station import Station
from velocal.survey.targets import Targets, common

#: How many times as many beams an explanation must put on the planes to be taken as certain.
_FAR_BETTER = 1.5
#: Largest number of medians of a window that are used; of more, every n-th.
_USED = 40_000


@dataclass(frozen=True)
class SurveyFiles:
    """What a surveyor handed over, and what was adjusted from it.

    Attributes
    ----------
    planes : Targets
        Targets of walls and floor, site frame, grouped by plane.
    base_scanner : Targets
        Targets of the bases, each in the frame of its scanner, grouped by scanner.
    base_site : dict of str to Targets
        Targets of the base in the site frame, by position.
    stations : dict of str to Station
        By position.
    where : tuple of str
        Names of the files of `planes`, `base_scanner` and `base_site`, for findings.
    """

    planes: Targets
    base_scanner: Targets
    base_site: Mapping[str, Targets]
    stations: Mapping[str, Station]
    where: tuple[str, str, str]


@dataclass(frozen=True)
class Recorded:
    """Medians of one sample.

    Attributes
    ----------
    sample, position : str
    scanner : Scanner
    factory : LaserParameters
    from_file : bool
        Whether `factory` comes from a calibration file, or is nominal.
    stochastic : Stochastic
        What the configuration knows of the errors of the lasers.
    windows : dict of str to Beams
        Medians by window, in the order of time.
    """

    sample: str
    position: str
    scanner: Scanner
    factory: LaserParameters
    from_file: bool
    stochastic: Stochastic
    windows: Mapping[str, Beams]

    @property
    def where(self) -> str:
        """Sample and position, for findings."""
        return f"sample {self.sample} at position {self.position}"


@dataclass(frozen=True)
class PlaneRow:
    """What one sample says of one plane.

    Attributes
    ----------
    sample, position : str
    seen : PlaneHits
    shift_m, shift_std_m : float
        By how much the plane lies nearer to the scanner than surveyed, by the medians, and the
        standard deviation of that from all that is known; NaN where it is not determined.
    """

    sample: str
    position: str
    seen: PlaneHits
    shift_m: float
    shift_std_m: float


@dataclass(frozen=True)
class Checked:
    """Result of all checks.

    Attributes
    ----------
    findings : tuple of Finding
    planes : tuple of PlaneRow
    """

    findings: tuple[Finding, ...]
    planes: tuple[PlaneRow, ...]


def check_study(
    survey: SurveyFiles, recorded: Sequence[Recorded], *, limits: Limits, sigma_m: float
) -> Checked:
    """Run all checks.

    Parameters
    ----------
    survey : SurveyFiles
    recorded : sequence of Recorded
    limits : Limits
        Limits of the assignment.
    sigma_m : float
        Standard deviation of a distance in the datasheet, metres.

    Returns
    -------
    Checked
    """
    found = list(_of_survey(survey, limits, sigma_m))
    rows: list[PlaneRow] = []
    windows: dict[str, list[tuple[str, Cells]]] = {}
    tested: dict[str, dict[str, Misfits]] = {}
    for each in recorded:
        station = survey.stations[each.position]
        beams = {name: _thinned(window) for name, window in each.windows.items()}
        together = joined_rows(list(beams.values()))
        hits = Hits.of(together, each.factory, station.patches, limits)
        seen = plane_hits(hits, station.patches, limits)
        of_hits = check_hits(seen, limits, each.scanner.n_lasers, each.where)
        if of_hits:
            most = missed(seen, each.scanner.n_lasers)
            of_hits = _explained(survey, each, together, of_hits, limits, most_miss=most)
        found += of_hits
        cells = Cells.of(together, hits, each.factory, station, limits)
        if not len(cells) or any(finding.severity == "error" for finding in of_hits):
            rows += [PlaneRow(each.sample, each.position, plane, np.nan, np.nan) for plane in seen]
            continue
        tests = misfits(cells, each.factory, station, each.stochastic)
        found += _nominal(each)
        found += check_misfits(
            tests, station, sigma_m,
            n_tests=len(recorded) * (len(station.planes) + 1), where=each.where,
        )  # fmt: skip
        rows += _rows(each, seen, tests)
        tested.setdefault(each.scanner.name, {}).setdefault(each.position, tests)
        for name, window in beams.items():
            own = Hits.of(window, each.factory, station.patches, limits)
            windows.setdefault(each.position, []).append(
                (
                    f"sample {each.sample}, window {name}",
                    Cells.of(window, own, each.factory, station, limits),
                )
            )
    n_windows = sum(map(len, windows.values()))
    for position, of_position in windows.items():
        found += _motion(survey.stations[position], of_position, sigma_m, n_windows)
    for name, by_position in tested.items():
        found += check_origin(
            list(by_position.values()), scanner_named(name), sigma_m, n_tests=len(tested)
        )
    found += _single_positions(recorded)
    return Checked(tuple(found), tuple(rows))


def _motion(
    station: Station, windows: Sequence[tuple[str, Cells]], sigma_m: float, n_tests: int
) -> Iterator[Finding]:
    """Changes between a window and the next at a position, in the same recording or another."""
    tick_m = scanner_named(station.scanner).distance_tick_m
    for (first, before), (second, after) in pairwise(windows):
        yield from check_motion(
            before, after, station, tick_m=tick_m, sigma_m=sigma_m,
            n_tests=n_tests,
            where=f"position {station.position}, between {first} and {second}",
        )  # fmt: skip


def _of_survey(survey: SurveyFiles, limits: Limits, sigma_m: float) -> Iterator[Finding]:
    of_planes, of_scanner, of_site = survey.where
    names = list(dict.fromkeys(p.patch.name for s in survey.stations.values() for p in s.planes))
    yield from check_finest(survey.planes, of_planes)
    yield from check_finest(survey.base_scanner, of_scanner)
    yield from check_planes(
        survey.planes, names, edge_m=limits.edge_m, sigma_m=sigma_m, where=of_planes
    )
    for position, station in survey.stations.items():
        base = survey.base_site[position].reduced(station.site_origin_m)
        yield from check_finest(base, f"{of_site}, position {position}")
        yield from check_pose(
            base,
            survey.base_scanner.of(station.scanner, where=of_scanner),
            station,
            limits=limits,
            max_range_m=scanner_named(station.scanner).max_range_m,
            sigma_m=sigma_m,
            where=f"{of_scanner} and {of_site}, position {position}",
        )


def _thinned(beams: Beams) -> Beams:
    return beams[np.arange(0, len(beams), -(-len(beams) // _USED) or 1)]


def _explained(
    survey: SurveyFiles,
    each: Recorded,
    beams: Beams,
    findings: Sequence[Finding],
    limits: Limits,
    *,
    most_miss: bool,
) -> list[Finding]:
    """Findings on the beams of a recording, with the mistake that explains them as hint.

    They are errors where most beams miss a plane (`most_miss`) and a mistake explains it, or where
    it explains far more beams.
    """
    if most_miss and each.scanner.has_factory_file and not each.from_file:
        return [replace(finding, severity="error", hint=_NO_FILE) for finding in findings]
    station = survey.stations[each.position]
    others = {
        name: other
        for name, other in survey.stations.items()
        if other.scanner == station.scanner and name != each.position
    }
    base = survey.base_scanner.of(station.scanner, where=survey.where[1])
    site = survey.base_site[each.position].reduced(station.site_origin_m)
    site, scanner = common(site, base, where=survey.where[1])
    found = explain(beams, each.factory, station, site, scanner, others, limits)
    if found is None:
        return list(findings)
    if most_miss or found.more > _FAR_BETTER:
        said = "; ".join(finding.message for finding in findings)
        return [Finding("error", SHARE, each.where, said, allowed=ALLOWED, hint=str(found))]
    return list(findings)


_NO_FILE = (
    "The factory measures every unit of this scanner and delivers its calibration file (db.xml), "
    "and nominal values are off by more than a metre: name the file in the sample table, or "
    "`embedded` where the packets contain it."
)


def _nominal(each: Recorded) -> list[Finding]:
    """Nominal values of a scanner whose units differ."""
    if each.from_file or not each.scanner.has_factory_file:
        return []
    return [
        Finding("warning", "calibration file", each.where, "the values are nominal", hint=_NO_FILE)
    ]


def _rows(each: Recorded, seen: Sequence[PlaneHits], tests: Misfits) -> list[PlaneRow]:
    rows = []
    for plane, test in zip(seen, tests.planes, strict=True):
        told = test.dof > 0
        shift, std = (float(test.value[0]), float(test.std[0])) if told else (np.nan, np.nan)
        rows.append(PlaneRow(each.sample, each.position, plane, shift, std))
    return rows


def _single_positions(recorded: Sequence[Recorded]) -> list[Finding]:
    """Scanners that were recorded from one position only."""
    positions: dict[str, set[str]] = {}
    for each in recorded:
        positions.setdefault(each.scanner.name, set()).add(each.position)
    return [
        Finding(
            "warning", "independent check", f"scanner {name}",
            "there is one position only: nothing tells an error of its survey from one of the "
            "scanner, and the result is judged on the data that it comes from",
            allowed="two positions or more",
            hint="Record from a second position, with another heading and distances.",
        )
        for name, where in positions.items()
        if len(where) == 1
    ]  # fmt: skip
