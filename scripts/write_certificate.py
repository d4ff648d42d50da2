"""Certificate of every calibration, as JSON and as a page."""

import hashlib
from functools import cache
from pathlib import Path

from velocal.evaluation.certificate import Conditions, File, certificate
from velocal.evaluation.holdout import JudgedCalibration
from velocal.io import provenance, storage
from velocal.io.plain import from_plain, to_plain
from velocal.io.scripts import run
from velocal.reporting.certificate import render


@cache
def _sha256(path: Path) -> str:
    """Digest of a file; captures are large, and several calibrations may rest on one."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _files(role: str, paths: list[Path]) -> list[File]:
    return [File(role, path.name, _sha256(path)) for path in dict.fromkeys(paths)]


def main(
    *,
    units: list[Path],
    recordings: list[Path],
    ledgers: list[Path],
    surveys: list[Path],
    factory_files: list[Path],
    descriptions: list[Path],
    json: Path,
    html: Path,
    names: list[str],
    scanners: list[str],
    samples: list[list[str]],
    sample_names: list[str],
    positions: list[str],
    factories: list[str],
    described: list[str],
    serials: dict[str, str],
    simulated: bool,
) -> None:
    """Write the certificates of the calibrations `names` of `scanners`.

    `samples` and `factories` are those of every calibration: a factory is one of `factory_files`,
    or nominal. `recordings`, `ledgers` and `positions` are of `sample_names`. A sample without a
    survey has no position, and none of `surveys`. `descriptions` are of the scanners `described`.
    """
    facts = dict(zip(sample_names, map(storage.read_json, ledgers), strict=True))
    captures = dict(zip(sample_names, recordings, strict=True))
    stood = dict(zip(sample_names, positions, strict=True))
    surveyed = [name for name in sample_names if stood[name]]
    stations = dict(zip(surveyed, surveys, strict=True))
    found = []
    for path, name, scanner, own, factory in zip(
        units, names, scanners, samples, factories, strict=True
    ):
        judged = from_plain(JudgedCalibration, storage.read_json(path), str(path))
        files = _files("recording", [captures[sample] for sample in own])
        files += _files(
            "survey of a position", [stations[sample] for sample in own if stood[sample]]
        )
        files += _files(
            "calibration of the factory", [each for each in factory_files if str(each) == factory]
        )
        of_scanner = zip(described, descriptions, strict=True)
        files += _files(
            "description of the scanner", [each for known, each in of_scanner if known == scanner]
        )
        found.append(
            certificate(
                judged,
                scanner=scanner,
                serial=serials.get(scanner, ""),
                name=name,
                simulated=simulated,
                recordings=[Conditions.of(sample, stood[sample], facts[sample]) for sample in own],
                files=files,
                versions=provenance.versions(),
            )
        )
    storage.write_json(json, {"certificates": to_plain(found)})
    storage.write_text(html, render(found))


if "snakemake" in globals():
    run(main, snakemake)
