"""YAML files and tab-separated sheets, checked against their schemas.

Every fault is one `ConfigError` that names the file, the row or key, and what is allowed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jsonschema
import pandas as pd
import yaml

from velocal.errors import ConfigError


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
