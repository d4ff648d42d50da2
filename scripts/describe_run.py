"""Describe a run as a Research Object Crate."""

import datetime
import hashlib
import os
from pathlib import Path

from velocal.io import provenance, storage
from velocal.io.scripts import run
from velocal.reporting.crate import Described, crate


def _described(path: Path, folder: Path) -> Described:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    name = path.relative_to(folder) if path.is_relative_to(folder) else path
    return Described(name.as_posix(), digest, path.stat().st_size)


def _today() -> str:
    """Day of the run, or the one that SOURCE_DATE_EPOCH tells, for builds that are compared."""
    told = os.environ.get("SOURCE_DATE_EPOCH")
    seconds = float(told) if told else datetime.datetime.now(datetime.UTC).timestamp()
    return datetime.datetime.fromtimestamp(seconds, datetime.UTC).date().isoformat()


def main(
    *, handed_over: list[Path], made: list[Path], metadata: Path, title: str, simulated: bool
) -> None:
    """Write the metadata of files `handed_over` by people and `made` by the run."""
    folder = metadata.parent
    content = crate(
        title,
        simulated=simulated,
        inputs=[_described(path, folder) for path in sorted(handed_over)],
        results=[_described(path, folder) for path in sorted(made)],
        versions=provenance.versions(),
        date=_today(),
    )
    storage.write_json(metadata, content)


if "snakemake" in globals():
    run(main, snakemake)
