"""What is planned: out of the configuration of a study, or out of the sketch of a site."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from velocal.adjustment.unit.predict import UnitSizes
from velocal.adjustment.unit.settings import UnitSettings
from velocal.calibration.files import formats
from velocal.errors import ConfigError
from velocal.evaluation.planner import Instrument, Setup, typical_sizes
from velocal.reduction.assignment import Limits
from velocal.scanner.models import SCANNERS, Scanner
from velocal.scanner.parameters import LaserParameters, nominal
from velocal.study.reading import read_yaml
from velocal.study.samples import NOMINAL
from velocal.study.sketch import AssumedSizes, Candidates, Sketch
from velocal.study.study import Study, read_study
from velocal.study.windows import WINDOWS
from velocal.survey.network.field_book import read_field_book
from velocal.survey.network.survey import adjust_field_book
from velocal.survey.planned import PlannedSurvey, sketched_survey
from velocal.survey.station import Station
from velocal.survey.targets import Targets, read_targets

#: Configurations of a study, in the order in which they are looked for.
CONFIGURATIONS = ("config.yaml", "config/config.yaml")
_DEG, _CM, _MM = np.pi / 180.0, 1e-2, 1e-3


@dataclass(frozen=True)
class PlanTask:
    """Stations of which a calibration is planned.

    Attributes
    ----------
    instrument : Instrument
    given, candidates : tuple of Setup
        Stations that will be used, and those that are compared.
    targets : Targets
        Of the planes, site frame.
    remarks : tuple of str
        What had to be assumed.
    """

    instrument: Instrument
    given: tuple[Setup, ...]
    candidates: tuple[Setup, ...]
    targets: Targets
    remarks: tuple[str, ...]


def of_sketch(sketch: Sketch, folder: Path) -> PlanTask:
    """Take everything out of a sketch.

    Parameters
    ----------
    sketch : Sketch
    folder : Path
        To which the path of the factory's file is relative.

    Returns
    -------
    PlanTask

    Raises
    ------
    SurveyError
        If targets determine no plane or no pose.
    CalibrationFileError
        If the factory's file is named, but is not one of the scanner.
    """
    scanner = SCANNERS[sketch.scanner]
    path = folder / sketch.calibration if sketch.calibration else None
    factory = formats.read_or_nominal(path, scanner)
    known = None if path is None else factory
    settings = UnitSettings.recommended(scanner, factory=_has_distances(known, scanner))
    survey = sketched_survey(sketch)
    instrument = Instrument(
        scanner=scanner,
        factory=factory,
        settings=settings,
        sizes=_sizes(scanner, settings, sketch.assume),
        limits=Limits(),
        bin_ticks=scanner.azimuth_bin_ticks,
        range_m=sketch.judge_at_m,
    )
    windows = sketch.recordings * len(WINDOWS)
    given, candidates = (
        tuple(
            Setup(survey.station(name, stand, scanner), windows, survey.flatness_m)
            for name, stand in stands.items()
        )
        for stands in (sketch.stations, sketch.candidates)
    )
    return PlanTask(instrument, given, candidates, survey.planes, _remarks(scanner, path is None))


def of_study(configuration: Path, scanner: str | None, wanted: Candidates) -> PlanTask:
    """Take the stations out of the survey of a study; its recordings need not exist.

    Parameters
    ----------
    configuration : Path
        Paths in it are relative to the working folder.
    scanner : str or None
        Needed only if the study has several.
    wanted : Candidates
        Stations that are compared besides.

    Returns
    -------
    PlanTask

    Raises
    ------
    ConfigError
        If the configuration is faulty, or the study has no survey or several scanners.
    SurveyError
        If a file of the survey is missing or faulty.
    """
    study = read_study(read_yaml(configuration), str(configuration))
    known = SCANNERS[_chosen(study, scanner, str(configuration))]
    samples = _samples(study, known.name)
    windows: dict[str, int] = {}
    for name in samples:
        sample = study.surveyed[name]
        windows[sample.position] = windows.get(sample.position, 0) + len(sample.windows)
    file = Path(study.factories[known.name])
    missing = str(file) == NOMINAL or not file.is_file()
    factory = formats.read_or_nominal(None if missing else file, known)
    settings = study.config.joint.settings(known, factory)
    if missing and str(file) != NOMINAL:
        prior = settings.prior
        settings = UnitSettings.recommended(known, prior=prior)
    survey, bases, where = _survey(study, known.name, list(windows))
    given = tuple(
        Setup(
            Station.adjust(
                survey.planes, survey.base, bases[position], survey.names,
                covariances=survey.covariances, where=where,
            ),
            number,
        )
        for position, number in windows.items()
    )  # fmt: skip
    for name in wanted.candidates:
        if name in windows:
            raise ConfigError(
                f"candidates: {name!r} is a position of the study",
                where=str(configuration),
                hint="Give the candidate another name.",
            )
    candidates = tuple(
        Setup(survey.station(name, stand, known), len(WINDOWS))
        for name, stand in wanted.candidates.items()
    )
    instrument = Instrument(
        scanner=known,
        factory=factory,
        settings=settings,
        sizes=_sizes(known, settings, wanted.assume),
        limits=study.assignment.limits.metric(),
        bin_ticks=study.config.reduction.azimuth_bin_ticks(known),
        range_m=wanted.judge_at_m,
    )
    return PlanTask(instrument, given, candidates, survey.planes, _remarks(known, missing))


def configuration_in(folder: Path) -> Path:
    """Configuration of the study in a folder.

    Raises
    ------
    ConfigError
        If the folder has no configuration.
    """
    for name in CONFIGURATIONS:
        if (folder / name).is_file():
            return Path(name)
    raise ConfigError(
        "there is no configuration in this folder",
        where=str(folder),
        allowed=" or ".join(CONFIGURATIONS),
        hint="Name the folder of a study, or a sketch (`velocal plan --template room.yaml`).",
    )


def _chosen(study: Study, scanner: str | None, where: str) -> str:
    """Scanner that is planned."""
    if not study.scanners:
        raise ConfigError(
            "the study has no survey", where=where, hint="Write a sketch of the site instead."
        )
    if scanner is None and len(study.scanners) > 1:
        raise ConfigError(
            "the study has several scanners",
            where=where,
            allowed=", ".join(study.scanners),
            hint="Choose one with --scanner.",
        )
    if scanner is not None and scanner not in study.scanners:
        raise ConfigError(
            f"the study has no {scanner}", where="--scanner", allowed=", ".join(study.scanners)
        )
    return scanner or study.scanners[0]


def _samples(study: Study, scanner: str) -> tuple[str, ...]:
    """Samples of the first calibration of the scanner; all of them without one."""
    for samples in study.calibrations.get(scanner, {}).values():
        return samples
    return tuple(name for name, sample in study.surveyed.items() if sample.scanner == scanner)


def _survey(
    study: Study, scanner: str, positions: list[str]
) -> tuple[PlannedSurvey, Mapping[str, Targets], str]:
    """Survey of the planes and the base, targets of the base at every position, first file."""
    names = study.assignment.planes
    if study.observations is not None:
        of = study.observations
        paths = {
            "points": of.points,
            "network": of.polar,
            "base_sights": of.base_polar,
            "base_readings": of.base_coordinates,
        } | ({"images": of.images} if of.images else {})
        where = of.points
        book = read_field_book({key: Path(path) for key, path in paths.items()})
        adjusted = adjust_field_book(book, where=where)
        planes, base = adjusted.planes, adjusted.base_scanner[scanner].targets
        bases: Mapping[str, Targets] = adjusted.base_site
        covariances = planes.plane_covariances()
    else:
        files = study.coordinates
        assert files is not None
        where = files.planes
        planes = read_targets(files.planes, "plane")
        base = read_targets(files.base_scanner, "scanner").of(scanner, where=files.base_scanner)
        everywhere = read_targets(files.base_site, "position")
        bases = {name: everywhere.of(name, where=files.base_site) for name in positions}
        covariances = None
    site = np.concatenate([bases[name].std for name in positions])
    std = float(np.sqrt(np.mean(site**2)))
    return PlannedSurvey(planes, names, base, std, covariances), bases, where


def _sizes(scanner: Scanner, settings: UnitSettings, assume: AssumedSizes) -> UnitSizes:
    """Typical sizes, with those that are stated."""
    known = {
        "dl": (assume.dl_cm, _CM),
        "alpha": (assume.alpha_deg, _DEG),
        "v": (assume.v_deg, _DEG),
        "shift": (assume.shift_mm, _MM),
        "common": (assume.common_mm, _MM),
    }
    return typical_sizes(
        scanner,
        settings,
        spread={name: value * unit for name, (value, unit) in known.items() if value},
        pattern_m=assume.pattern_mm and assume.pattern_mm * _MM,
        median_m=assume.median_mm and assume.median_mm * _MM,
        length_rad=assume.pattern_deg and assume.pattern_deg * _DEG,
    )


def _has_distances(factory: LaserParameters | None, scanner: Scanner) -> LaserParameters | None:
    """Parameters that tell whether the file has a far point; None where it is not there yet."""
    return factory if factory is not None or scanner.has_factory_file else nominal(scanner)


def _remarks(scanner: Scanner, missing: bool) -> tuple[str, ...]:
    if missing and scanner.has_factory_file:
        return ("nominal angles are used, as there is no calibration file of the factory",)
    return ()
