"""Faults of the machine: outputs that cannot be written, and files of our own that are damaged."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from support.capture import pcap, spin

from catalogue.calibrations import sound as sound_calibration
from catalogue.case import Case, Outcome
from velocal.io import schemas, storage

_DECODE = ("decode", "a.pcap", "-o")
_POINTS = ("points", "a.pcap", "-o")


def _recording(folder: Path) -> None:
    (folder / "a.pcap").write_bytes(pcap(spin(1000, step=15)))


def _calibration(folder: Path) -> None:
    sound_calibration(folder / "a.xml")


def _with(more: Callable[[Path], object]) -> Callable[[Path], object]:
    def make(folder: Path) -> None:
        _recording(folder)
        more(folder)

    return make


def _medians(
    change: Callable[[bytes], bytes] = lambda content: content,
) -> Callable[[Path], object]:
    def make(folder: Path) -> None:
        path, n = folder / "a.parquet", 1000
        columns = {
            "laser_id": np.arange(n) % 64, "azimuth": np.linspace(0, 36_000, n, endpoint=False),
            "distance": np.linspace(500, 60_000, n), "spread": np.ones(n),
            "count": np.arange(n) + 1,
        }  # fmt: skip
        kinds = {field.name: field.type.to_pandas_dtype() for field in schemas.MEDIANS}
        columns = {name: values.astype(kinds[name]) for name, values in columns.items()}
        storage.write_table(path, schemas.MEDIANS, columns)
        path.write_bytes(change(path.read_bytes()))

    return make


def _flipped(at: int) -> Callable[[bytes], bytes]:
    return lambda content: content[:at] + bytes([content[at] ^ 16]) + content[at + 1 :]


def _returns(folder: Path) -> None:
    columns = {f.name: np.zeros(5, dtype=f.type.to_pandas_dtype()) for f in schemas.RETURNS}
    storage.write_table(folder / "a.parquet", schemas.RETURNS, columns)


def _station(change: Callable[[dict], object] = lambda content: None) -> Callable[[Path], object]:
    def make(folder: Path) -> None:
        content = {
            "position": "P1", "scanner": "HDL-32E",
            "pose": {
                "name": "T_scanner_field", "rotation": np.eye(3).tolist(),
                "translation_m": [0.0, 0.0, 0.0], "covariance_rad_m": np.eye(6).tolist(),
                "targets": ["B1"], "residuals_m": [[0.0, 0.0, 0.0]], "variance_factor": 1.0,
                "redundancy": 6,
            },
            "planes": [],
        }  # fmt: skip
        change(content)
        (folder / "a.json").write_text(json.dumps(content))

    return make


def _set(place: tuple[str, ...], value: object) -> Callable[[Path], object]:
    def change(content: dict) -> None:
        for key in place[:-1]:
            content = content[key]
        content[place[-1]] = value

    return _station(change)


def _off_diagonal(size: int, value: float, *, mirrored: bool) -> list[list[float]]:
    matrix = np.eye(size)
    matrix[0, 1] = value
    if mirrored:
        matrix[1, 0] = value
    return matrix.tolist()


def _covariances(matrix: object) -> Callable[[Path], object]:
    base = {"P1": {"targets": ["B1"], "covariance_m2": matrix}}
    content = {"base_field": base, "planes": {}}
    return lambda folder: (folder / "a.json").write_text(json.dumps(content))


def _text(name: str, text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(text)


_STATION, _COVARIANCE = ("read", "station", "a.json"), ("read", "covariances", "a.json")
_MEDIANS, _COLUMNS = ("read", "medians", "a.parquet"), ("read", "columns", "a.csv")

_REFUSED: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "decode: the output is the recording": (_recording, (*_DECODE, "a.pcap")),
    "decode: the output is a folder": (
        _with(lambda f: (f / "b.parquet").mkdir()),
        (*_DECODE, "b.parquet"),
    ),
    "decode: the folder of the output is missing": (_recording, (*_DECODE, "gone/b.parquet")),
    "decode: the folder of the output is a file": (_recording, (*_DECODE, "a.pcap/b.parquet")),
    "decode: the output is a pipe": (
        _with(lambda f: os.mkfifo(f / "b.parquet")),
        (*_DECODE, "b.parquet"),
    ),
    "decode: a name of 300 characters": (_recording, (*_DECODE, "b" * 300 + ".parquet")),
    "points: the output is the recording": (
        _with(lambda f: (f / "a.pcap").rename(f / "a.ply")),
        ("points", "a.ply", "-o", "a.ply"),
    ),
    "points: the folder of the output is missing": (_recording, (*_POINTS, "gone/b.ply")),
    "convert: the output is a folder": (
        lambda folder: (_calibration(folder), (folder / "b.yaml").mkdir()),
        ("calibration", "convert", "a.xml", "b.yaml"),
    ),
    "init: a file in place of the folder": (_recording, ("init", "a.pcap")),
    "init: a study is there already": (_text("config.yaml", "study: a\n"), ("init", ".")),
    "recording: a link to itself": (
        lambda folder: (folder / "a.pcap").symlink_to("a.pcap"),
        ("inspect", "a.pcap", "--json"),
    ),
    "Parquet of ours: empty": (_medians(lambda _: b""), _MEDIANS),
    "Parquet of ours: cut in the middle": (_medians(lambda c: c[: len(c) // 2]), _MEDIANS),
    "Parquet of ours: a bit of a page flipped": (_medians(_flipped(1000)), _MEDIANS),
    "Parquet of ours: a bit of the footer flipped": (_medians(_flipped(-7)), _MEDIANS),
    "Parquet of ours: text": (_medians(lambda _: b"text" * 100), _MEDIANS),
    "Parquet of ours: of another kind": (_returns, _MEDIANS),
    "JSON of ours: empty": (_text("a.json", ""), _STATION),
    "JSON of ours: cut": (_text("a.json", '{"position": "P1", "pose": {'), _STATION),
    "JSON of ours: a list": (_text("a.json", "[]"), _STATION),
    "station: a value is missing": (_text("a.json", '{"position": "P1"}'), _STATION),
    "station: the pose is a number": (_set(("pose",), 5), _STATION),
    "station: rows of different lengths": (_set(("pose", "rotation"), [[1, 0], [0]]), _STATION),
    "station: covariance of 3 rows": (
        _set(("pose", "covariance_rad_m"), np.eye(3).tolist()),
        _STATION,
    ),
    "station: covariance that is not symmetric": (
        _set(("pose", "covariance_rad_m"), _off_diagonal(6, 0.5, mirrored=False)),
        _STATION,
    ),
    "station: covariance that is not positive semidefinite": (
        _set(("pose", "covariance_rad_m"), _off_diagonal(6, 2.0, mirrored=True)),
        _STATION,
    ),
    "station: a negative variance": (
        _set(("pose", "covariance_rad_m"), (-np.eye(6)).tolist()),
        _STATION,
    ),
    "survey covariance: not symmetric": (
        _covariances(_off_diagonal(3, 0.5, mirrored=False)),
        _COVARIANCE,
    ),
    "survey covariance: not positive semidefinite": (
        _covariances(_off_diagonal(3, 2.0, mirrored=True)),
        _COVARIANCE,
    ),
    "survey covariance: of more targets": (_covariances(np.eye(6).tolist()), _COVARIANCE),
    "survey covariance: NaN": (_covariances([[float("nan")] * 3] * 3), _COVARIANCE),
    "survey covariance: text": (_covariances("x"), _COVARIANCE),
    "survey covariance: empty": (_text("a.json", "{}"), _COVARIANCE),
    "CSV of ours: empty": (_text("a.csv", ""), _COLUMNS),
    "CSV of ours: a row with more values": (_text("a.csv", "a,b\n1,2\n1,2,3\n"), _COLUMNS),
}

#: Commands that write, and what they write to: the disk is full after some bytes.
_FULL = {
    "decode": (_recording, (*_DECODE, "b.parquet")),
    "points to PLY": (_recording, (*_POINTS, "b.ply")),
    "points to PCD": (_recording, (*_POINTS, "b.pcd")),
    "points to LAS": (_recording, (*_POINTS, "b.las")),
    "points to Parquet": (_recording, (*_POINTS, "b.parquet")),
    "convert to YAML": (_calibration, ("calibration", "convert", "a.xml", "b.yaml")),
    "convert to JSON": (_calibration, ("calibration", "convert", "a.xml", "b.json")),
    "diff to CSV": (_calibration, ("calibration", "diff", "a.xml", "a.xml", "--csv", "b.csv")),
    "init": (lambda folder: None, ("init", "study")),
}

CASES = (
    *(Case(wrong, Outcome.REFUSED, make, command) for wrong, (make, command) in _REFUSED.items()),
    *(
        Case(
            f"{command}: the disk is full",
            Outcome.REFUSED,
            make,
            arguments,
            disk_bytes=200,
        )
        for command, (make, arguments) in _FULL.items()
    ),
)
