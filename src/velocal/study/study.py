"""A study: its typed configuration with its sample tables, checked before anything is planned.

Every fault is one `ConfigError` that names the file, the row or key, and what is allowed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

from velocal.errors import ConfigError
from velocal.scanner.models import SCANNERS, Scanner
from velocal.study.adjustment import Adjustment
from velocal.study.config import (
    Coordinates,
    Methods,
    ObservationFiles,
    Observations,
    StudyConfig,
)
from velocal.study.figures import CorrectionsFigure, MapFigure, SampleFigure
from velocal.study.model import Section, validated
from velocal.study.outputs import Validation
from velocal.study.reduction import Assignment
from velocal.study.samples import (
    NOMINAL,
    Described,
    OutdoorSample,
    Row,
    SurveyedSample,
    UnsurveyedSample,
    read_samples,
    scanners_of,
    with_described,
    with_embedded,
)

_Section = TypeVar("_Section", bound=Section)


@dataclass(frozen=True)
class Study:
    """A checked configuration with its samples.

    Attributes
    ----------
    config : StudyConfig
    surveyed : dict of str to SurveyedSample
    unsurveyed : dict of str to UnsurveyedSample
    outdoor : dict of str to OutdoorSample
        Samples of panels outdoors.
    described : dict of str to Described
        Scanners of unsurveyed samples that files describe, by name.
    """

    config: StudyConfig
    surveyed: dict[str, SurveyedSample]
    unsurveyed: dict[str, UnsurveyedSample]
    outdoor: dict[str, OutdoorSample]
    described: Mapping[str, Described] = field(default_factory=dict)

    def scanner(self, name: str) -> Scanner:
        """Scanner of a sample, by its name."""
        return self.described[name].scanner if name in self.described else SCANNERS[name]

    @property
    def scanner_files(self) -> dict[str, str]:
        """Files that describe scanners, by name; scanners that velocal knows have none."""
        return {name: each.path for name, each in self.described.items()}

    @property
    def samples(self) -> dict[str, SurveyedSample | UnsurveyedSample]:
        """Samples with and without a survey, not those outdoors."""
        return {**self.surveyed, **self.unsurveyed}

    @property
    def scanners(self) -> list[str]:
        """Scanners of the surveyed samples, in order of appearance."""
        return scanners_of([*self.surveyed.values()])

    @property
    def positions(self) -> dict[str, str]:
        """Scanner of every surveyed position."""
        return {sample.position: sample.scanner for sample in self.surveyed.values()}

    @property
    def factories(self) -> dict[str, str]:
        """Calibration file of the factory for every surveyed scanner, or `nominal`."""
        return {sample.scanner: sample.calibration for sample in self.surveyed.values()}

    @property
    def factory_files(self) -> dict[str, str]:
        """Calibration file of the factory, by scanner; scanners with nominal values have none."""
        return {name: path for name, path in self.factories.items() if path != NOMINAL}

    @property
    def calibration_names(self) -> list[tuple[str, str]]:
        """Scanner and name of every calibration of a unit, those without a survey at the end."""
        return [
            (scanner, name)
            for calibrations in (self.calibrations, self.unsurveyed_calibrations)
            for scanner, sets in calibrations.items()
            for name in sets
        ]

    @property
    def unsurveyed_calibrations(self) -> Mapping[str, Mapping[str, tuple[str, ...]]]:
        """Samples of every calibration without a survey, by scanner."""
        return self.config.unsurveyed.calibrations if self.config.unsurveyed else {}

    def calibrated_on(self, scanner: str, name: str) -> tuple[str, ...]:
        """Samples of a calibration of a unit, with or without a survey."""
        surveyed = self.calibrations.get(scanner, {})
        return surveyed[name] if name in surveyed else self.unsurveyed_calibrations[scanner][name]

    @property
    def assignment(self) -> Assignment:
        """Section `assignment` of a study with surveyed samples."""
        return _given(self.config.assignment)

    @property
    def validation(self) -> Validation:
        """Section `validation` of a study with surveyed samples."""
        return _given(self.config.validation)

    def sigma_cm(self, *scanners: str) -> float:
        """Standard deviation of a distance in the datasheet of scanners, the largest of them.

        Parameters
        ----------
        *scanners : str
            Names of surveyed scanners.

        Returns
        -------
        float
            Centimetres; what the configuration states for the validation, if it does.
        """
        stated = self.config.validation.sigma_cm if self.config.validation else None
        return stated or max(100.0 * SCANNERS[name].range_sigma_m for name in scanners)

    def unsurveyed_sigma_cm(self, sample: str) -> float:
        """Standard deviation of a distance of the scanner of an unsurveyed sample, centimetres."""
        stated = self.config.unsurveyed.sigma_cm if self.config.unsurveyed else None
        return stated or 100.0 * self.scanner(self.unsurveyed[sample].scanner).range_sigma_m

    def adjustment(self, scanner: str) -> Adjustment:
        """Section `adjustment` as it holds for a scanner; what is recommended if left out."""
        given = self.config.adjustment
        return given.of(scanner) if given else Adjustment.recommended(SCANNERS[scanner])

    @property
    def average(self) -> Literal["equal", "covariance"]:
        """Weights of the samples of a parameter set: `equal` or `covariance`."""
        return _given(self.config.adjustment).average

    @property
    def calibrations(self) -> Mapping[str, Mapping[str, tuple[str, ...]]]:
        """Samples of every calibration of a unit, by scanner."""
        return self.config.calibrations

    def candidates(self, scanner: str) -> tuple[str, ...]:
        """Parameter sets of a scanner, then its calibrations."""
        return (*self.parameter_sets.get(scanner, {}), *self.calibrations.get(scanner, {}))

    def shown(self, scanner: str) -> str:
        """Calibration that the report shows as "after": the last one, or else the last set."""
        return self.candidates(scanner)[-1]

    def calibration_of(self, sample: str) -> str | None:
        """First calibration that a sample is used for; None if there is none."""
        of_scanner = self.calibrations.get(self.samples[sample].scanner, {})
        return next((name for name, samples in of_scanner.items() if sample in samples), None)

    @property
    def parameter_sets(self) -> Mapping[str, Mapping[str, tuple[str, ...]]]:
        """Samples of every parameter set, by scanner."""
        return self.config.parameter_sets

    @property
    def observations(self) -> ObservationFiles | None:
        """Observation files of the survey; None if coordinates are handed over."""
        survey = self.config.survey
        return survey.observations if isinstance(survey, Observations) else None

    @property
    def coordinates(self) -> Coordinates | None:
        """Survey files of coordinates: as handed over, or adjusted from the observations."""
        if self.observations is None:
            survey = self.config.survey
            return survey if isinstance(survey, Coordinates) else None
        made = f"{self.config.folder}/survey"
        return Coordinates(
            planes=f"{made}/planes.csv",
            base_scanner=f"{made}/base_scanner.csv",
            base_site=f"{made}/base_field.csv",
        )

    def made_files(self) -> set[str]:
        """Files that the rules of the simulated world make; none without one."""
        if self.config.simulation is None:
            return set()
        made = f"{self.config.folder}/simulation"
        return {
            *(f"{made}/recordings/{name}.bin" for name in [*self.surveyed, *self.outdoor]),
            *(f"{made}/factory/{scanner}.xml" for scanner in self.scanners),
            *(f"{made}/survey/{name}.csv" for name in SIMULATED_SURVEY),
        }


#: Observation files that the simulated surveyor hands over, in the order of `ObservationFiles`.
SIMULATED_SURVEY = ("points", "network", "images", "base_sights", "base_readings")


def read_study(config: Mapping[str, Any], where: str) -> Study:
    """Check a configuration and read its sample tables.

    Parameters
    ----------
    config : mapping
        Content of the configuration file.
    where : str
        How to call the configuration in errors.

    Returns
    -------
    Study

    Raises
    ------
    ConfigError
        For the first fault found.
    """
    return with_samples(validated(StudyConfig, config, where), where)


def with_samples(settings: StudyConfig, where: str) -> Study:
    """Read the sample tables of a configuration, and check that the names in both agree.

    Parameters
    ----------
    settings : StudyConfig
    where : str
        How to call the configuration in errors.

    Returns
    -------
    Study

    Raises
    ------
    ConfigError
        For the first fault found.
    """
    results = settings.folder
    embedded: dict[str, str] = {}
    surveyed: dict[str, SurveyedSample] = {}
    unsurveyed: dict[str, UnsurveyedSample] = {}
    outdoor: dict[str, OutdoorSample] = {}
    described: dict[str, Described] = {}
    if settings.samples:
        path = Path(settings.samples)
        surveyed_rows = read_samples(path, SurveyedSample, results)
        surveyed = with_embedded(surveyed_rows, results, str(path), embedded)
    if settings.unsurveyed:
        path, folder = Path(settings.unsurveyed.samples), Path(settings.unsurveyed.recordings)
        rows = {
            name: row.model_copy(update={"recording": str(folder / row.recording)})
            for name, row in read_samples(path, UnsurveyedSample, results).items()
        }
        named, described = with_described(rows, str(path))
        unsurveyed = with_embedded(named, results, str(path))
    if settings.outdoor:
        path = Path(settings.outdoor.samples)
        outdoor_rows = read_samples(path, OutdoorSample, results)
        outdoor = with_embedded(outdoor_rows, results, str(path), embedded)
    study = Study(settings, surveyed, unsurveyed, outdoor, described)
    _check_samples(study, where)
    _check_scanners(study, where)
    _check_selections(study, where)
    _check_outdoor(study, where)
    return study


def _given(section: _Section | None) -> _Section:
    """Return a section of a study with surveyed samples, where the configuration must have it."""
    if section is None:
        raise ConfigError("the study has no surveyed samples", hint="Give `samples`.")
    return section


def _check_samples(study: Study, where: str) -> None:
    """Check that samples have names of their own, and positions and scanners belong together."""
    names = [*study.surveyed, *study.unsurveyed, *study.outdoor]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"sample {name!r} is in two sample tables", where=where)
    if not study.samples:
        raise ConfigError("the sample tables have no row", where=where)
    for sample in study.surveyed.values():
        if sample.calibration != study.factories[sample.scanner]:
            raise ConfigError(
                f"the samples of {sample.scanner} name different calibration files",
                where=where,
                hint="Calibrate two units of one model in two studies.",
            )
        if study.positions[sample.position] != sample.scanner:
            raise ConfigError(
                f"position {sample.position!r} is used by two scanners",
                where=where,
                hint="The base targets of a position belong to one scanner: name another.",
            )


def _check_scanners(study: Study, where: str) -> None:
    """Check that what is said of a scanner is said of one that has samples."""
    adjustment = study.config.adjustment
    all_of_them = scanners_of([*study.samples.values()])
    for key, named, known in (
        ("adjustment.by_scanner", adjustment.by_scanner if adjustment else {}, study.scanners),
        ("reduction.azimuth_bin_deg", study.config.reduction.azimuth_bin_deg, all_of_them),
        ("parameter_sets", study.parameter_sets, study.scanners),
        ("calibrations", study.calibrations, study.scanners),
        ("unsurveyed.calibrations", study.unsurveyed_calibrations, all_of_them),
        ("serials", study.config.serials, all_of_them),
    ):
        for scanner in named:
            if scanner not in known:
                raise ConfigError(
                    f"{key}: no sample is of {scanner!r}",
                    where=where,
                    allowed=", ".join(known),
                    hint="Remove the entry, or correct the scanner.",
                )
    for scanner in study.scanners:
        if not study.candidates(scanner):
            raise ConfigError(
                f"neither calibrations nor parameter_sets has {scanner!r}",
                where=where,
                hint="Add its samples to `calibrations`, or correct the sample table.",
            )


def _check_selections(study: Study, where: str) -> None:
    """Check that sets, tables, figures and methods name samples of their scanner."""
    config = study.config
    for key, given in (
        ("parameter_sets", study.parameter_sets),
        ("calibrations", study.calibrations),
    ):
        for scanner, sets in given.items():
            for name, samples in sets.items():
                _check_names(study, f"{key}.{scanner}.{name}", scanner, samples, where)
    averaged = {name for sets in study.parameter_sets.values() for name in sets}
    for scanner, sets in study.calibrations.items():
        for name in sets:
            if name in averaged:
                raise ConfigError(
                    f"calibrations.{scanner}.{name}: a parameter set has this name",
                    where=where,
                    hint="Their files lie in one folder: choose another name.",
                )
    _check_unsurveyed_calibrations(study, where)
    for key, table in config.tables.items():
        _check_names(study, f"tables.{key}", table.scanner, table.samples, where)
    for number, figure in config.figures.items():
        place = f"figures.{number}"
        if isinstance(figure, SampleFigure):
            _check_names(study, place, figure.scanner, figure.samples, where)
        elif isinstance(figure, MapFigure):
            _check_sets(study, place, figure.scanner, [figure.set], where)
        elif isinstance(figure, CorrectionsFigure):
            _check_sets(study, place, figure.scanner, figure.sets, where)
    if config.unsurveyed:
        for name in config.unsurveyed.patches:
            if name not in study.unsurveyed:
                raise ConfigError(
                    f"unsurveyed.patches: no sample {name!r}",
                    where=where,
                    allowed=", ".join(study.unsurveyed),
                )
    if config.methods:
        _check_methods(study, config.methods, where)


def _check_unsurveyed_calibrations(study: Study, where: str) -> None:
    """Check that calibrations without a survey are of one unit, and have names of their own."""
    if study.config.unsurveyed is None:
        return
    surveyed = {
        name
        for sets in (*study.parameter_sets.values(), *study.calibrations.values())
        for name in sets
    }
    for scanner, sets in study.unsurveyed_calibrations.items():
        for name, samples in sets.items():
            key = f"unsurveyed.calibrations.{scanner}.{name}"
            _check_names(study, key, scanner, samples, where, study.unsurveyed)
            if name in surveyed:
                raise ConfigError(
                    f"{key}: another calibration or parameter set has this name",
                    where=where,
                    hint="Choose another name.",
                )
            if len({study.unsurveyed[sample].calibration for sample in samples}) > 1:
                raise ConfigError(
                    f"{key}: its samples name different calibration files",
                    where=where,
                    hint="Calibrate two units of one model one by one.",
                )
    for name in study.config.unsurveyed.judged.names:
        if name.partition("/")[0] not in study.unsurveyed:
            raise ConfigError(
                f"unsurveyed.judged.names: no sample {name.partition('/')[0]!r}",
                where=where,
                allowed=", ".join(study.unsurveyed),
            )


def _check_names(
    study: Study,
    key: str,
    scanner: str,
    samples: Iterable[str],
    where: str,
    among: Mapping[str, Row] | None = None,
) -> None:
    """Check that a key names samples of one scanner, surveyed ones unless others are given."""
    given = study.surveyed if among is None else among
    known = [name for name, sample in given.items() if sample.scanner == scanner]
    for name in samples:
        if name not in known:
            other = given.get(name)
            what = (
                f"sample {name!r} is of {other.scanner!r}, not of {scanner!r}"
                if other
                else (f"no sample {name!r}")
            )
            raise ConfigError(f"{key}: {what}", where=where, allowed=", ".join(known))


def _check_sets(study: Study, key: str, scanner: str, names: Iterable[str], where: str) -> None:
    """Check that a key names a scanner with parameter sets or calibrations, and some of these."""
    known = study.candidates(scanner)
    if not known:
        raise ConfigError(
            f"{key}: {scanner!r} has no parameter set and no calibration",
            where=where,
            allowed=", ".join(each for each in study.scanners if study.candidates(each)),
        )
    for name in names:
        if name not in known:
            raise ConfigError(
                f"{key}: no parameter set or calibration {name!r} of {scanner!r}",
                where=where,
                allowed=", ".join(known),
            )


def _check_methods(study: Study, methods: Methods, where: str) -> None:
    """Check the samples that methods are compared on."""
    for key, names in (("calibration", methods.calibration), ("other", methods.other)):
        _check_names(study, f"methods.{key}", methods.scanner, names, where)
    used = {study.surveyed[sample].position for sample in methods.calibration}
    for name in methods.other:
        if study.surveyed[name].position in used:
            raise ConfigError(
                f"methods.other: sample {name!r} is of a position that is calibrated on",
                where=where,
                hint="Methods are judged on a position that they did not see.",
            )


def _check_outdoor(study: Study, where: str) -> None:
    """Check that outdoor samples have parameter sets of their unit, and figures have samples."""
    outdoor, made = study.config.outdoor, study.made_files()
    if outdoor is None:
        return
    for sample in study.outdoor.values():
        if study.factories.get(sample.scanner) != sample.calibration:
            raise ConfigError(
                f"outdoor sample {sample.name!r}: {sample.calibration!r} is not a calibration file "
                f"of a surveyed sample of {sample.scanner}",
                where=where,
                allowed=", ".join(f"{path} ({unit})" for unit, path in study.factories.items()),
                hint="Parameter sets are made from surveyed samples of the same unit.",
            )
        if sample.recording in made and outdoor.rotations is None:
            raise ConfigError(
                f"outdoor.rotations is missing, but sample {sample.name!r} is simulated",
                where=where,
                hint="Say how many complete rotations are simulated.",
            )
    known = {(sample.kind, sample.scanner) for sample in study.outdoor.values()}
    for number, (kind, scanner) in outdoor.figures.items():
        if (kind, scanner) not in known:
            raise ConfigError(
                f"outdoor.figures.{number}: no {kind} samples of {scanner}",
                where=where,
                allowed=", ".join(" ".join(pair) for pair in sorted(known)),
            )
