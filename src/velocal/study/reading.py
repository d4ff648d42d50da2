"""Files of configuration: plain YAML, read before Snakemake does."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from velocal.errors import ConfigError
from velocal.io import yaml_text

#: Lets Snakemake evaluate expressions in a configuration.
_EXPRESSIONS = "__use_yte__"


def read_yaml(path: Path) -> Any:
    """Read a YAML file: plain data, see `velocal.io.yaml_text`.

    Raises
    ------
    ConfigError
        If it is missing or no YAML, a key occurs twice, or aliases make it endless.
    """
    return yaml_text.read_yaml(path, ConfigError)


def check_configuration(path: Path) -> None:
    """Check a file of configuration before Snakemake loads it.

    Snakemake reports an unreadable value by the name of its own error, follows aliases without
    end, and evaluates expressions where the file asks for it.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ConfigError
        As `read_yaml`; also if the file is no mapping, or asks for expressions.
    """
    content = read_yaml(path)
    if not isinstance(content, Mapping):
        raise ConfigError(
            "holds no keys",
            where=str(path),
            allowed="keys with values, as `study: a title`",
            hint="`velocal init` writes a complete configuration.",
        )
    if _EXPRESSIONS in content:
        raise ConfigError(
            f"the key {_EXPRESSIONS!r} lets Snakemake run expressions",
            where=str(path),
            allowed="a configuration of plain values",
            hint="Remove the key, and write the values out.",
        )
