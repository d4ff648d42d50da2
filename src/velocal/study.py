"""A study: its configuration and sheets, checked before anything is planned.

Every fault is one `ConfigError` that names the file, the row or key, and what is allowed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jsonschema
import pandas as pd
import yaml

from velocal.errors import ConfigError
from velocal.sensors import SCANNERS

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
        Path of the factory's calibration file, or "nominal".
    """

    name: str
    scanner: str
    position: str | None
    recording: str
    calibration: str

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
    """

    config: Mapping[str, Any]
    surveyed: dict[str, Sample]
    field: dict[str, Sample]

    @property
    def samples(self) -> dict[str, Sample]:
        """All samples."""
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


def check(content: object, schema: Mapping[str, Any], where: str) -> None:
    """Check content against a JSON schema.

    Raises
    ------
    ConfigError
        For the first fault, with its place and what is allowed.
    """
    fault = jsonschema.exceptions.best_match(
        jsonschema.Draft202012Validator(schema).iter_errors(content)
    )
    if fault is None:
        return
    place = ".".join(str(part) for part in fault.absolute_path)
    rule: Any = fault.schema
    what, allowed = f"{place}: {fault.message}" if place else fault.message, None
    if fault.validator == "additionalProperties":
        known, patterns = (
            sorted(rule.get("properties", {})),
            list(rule.get("patternProperties", {})),
        )
        extra = [
            key
            for key in fault.instance
            if key not in known and not any(re.search(pattern, key) for pattern in patterns)
        ]
        what = f"unknown key {'.'.join([place, str(extra[0])]).lstrip('.')!r}"
        allowed = ", ".join(known + patterns)
    elif fault.validator == "enum":
        allowed = ", ".join(str(value) for value in rule["enum"])
        what = f"{place}: {fault.instance!r}"
    elif fault.validator == "pattern":
        allowed = f"names like {rule['pattern']}"
        what = f"{place}: {fault.instance!r} is not a name"
    hint = rule.get("description") if isinstance(rule, Mapping) else None
    raise ConfigError(what, where=where, allowed=allowed, hint=hint)


def read_yaml(path: Path) -> Any:
    """Read a YAML file.

    Raises
    ------
    ConfigError
        If it is missing or no YAML.
    """
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"cannot be read: {error}", where=str(path)) from None


def read_sheet(path: Path, schema: Mapping[str, Any]) -> list[dict[str, str]]:
    """Read a tab-separated sheet, every row checked; `#` begins a comment.

    Raises
    ------
    ConfigError
        If the file, a column or a cell is wrong, or a sample occurs twice.
    """
    try:
        table = pd.read_csv(path, sep="\t", dtype=str, comment="#", keep_default_na=False)
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot be read: {error}", where=str(path)) from None
    rows: list[dict[str, str]] = [
        {str(key): str(value).strip() for key, value in row.items()}
        for row in table.to_dict(orient="records")
    ]
    seen: dict[str, int] = {}
    for number, row in enumerate(rows, start=1):
        where = f"{path}, row {number}"
        check(row, schema, where)
        name = row["sample"]
        if name in seen:
            raise ConfigError(
                f"sample {name!r} occurs twice",
                where=where,
                hint=f"It stands in row {seen[name]} already; every recording needs its own name.",
            )
        seen[name] = number
    return rows


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
    surveyed: dict[str, Sample] = {}
    field: dict[str, Sample] = {}
    if "samples" in config:
        sheet = Path(config["samples"])
        rows = read_sheet(sheet, read_yaml(schemas / "samples.schema.yaml"))
        surveyed = {
            row["sample"]: Sample(
                row["sample"], row["scanner"], row["position"], row["recording"], row["calibration"]
            )
            for row in rows
        }
    if "field" in config:
        sheet = Path(config["field"]["samples"])
        folder = Path(config["field"]["recordings"])
        rows = read_sheet(sheet, read_yaml(schemas / "field_samples.schema.yaml"))
        field = {
            row["sample"]: Sample(
                row["sample"], row["scanner"], None,
                str(folder / row["recording"]), row["calibration"],
            )
            for row in rows
        }  # fmt: skip
    study = Study(config, surveyed, field)
    _check_references(study, where)
    return study


def _check_references(study: Study, where: str) -> None:
    """Check that names in the configuration and the sheets refer to something."""
    config = study.config
    if not study.samples:
        raise ConfigError("names no sample", where=where, hint="Give `samples` or `field`.")
    both = sorted(set(study.surveyed) & set(study.field))
    if both:
        raise ConfigError(f"sample {both[0]!r} is surveyed and field", where=where)
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
    for number, table in config.get("tables", {}).items():
        for sample in table["samples"]:
            if sample not in study.surveyed:
                raise ConfigError(
                    f"tables.{number}: no sample {sample!r}",
                    where=where,
                    allowed=", ".join(study.surveyed),
                )
    if "methods" in config:
        _check_methods(study, config["methods"], where)


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
    named = {f"survey.{key}": path for key, path in study.config.get("survey", {}).items()}
    for sample in study.samples.values():
        named[f"recording of sample {sample.name!r}"] = sample.recording
        if sample.calibration != "nominal":
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
