"""Faulty calibration files: a sound one of our own writer, in which a text is replaced."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from catalogue.case import Case, Outcome
from velocal.calibration.files import formats
from velocal.calibration.files.document import CalibrationFile
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

SCANNER = "VLP-16"


def sound(path: Path) -> str:
    """Write a sound calibration in the format of the suffix, and return its text."""
    parameters = nominal(SCANNERS[SCANNER])
    n = len(parameters)
    zeros = {"dl": parameters.dl * 0 + 0.01, "alpha": parameters.alpha * 0 + 0.001}
    whole = CalibrationFile(parameters, "paper", SCANNER, std=zeros,
                            covariance={("dl", "alpha"): zeros["dl"] * 0})  # fmt: skip
    formats.write(path, whole if path.suffix == ".json" else parameters)
    assert n == 16
    return path.read_text()


def changed(name: str, old: str, new: str, count: int = 1) -> Callable[[Path], None]:
    """Replace what a regular expression finds."""

    def make(folder: Path) -> None:
        text, found = re.subn(old, new.replace("\\", "\\\\"), sound(folder / name), count=count)
        assert found, (old, text[:500])
        (folder / name).write_text(text)

    return make


def whole(name: str, content: str | bytes) -> Callable[[Path], None]:
    """A file with some content."""
    data = content.encode() if isinstance(content, str) else content
    return lambda folder: (folder / name).write_bytes(data)


def shortened(name: str, share: float) -> Callable[[Path], None]:
    """Keep the first part of the sound file."""

    def make(folder: Path) -> None:
        text = sound(folder / name)
        (folder / name).write_text(text[: int(len(text) * share)])

    return make


XML, YAML, JSON, CSV = "a.xml", "a.yaml", "a.json", "a.csv"
_BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{k}: &{k} [{', '.join([f'*{chr(ord(k) - 1)}'] * 9)}]\n" for k in "bcdefghi"
)
_ENTITIES = (
    '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {k} "{f"&{chr(ord(k) - 1)};" * 10}">' for k in "bcdefghi")
    + "]><boost_serialization><DB>&i;</DB></boost_serialization>"
)

#: What is wrong, the file, how it is made; refused by every command that reads it.
_REFUSED = {
    "XML: empty file": (XML, whole(XML, "")),
    "XML: the web page of a repository instead of its file": (
        XML,
        whole(XML, "<!DOCTYPE html><html></html>"),
    ),
    "XML: cut in the middle": (XML, shortened(XML, 0.5)),
    "XML: entities that multiply": (XML, whole(XML, _ENTITIES)),
    "XML: an entity that names a file": (
        XML,
        whole(
            XML,
            '<!DOCTYPE x [<!ENTITY a SYSTEM "/etc/hostname">]><boost_serialization>&a;'
            "</boost_serialization>",
        ),
    ),
    "XML: of another program": (XML, whole(XML, "<svg></svg>")),
    "XML: unknown encoding": (XML, changed(XML, "UTF-8", "klingon")),
    "XML: no distance correction": (XML, changed(XML, "<distCorrection_>.*", "")),
    "XML: text in place of a number": (
        XML,
        changed(XML, "<vertCorrection_>.*<", "<vertCorrection_>up<"),
    ),
    "XML: infinite number": (XML, changed(XML, "<rotCorrection_>.*<", "<rotCorrection_>inf<")),
    "XML: number beyond the range of a float": (
        XML,
        changed(XML, "<rotCorrection_>.*<", "<rotCorrection_>1e999<"),
    ),
    "XML: decimal comma": (XML, changed(XML, "<vertCorrection_>.*<", "<vertCorrection_>-15,0<")),
    "XML: vertical angle of 95 deg": (
        XML,
        changed(XML, "<vertCorrection_>.*<", "<vertCorrection_>95<"),
    ),
    "XML: laser id 1.5": (XML, changed(XML, "<id_>3<", "<id_>1.5<")),
    "XML: laser id twice": (XML, changed(XML, "<id_>3<", "<id_>2<")),
    "XML: distance tick of 20 cm": (XML, changed(XML, "<distLSB_>.*<", "<distLSB_>20<")),
    "XML: distance tick of 0": (XML, changed(XML, "<distLSB_>.*<", "<distLSB_>0<")),
    "YAML: empty file": (YAML, whole(YAML, "")),
    "YAML: no lasers": (YAML, whole(YAML, "lasers: []\nnum_lasers: 0\n")),
    "YAML: aliases that multiply": (YAML, whole(YAML, _BOMB)),
    "YAML: an alias that contains itself": (YAML, whole(YAML, "lasers: &a [*a]\n")),
    "YAML: lists 3000 deep": (YAML, whole(YAML, "[" * 3000 + "]" * 3000)),
    "YAML: tag of a Python object": (
        YAML,
        whole(YAML, "lasers: !!python/object/apply:os.getcwd []\n"),
    ),
    "YAML: `!!int ''`": (YAML, changed(YAML, "num_lasers: 16", "num_lasers: !!int ''")),
    "YAML: `!!float ''`": (YAML, changed(YAML, "num_lasers: 16", "num_lasers: !!float ''")),
    "YAML: `!!timestamp x`": (YAML, changed(YAML, "num_lasers: 16", "num_lasers: !!timestamp x")),
    "YAML: `!!bool x`": (YAML, changed(YAML, "num_lasers: 16", "num_lasers: !!bool x")),
    "YAML: a date that is none": (YAML, changed(YAML, "num_lasers: 16", "num_lasers: 2020-99-99")),
    "YAML: a whole number of 5000 digits": (
        YAML,
        changed(YAML, "num_lasers: 16", "num_lasers: " + "9" * 5000),
    ),
    "YAML: indented with a tab": (YAML, whole(YAML, "lasers:\n\t- laser_id: 0\n")),
    "YAML: not UTF-8": (YAML, whole(YAML, "lasers: [k\xe4]".encode("latin-1"))),
    "YAML: `lasers` is no list": (YAML, whole(YAML, "lasers: {laser_id: 0}\n")),
    "YAML: a laser is a number": (YAML, whole(YAML, "lasers: [1, 2]\n")),
    "YAML: num_lasers is wrong": (YAML, changed(YAML, "num_lasers: 16", "num_lasers: 17")),
    "YAML: a value is null": (YAML, changed(YAML, "vert_correction: .*", "vert_correction: null")),
    "YAML: a value is .nan": (YAML, changed(YAML, "vert_correction: .*", "vert_correction: .nan")),
    "YAML: a value is true": (YAML, changed(YAML, "rot_correction: .*", "rot_correction: true")),
    "YAML: a value is a list": (YAML, changed(YAML, "rot_correction: .*", "rot_correction: [1]")),
    "YAML: degrees": (YAML, changed(YAML, "vert_correction: .*", "vert_correction: -15.0")),
    "YAML: laser ids from 1": (YAML, changed(YAML, "laser_id: 0\n", "laser_id: 16\n")),
    "JSON: of another program": (JSON, whole(JSON, '{"a": 1}')),
    "JSON: no JSON": (JSON, whole(JSON, "{")),
    "JSON: lists 100,000 deep": (JSON, whole(JSON, "[" * 100_000)),
    "JSON: `scanner: [1]`": (JSON, changed(JSON, '"scanner": "VLP-16"', '"scanner": [1]')),
    "JSON: unknown scanner": (JSON, changed(JSON, '"scanner": "VLP-16"', '"scanner": "VLP-17"')),
    "JSON: unknown dialect": (JSON, changed(JSON, '"dialect": "paper"', '"dialect": "klingon"')),
    "JSON: version 2": (JSON, changed(JSON, '"version": 1', '"version": 2')),
    "JSON: unknown key": (JSON, changed(JSON, '"provenance"', '"x": 1, "provenance"')),
    "JSON: provenance is a list": (JSON, changed(JSON, '"provenance": {}', '"provenance": []')),
    "JSON: NaN": (JSON, changed(JSON, '"v_rad": [^,]*', '"v_rad": NaN')),
    "JSON: negative standard deviation": (
        JSON,
        changed(JSON, '"std": {"dl_m": 0.01', '"std": {"dl_m": -0.01'),
    ),
    "JSON: covariance larger than the standard deviations allow": (
        JSON,
        changed(JSON, '"dl_m\\*alpha_rad": [-0.]*', '"dl_m*alpha_rad": 1.0'),
    ),
    "JSON: covariance is a list": (
        JSON,
        changed(JSON, '"covariance": {[^}]*}', '"covariance": [1]'),
    ),
    "JSON: covariance of an unknown pair": (
        JSON,
        changed(JSON, '"dl_m\\*alpha_rad"', '"dl_m*dl_m"'),
    ),
    "CSV: empty file": (CSV, whole(CSV, "")),
    "CSV: unknown column": (CSV, changed(CSV, "dl_m", "dl_mm")),
    "CSV: column twice": (CSV, changed(CSV, "voff_m", "dl_m")),
    "CSV: separated by semicolons": (CSV, changed(CSV, ",", ";", 0)),
    "CSV: a row with one value more": (CSV, changed(CSV, "\n3,", "\n3,0.0,")),
    "CSV: a quote that is not closed": (CSV, changed(CSV, "\n3,", '\n"3,')),
    "CSV: bytes that are no text": (CSV, whole(CSV, b"laser_id,\xff\xfe\n")),
    "CSV: a laser is missing": (CSV, changed(CSV, "\n3,.*", "")),
    "unknown suffix": ("a.txt", whole("a.txt", "x")),
    "no such file": ("gone.xml", lambda _: None),
    "a folder": ("a.xml", lambda folder: (folder / "a.xml").mkdir()),
}

#: What is sound to read, and only the linter tells.
_TOLD = {
    "lint: XML without the list of enabled lasers, filled with zeros": (
        XML,
        changed(XML, "<vertOffsetCorrection_>.*<", "<vertOffsetCorrection_>300<"),
    ),
    "lint: angles of all lasers in another unit": (
        YAML,
        changed(YAML, "vert_correction: (.*)", "vert_correction: 0.001", 0),
    ),
    "lint: JSON with an impossible covariance": (
        JSON,
        changed(JSON, '"dl_m\\*alpha_rad": [-0.]*', '"dl_m*alpha_rad": 1.0'),
    ),
    "lint: distance correction of 20 m": (
        YAML,
        changed(YAML, "dist_correction: .*", "dist_correction: 20.0"),
    ),
}

#: What is read as it stands.
_USED = {
    "CSV: byte order mark and Windows ends of lines": (
        CSV,
        lambda folder: (folder / CSV).write_bytes(
            b"\xef\xbb\xbf" + sound(folder / CSV).replace("\n", "\r\n").encode()
        ),
    ),
    "YAML: key twice, as drivers read it": (
        YAML,
        changed(YAML, "num_lasers: 16", "num_lasers: 16\nnum_lasers: 16"),
    ),
    "YAML: laser ids as 0.0, 1.0": (YAML, changed(YAML, "laser_id: 3\n", "laser_id: 3.0\n")),
    "XML: the misspelt tag of VLS-128 files": (
        XML,
        changed(XML, "horizOffsetCorrection_", "horizOffsetCorection_", 0),
    ),
    "JSON: unknown standard deviations": (JSON, changed(JSON, '"dl_m": 0.01', '"dl_m": null')),
}

CASES = (
    *(
        Case(wrong, Outcome.REFUSED, make, ("calibration", "show", name))
        for wrong, (name, make) in _REFUSED.items()
    ),
    *(
        Case(wrong, Outcome.TOLD, make, ("calibration", "lint", name))
        for wrong, (name, make) in _TOLD.items()
    ),
    *(
        Case(wrong, Outcome.USED, make, ("calibration", "show", name))
        for wrong, (name, make) in _USED.items()
    ),
    Case(
        "convert: a target without a known suffix",
        Outcome.REFUSED,
        lambda folder: sound(folder / XML),
        ("calibration", "convert", XML, "b.txt"),
    ),
    Case(
        "convert: unknown dialect",
        Outcome.REFUSED,
        lambda folder: sound(folder / XML),
        ("calibration", "convert", XML, "b.yaml", "--to", "x"),
    ),
    Case(
        "convert: unknown scanner",
        Outcome.REFUSED,
        lambda folder: sound(folder / XML),
        ("calibration", "convert", XML, "b.yaml", "--scanner", "VLP16"),
    ),
    Case(
        "diff: calibrations of 16 and of 32 lasers",
        Outcome.REFUSED,
        lambda folder: (
            sound(folder / XML),
            formats.write(folder / CSV, nominal(SCANNERS["HDL-32E"])),
        ),
        ("calibration", "diff", XML, CSV),
    ),
    Case(
        "diff: ranges that are no numbers",
        Outcome.REFUSED,
        lambda folder: sound(folder / XML),
        ("calibration", "diff", XML, XML, "--ranges", "3;10"),
    ),
    Case(
        "read for a scanner with other lasers",
        Outcome.REFUSED,
        lambda folder: sound(folder / XML),
        ("calibration", "show", XML, "--scanner", "HDL-32E"),
    ),
)
