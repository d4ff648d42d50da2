"""`stream` in a sheet: the factory's calibration is read from a recording's own status bytes."""

from __future__ import annotations

from collections.abc import Iterable, MutableMapping

from velocal.errors import ConfigError


def stream_path(results: str, sample: str) -> str:
    """Path of the calibration that is read from the recording of a sample."""
    return f"{results.rstrip('/')}/recordings/{sample}/calibration.xml"


def name_streams(rows: Iterable[MutableMapping[str, str]], results: str, where: str) -> None:
    """Put that path where rows of a sheet say `stream`.

    The surveyed samples of a scanner share one factory: what the recording of the first holds.

    Raises
    ------
    ConfigError
        If the scanner sends no calibration.
    """
    first: dict[str, str] = {}
    for row in rows:
        if row["calibration"] != "stream":
            continue
        name, scanner = row["sample"], row["scanner"]
        if not scanner.startswith("HDL-64E"):
            raise ConfigError(
                f"sample {name!r}: {scanner} sends no calibration in its packets",
                where=where,
                allowed="'stream' for HDL-64E (S2 from firmware 4.07 on) and HDL-64E-S3",
                hint="Name a calibration file, or `nominal`.",
            )
        source = first.setdefault(scanner, name) if "position" in row else name
        row["calibration"] = stream_path(results, source)
