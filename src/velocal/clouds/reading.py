"""Open a cloud of any format, and read its points a scan or some thousand at a time."""

from __future__ import annotations

import stat
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from velocal.capture import rosbag
from velocal.clouds import kitti, las, pcd, ply, pointcloud2
from velocal.clouds.block import PointBlock, block_of
from velocal.clouds.origin import Origin, facts_of
from velocal.errors import RecordingError
from velocal.io import schemas, storage

_PARQUET = b"PAR1"
_KINDS = (
    ".pcd, .ply, .las, .laz, .parquet of velocal, .bin of KITTI, .pcd.bin of nuScenes, or a ROS "
    "bag with messages of type PointCloud2"
)
_Columns = dict[str, NDArray[Any]]


@dataclass
class CloudFile:
    """An opened cloud; see `open_cloud`.

    Attributes
    ----------
    path : Path
    kind : str
        Format, for people.
    frame : {"velocal", "ros"} or None
        Axes of the format: X forward and Y left in ROS and KITTI; None where it does not say.
    origin : Origin or None
        How the points were made, where `velocal points` has made them.
    stamps_s : list of float
        Time of every message of a bag; filled while the blocks are read.
    lost : Counter of str
        Why messages and stretches of a bag are not used; filled while the blocks are read.
    """

    path: Path
    kind: str
    frame: str | None
    origin: Origin | None
    read: Callable[[], Iterator[_Columns]] = field(repr=False)
    stamps_s: list[float] = field(default_factory=list)
    lost: Counter[str] = field(default_factory=Counter)

    @property
    def bytes(self) -> int:
        """Bytes of the file, or of all files of the folder."""
        files = [self.path]
        if self.path.is_dir():
            files = [each for each in self.path.iterdir() if each.is_file()]
        return sum(each.stat().st_size for each in files)

    def blocks(self) -> Iterator[PointBlock]:
        """Points in the order of the file.

        Yields
        ------
        PointBlock
            A message of a bag, a file of a folder, or some thousand points.

        Raises
        ------
        RecordingError
            If the file is damaged, or has no coordinates.
        """
        scans = self.kind.startswith("ROS") or self.path.is_dir()
        for number, columns in enumerate(self.read()):
            yield block_of(columns, number if scans else 0, str(self.path))


def open_cloud(path: Path, topic: str | None = None) -> CloudFile:
    """Open a cloud; what it is, its first bytes and its suffix tell.

    Parameters
    ----------
    path : Path
        File; or a folder with a scan in every file (KITTI, PCD), or of a ROS 2 bag.
    topic : str, optional
        Topic of the clouds in a bag, where it has several.

    Returns
    -------
    CloudFile

    Raises
    ------
    RecordingError
        If there is no such file, it is of no kind that is known, or a bag has no such clouds.
    """
    try:
        mode = path.stat().st_mode
        head = b"" if stat.S_ISDIR(mode) else _head(path, mode)
    except OSError as error:
        raise RecordingError(f"cannot be read: {error.strerror}", where=str(path)) from None
    if stat.S_ISDIR(mode):
        scans = _scans(path)
        if scans:
            return _of_scans(path, scans)
    if stat.S_ISDIR(mode) or rosbag.is_bag(head):
        return _of_bag(path, topic)
    return _of_file(path, head)


def _head(path: Path, mode: int) -> bytes:
    if not stat.S_ISREG(mode):
        raise RecordingError("is no regular file", where=str(path))
    with path.open("rb") as file:
        return file.read(64)


def _of_file(path: Path, head: bytes) -> CloudFile:
    """One file that is no bag."""
    if head.startswith(ply.MAGIC):
        origin = Origin.from_facts(facts_of(ply.comment(path)))
        return CloudFile(path, "PLY", None, origin, lambda: ply.blocks(path))
    if head.startswith(pcd.MAGIC) or path.suffix.lower() == ".pcd":
        origin = Origin.from_facts(facts_of(pcd.comment(path)))
        return CloudFile(path, "PCD", None, origin, lambda: pcd.blocks(path))
    if head.startswith(las.MAGIC):
        origin = Origin.from_facts(facts_of(las.comment(path)))
        return CloudFile(path, "LAS", None, origin, lambda: las.blocks(path))
    if head.startswith(_PARQUET):
        columns, facts = _parquet(path)
        origin = Origin.from_facts(facts)
        return CloudFile(path, "Parquet of velocal", None, origin, lambda: iter([columns]))
    if path.suffix.lower() == ".bin":
        kind = "nuScenes" if path.name.endswith(".pcd.bin") else "KITTI"
        return CloudFile(path, kind, "ros", None, lambda: kitti.blocks(path))
    raise RecordingError("is no cloud of points", where=str(path), allowed=_KINDS)


def _parquet(path: Path) -> tuple[_Columns, dict[str, Any]]:
    """Points that `velocal points` has written, with or without a shift."""
    schema = schemas.POINTS
    if "shift" not in storage.column_names(path):
        fields = [each for each in schema if each.name != "shift"]
        schema = pa.schema(fields, metadata=schema.metadata)
    return storage.read_table(path, schema)


def _of_bag(path: Path, topic: str | None) -> CloudFile:
    """A bag, of which one topic is read."""
    name = pointcloud2.topic_of_cloud(path, topic)
    found = CloudFile(path, f"ROS bag, topic {name}", "ros", None, lambda: iter(()))

    def read() -> Iterator[_Columns]:
        for stamp, columns in pointcloud2.blocks(path, name, found.lost):
            found.stamps_s.append(stamp)
            yield columns

    found.read = read
    return found


def _scans(folder: Path) -> list[Path]:
    """Files of a folder that hold one scan each, in the order of their names."""
    found = [each for each in folder.iterdir() if each.suffix.lower() in (".bin", ".pcd", ".ply")]
    return sorted(found, key=lambda each: (len(each.name), each.name))


def _of_scans(folder: Path, scans: list[Path]) -> CloudFile:
    """A folder with a scan in every file; all are of the kind of the first."""
    opened = [open_cloud(path) for path in scans]
    first = opened[0]
    for each in opened:
        if each.kind != first.kind:
            raise RecordingError(
                f"is {each.kind}; the first file of its folder is {first.kind}",
                where=str(each.path),
                hint="Put the scans of one recording into a folder of their own.",
            )

    def read() -> Iterator[_Columns]:
        for each in opened:
            parts = list(each.read())
            names = (
                [name for name in parts[0] if all(name in part for part in parts)] if parts else []
            )
            if parts:
                yield {name: np.concatenate([part[name] for part in parts]) for name in names}

    kind = f"{first.kind}, {len(scans)} scans"
    return CloudFile(folder, kind, first.frame, first.origin, read)
