"""`stream` in a sheet: the factory's calibration is read from a recording's own status bytes."""

from __future__ import annotations

from collections.abc import Iterable, MutableMapping

from velocal.errors import ConfigError
from velocal.scanner.models import scanner_named


def stream_path(results: str, sample: str) -> str:
    """Path of the calibration that is read from the recording of a sample."""
    return f"{results.rstrip('/')}/recordings/{sample}/calibration.xml"


def name_streams(
    rows: Iterable[MutableMapping[str, str]],
    results: str,
    where: str,
    first: dict[str, str] | None = None,
) -> None:
    """Put that path where rows of a sheet say `stream`.

    Parameters
    ----------
    rows : iterable of mapping
        Of a sheet.
    results, where : str
        Folder of the results; how to call the sheet in errors.
    first : dict of str to str, optional
        First sample of every scanner so far, filled: samples share what its recording holds.
        Without it every recording is its own source.

    Raises
    ------
    ConfigError
        If the scanner sends no calibration.
    """
    for row in rows:
        if row["calibration"] != "stream":
            continue
        name, scanner = row["sample"], row["scanner"]
        if not scanner_named(scanner, where=where).embeds_calibration:
            raise ConfigError(
                f"sample {name!r}: {scanner} sends no calibration in its packets",
                where=where,
                allowed="'stream' for HDL-64E (S2 from firmware 4.07 on) and HDL-64E-S3",
                hint="Name a calibration file, or `nominal`.",
            )
        source = name if first is None else first.setdefault(scanner, name)
        row["calibration"] = stream_path(results, source)
