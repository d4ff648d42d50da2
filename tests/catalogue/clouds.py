"""Damaged clouds of points: sound ones of a VLP-16 by the ROS driver, with one fault each."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from support import clouds

from catalogue.case import Case, Outcome
from velocal.calibration.applied import AppliedCalibration
from velocal.calibration.dialects import DIALECTS
from velocal.scanner.models import SCANNERS
from velocal.scanner.parameters import nominal

_SCANNER = SCANNERS["VLP-16"]
_FIRINGS = 90


def _columns(**changes: np.ndarray | None) -> dict[str, np.ndarray]:
    """Points of some firings; fields that are None are left out."""
    laser = np.tile(np.arange(16), _FIRINGS)
    phi = np.repeat(np.linspace(0.0, 6.2, _FIRINGS), 16)
    applied = AppliedCalibration(DIALECTS["ros"], nominal(_SCANNER), _SCANNER, 10.0)
    right, forward, up = applied.points(np.full(len(phi), 8.0), phi, laser).T.astype("f4")
    ring = np.argsort(np.argsort(_SCANNER.vertical_rad))[laser].astype("u2")
    found = {"x": forward, "y": -right, "z": up, "intensity": np.full_like(up, 9), "ring": ring}
    changed = {**found, **changes}
    return {name: values for name, values in changed.items() if values is not None}


def _file(content: Callable[[], bytes], name: str = "a.pcd") -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes(content())


def _pcd(change: Callable[[bytes], bytes] = bytes, layout: str = "binary") -> Callable[[], bytes]:
    return lambda: change(clouds.pcd(_columns(), layout))


def _bag(*changes: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    """A file of a ROS 2 bag with a message for every change."""

    def make(folder: Path) -> None:
        sound = clouds.pointcloud2(_columns(), ros1=False)
        with tempfile.TemporaryDirectory() as place:
            path = Path(place) / "a"
            clouds.write_bag(path, [change(sound) for change in changes], ros1=False)
            (folder / "a.mcap").write_bytes(next(path.glob("*.mcap")).read_bytes())

    return make


def _with(name: str, value: float, rows: slice) -> np.ndarray:
    values = _columns()[name].copy()
    values[rows] = value
    return values


def _command(name: str = "a.pcd", **options: str) -> tuple[str, ...]:
    given = {"scanner": "VLP-16", "dialect": "ros"} | options
    return ("inspect", name, "--json", *(t for k, v in given.items() for t in (f"--{k}", v)))


_INSPECT = _command()

_REFUSED: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "PCD: a header that announces 10^12 points": (
        _file(lambda: clouds.pcd(_columns(), points=10**12)),
        _INSPECT,
    ),
    "PCD: cut in the middle": (_file(_pcd(lambda c: c[: len(c) // 2])), _INSPECT),
    "PCD: compressed, a tenth missing": (
        _file(_pcd(lambda c: c[: -len(c) // 10], "binary_compressed")),
        _INSPECT,
    ),
    "PCD: text, the last line missing": (
        _file(_pcd(lambda c: c[:-1].rpartition(b"\n")[0] + b"\n", "ascii")),
        _INSPECT,
    ),
    "PCD: no field z": (_file(lambda: clouds.pcd(_columns(z=None))), _INSPECT),
    "PCD: a ring of 1.5": (
        _file(lambda: clouds.pcd(_columns(ring=np.full(16 * _FIRINGS, 1.5, "f4")))),
        _INSPECT,
    ),
    "PCD: a ring that the scanner does not have": (
        _file(lambda: clouds.pcd(_columns(ring=np.full(16 * _FIRINGS, 31, "u2")))),
        _INSPECT,
    ),
    "PCD: header only": (_file(_pcd(lambda c: c.partition(b"POINTS")[0])), _INSPECT),
    "PCD: moved into another frame": (
        _file(lambda: clouds.pcd(_columns(z=_columns()["z"] + np.float32(1.8)))),
        _INSPECT,
    ),
    "PCD: a calibration that does not exist": (_file(_pcd()), _command(calibration="gone.csv")),
    "PCD: a program that is not known": (_file(_pcd()), _command(dialect="rviz")),
    "PCD: axes that are not known": (_file(_pcd()), _command(frame="enu")),
    "PCD: a scanner file that does not exist": (_file(_pcd()), _command(scanner="gone.yaml")),
    "PCD: no program named": (_file(_pcd()), ("inspect", "a.pcd", "--json")),
    "PLY: a list as a property of points": (
        _file(
            lambda: clouds.ply(_columns()).replace(b"float intensity", b"list int float i"), "a.ply"
        ),
        _command("a.ply"),
    ),
    "LAS: a header that announces 10^9 records": (
        _file(lambda: b"LASF" + bytes(96) + b"\0\0\0\x40" + bytes(300), "a.las"),
        _command("a.las"),
    ),
    "KITTI: three bytes too many": (_file(lambda: bytes(163), "a.bin"), _command("a.bin")),
    "KITTI: something else": (_file(lambda: b"text" * 100, "a.bin"), _command("a.bin")),
    "ROS 2 bag: clouds, no program named": (_bag(bytes), ("inspect", "a.mcap", "--json")),
    "ROS 2 bag: a topic that is not there": (
        _bag(bytes),
        _command("a.mcap", address="/points"),
    ),
    "Parquet: of something else": (
        _file(lambda: b"PAR1" + bytes(50) + b"PAR1", "a.parquet"),
        _command("a.parquet"),
    ),
}

#: Used as far as it is valid.
_TOLD: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "PCD: some points are NaN": (
        _file(lambda: clouds.pcd(_columns(x=_with("x", np.nan, slice(9))))),
        _INSPECT,
    ),
    "PCD: some points are zero": (
        _file(lambda: clouds.pcd(_columns(**{axis: _with(axis, 0.0, slice(9)) for axis in "xyz"}))),
        _INSPECT,
    ),
    "PCD: some points on the cone of no laser": (
        _file(lambda: clouds.pcd(_columns(z=_with("z", 5.0, slice(9))))),
        _INSPECT,
    ),
    "ROS 2 bag: a message of PointCloud2 cut": (
        _bag(bytes, lambda message: message[: len(message) // 2], bytes),
        _command("a.mcap"),
    ),
}

_USED: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "nothing: a sound PCD": (_file(_pcd()), _INSPECT),
    "nothing: a sound bag of PointCloud2": (_bag(bytes), _command("a.mcap")),
    "PCD: rings numbered from the highest down": (
        _file(lambda: clouds.pcd(_columns(ring=15 - _columns()["ring"]))),
        _INSPECT,
    ),
}

CASES = tuple(
    Case(wrong, outcome, make, command)
    for outcome, cases in (
        (Outcome.REFUSED, _REFUSED),
        (Outcome.TOLD, _TOLD),
        (Outcome.USED, _USED),
    )
    for wrong, (make, command) in cases.items()
)
