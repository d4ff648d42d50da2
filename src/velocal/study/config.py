"""A study: its configuration and sheets, checked before anything is planned.

Every fault is one `ConfigError` that names the file, the row or key, and what is allowed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from velocal.errors import ConfigError
from velocal.scanner.models import SCANNERS
from velocal.study.outdoor_sheet import OutdoorSample, check_outdoor
from velocal.study.sheets import check, read_sheet, read_yaml
from velocal.study.streams import name_streams, stream_path

#: Windows of a surveyed sample, and the only one of a field sample.
WINDOWS = ("beginning", "middle", "end")
WHOLE = "all"


@dataclass(frozen=True)
class Sample:
    """One recording and what is known of it.

    Attributes
    ----------
    name, scanner : str
    position : str or None
        Surveyed position; None for a field sample.
    recording : str
        Path of the capture.
    calibration : str
        Path of the factory's calibration file ("stream": that read from a recording), or "nominal".
    port : int or None
        UDP port to which the scanner sent; any if None.
    address : str or None
        Address from which it sent, or the topic of a bag; any if None.
    """

    name: str
    scanner: str
    position: str | None
    recording: str
    calibration: str
    port: int | None = None
    address: str | None = None

    @property
    def windows(self) -> tuple[str, ...]:
        """Windows that are reduced."""
        return (WHOLE,) if self.position is None else WINDOWS


@dataclass(frozen=True)
class Study:
    """A checked configuration with its samples.

    Attributes
    ----------
    config : mapping
        As written.
    surveyed, field : dict of str to Sample
        Samples with and without a survey.
    outdoor : dict of str to OutdoorSample
        Samples of panels outdoors.
    """

    config: Mapping[str, Any]
    surveyed: dict[str, Sample]
    field: dict[str, Sample]
    outdoor: dict[str, OutdoorSample]

    @property
    def samples(self) -> dict[str, Sample]:
        """Samples with and without a survey, not those outdoors."""
        return {**self.surveyed, **self.field}

    @property
    def scanners(self) -> list[str]:
        """Scanners of the surveyed samples, in order of appearance."""
        return list(dict.fromkeys(sample.scanner for sample in self.surveyed.values()))

    @property
    def positions(self) -> dict[str, str]:
        """Scanner of every surveyed position."""
        return {s.position: s.scanner for s in self.surveyed.values() if s.position}

    def adjustment(self, scanner: str | None) -> dict[str, Any]:
        """Key `adjustment` of the configuration as it holds for a scanner."""
        general = dict(self.config.get("adjustment", {}))
        own: dict[str, Any] = general.pop("by_scanner", {}).get(scanner, {})
        return general | own

    @property
    def observations(self) -> dict[str, str]:
        """Observation files of the survey, by kind; none if coordinates were handed over."""
        return dict(self.config.get("survey", {}).get("observations", {}))

    def survey_files(self, made: str) -> dict[str, str]:
        """Survey files by kind: as handed over, or adjusted from observations below `made`."""
        if not self.observations:
            return dict(self.config.get("survey", {}))
        files = {name: f"{made}/{name}.csv" for name in ("planes", "base_scanner", "base_field")}
        return {**files, "covariance": f"{made}/covariance.json"}

    @property
    def factories(self) -> dict[str, str]:
        """Factory calibration of every scanner: a file, or "nominal"."""
        return {sample.scanner: sample.calibration for sample in self.surveyed.values()}

    @property
    def parameter_sets(self) -> dict[str, dict[str, list[str]]]:
        """Samples of every parameter set, by scanner."""
        return {
            scanner: dict(sets)
            for scanner, sets in self.config.get("parameter_sets", {}).items()
            if scanner in self.scanners
        }


def read_study(config: Mapping[str, Any], schemas: Path, where: str) -> Study:
    """Check a configuration and read its sheets.

    Parameters
    ----------
    config : mapping
        Content of the configuration file.
    schemas : Path
        Folder of the JSON schemas.
    where : str
        How to call the configuration in errors.

    Raises
    ------
    ConfigError
        For the first fault found.
    """
    check(config, read_yaml(schemas / "config.schema.yaml"), where)
    streams: dict[str, str] = {}
    surveyed: dict[str, Sample] = {}
    field: dict[str, Sample] = {}
    if "samples" in config:
        sheet = Path(config["samples"])
        rows = read_sheet(sheet, read_yaml(schemas / "samples.schema.yaml"))
        name_streams(rows, config["results"], str(sheet), streams)
        surveyed = {
            row["sample"]: Sample(
                row["sample"], row["scanner"], row["position"], row["recording"],
                row["calibration"], *_choice(row),
            )
            for row in rows
        }  # fmt: skip
    if "field" in config:
        sheet = Path(config["field"]["samples"])
        folder = Path(config["field"]["recordings"])
        rows = read_sheet(sheet, read_yaml(schemas / "field_samples.schema.yaml"))
        name_streams(rows, config["results"], str(sheet))
        field = {
            row["sample"]: Sample(
                row["sample"], row["scanner"], None,
                str(folder / row["recording"]), row["calibration"], *_choice(row),
            )
            for row in rows
        }  # fmt: skip
    outdoor: dict[str, OutdoorSample] = {}
    if "outdoor" in config:
        sheet = Path(config["outdoor"]["samples"])
        rows = read_sheet(sheet, read_yaml(schemas / "outdoor_samples.schema.yaml"))
        name_streams(rows, config["results"], str(sheet), streams)
        outdoor = {row["sample"]: OutdoorSample.of(row) for row in rows}
    study = Study(config, surveyed, field, outdoor)
    _check_references(study, where)
    return study


def _choice(row: Mapping[str, str]) -> tuple[int | None, str | None]:
    """Port and address of a row; an empty cell or no column is any."""
    port = row.get("port")
    return int(port) if port else None, row.get("address") or None


def _check_references(study: Study, where: str) -> None:
    """Check that names in the configuration and the sheets refer to something."""
    config = study.config
    if not study.samples:
        raise ConfigError("names no sample", where=where, hint="Give `samples` or `field`.")
    names = [*study.surveyed, *study.field, *study.outdoor]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"sample {name!r} stands in two sheets", where=where)
    for sample in study.samples.values():
        if sample.scanner not in SCANNERS:
            raise ConfigError(
                f"sample {sample.name!r}: unknown scanner {sample.scanner!r}",
                where=where,
                allowed=", ".join(SCANNERS),
            )
        if sample.position and sample.calibration != study.factories[sample.scanner]:
            raise ConfigError(
                f"the samples of {sample.scanner} name different calibration files",
                where=where,
                hint="Calibrate two units of one model in two studies.",
            )
        if sample.position and study.positions[sample.position] != sample.scanner:
            raise ConfigError(
                f"position {sample.position!r} is used by two scanners",
                where=where,
                hint="The base targets of a position belong to one scanner: name another.",
            )
    for sample in config.get("field", {}).get("patches", {}):
        if sample not in study.field:
            raise ConfigError(
                f"field.patches: no sample {sample!r}", where=where, allowed=", ".join(study.field)
            )
    check_outdoor(study.outdoor, study.factories, config, where)
    if not study.surveyed:
        return
    for key in ("survey", "windows", "assignment", "adjustment", "parameter_sets", "validation"):
        if key not in config:
            raise ConfigError(f"key {key!r} is missing", where=where, hint="See config/README.md.")
    for scanner, sets in config["parameter_sets"].items():
        for name, samples in sets.items():
            for sample in samples:
                known = [s.name for s in study.surveyed.values() if s.scanner == scanner]
                if sample not in known:
                    raise ConfigError(
                        f"parameter_sets.{scanner}.{name}: no sample {sample!r} of that scanner",
                        where=where,
                        allowed=", ".join(known),
                    )
    for scanner in study.scanners:
        if scanner not in config["parameter_sets"]:
            raise ConfigError(f"parameter_sets has no {scanner!r}", where=where)
    for key in ("tables", "figures"):
        for number, entry in config.get(key, {}).items():
            for sample in entry.get("samples", ()):
                if sample not in study.surveyed:
                    raise ConfigError(
                        f"{key}.{number}: no sample {sample!r}",
                        where=where,
                        allowed=", ".join(study.surveyed),
                    )
    _check_maps(study, where)
    if "methods" in config:
        _check_methods(study, config["methods"], where)


def _check_maps(study: Study, where: str) -> None:
    """Check the parameter set of a map, and that there is one map at most."""
    figures: Mapping[str, Mapping[str, Any]] = study.config.get("figures", {})
    maps = {number: figure for number, figure in figures.items() if figure["kind"] == "map"}
    for number, figure in maps.items():
        key = f"figures.{number}"
        sets = study.parameter_sets.get(figure["scanner"], {})
        if figure["set"] not in sets:
            raise ConfigError(
                f"{key}: no parameter set {figure['set']!r} of {figure['scanner']!r}",
                where=where,
                allowed=", ".join(sets),
            )
        if len(maps) > 1 or "simulation" not in study.config:
            raise ConfigError(
                f"{key}: one map of the simulated world's building is drawn, no other",
                where=where,
            )


def _check_methods(study: Study, methods: Mapping[str, Any], where: str) -> None:
    """Check the samples that methods are compared on."""
    known = [s.name for s in study.surveyed.values() if s.scanner == methods["scanner"]]
    for key in ("calibration", "other"):
        for sample in methods[key]:
            if sample not in known:
                raise ConfigError(
                    f"methods.{key}: no sample {sample!r} of {methods['scanner']!r}",
                    where=where,
                    allowed=", ".join(known),
                )
    used = {study.surveyed[sample].position for sample in methods["calibration"]}
    for sample in methods["other"]:
        if study.surveyed[sample].position in used:
            raise ConfigError(
                f"methods.other: sample {sample!r} is of a position that is calibrated on",
                where=where,
                hint="Methods are judged on a position that they did not see.",
            )
    for key in ("dl_cm", "alpha_deg", "v_deg"):
        if key not in study.config["adjustment"]["prior"]:
            raise ConfigError(f"methods: adjustment.prior has no {key!r}", where=where)


def check_files(study: Study, made_here: str | None, where: str) -> None:
    """Check that every file that no rule makes exists.

    Parameters
    ----------
    study : Study
    made_here : str or None
        Folder whose files the workflow makes itself (the simulated world), if there is one.
    where : str
        How to call the configuration in errors.

    Raises
    ------
    ConfigError
        For the first missing file; without this, old results would hide it.
    """
    named = {f"survey.observations.{key}": path for key, path in study.observations.items()}
    if not named:
        named = {f"survey.{key}": path for key, path in study.survey_files("").items()}
    given = {"nominal", *(stream_path(study.config["results"], name) for name in study.samples)}
    every: list[Sample | OutdoorSample] = [*study.samples.values(), *study.outdoor.values()]
    for sample in every:
        named[f"recording of sample {sample.name!r}"] = sample.recording
        if sample.calibration not in given:
            named[f"calibration of sample {sample.name!r}"] = sample.calibration
    hint = (
        "Put it there, or name another; paths are relative to the folder in which snakemake runs."
    )
    if made_here:
        hint += f" Simulated files lie below {made_here}."
    for what, path in named.items():
        made = made_here is not None and Path(path).is_relative_to(made_here)
        if not made and not Path(path).is_file():
            raise ConfigError(f"{what}: no file {path!r}", where=where, hint=hint)
