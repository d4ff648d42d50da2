"""What the readers of bags share: messages, stretches that cannot be used, bounds of memory."""

from __future__ import annotations

import bz2
import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

from velocal.errors import RecordingError

#: Largest chunk of a bag, and largest message, that is unpacked: ROS writes chunks of 1 to 4 MB.
MOST_BYTES = 1 << 26


@dataclass(frozen=True)
class Topic:
    """A topic of a bag.

    Attributes
    ----------
    name : str
    type : str
        Type of its messages, such as "velodyne_msgs/msg/VelodyneScan".
    ros1 : bool
        Whether messages are serialised as in ROS 1; as CDR if not.
    """

    name: str
    type: str
    ros1: bool


@dataclass(frozen=True)
class Message:
    """A message of a bag.

    Attributes
    ----------
    topic : Topic
    time_ns : int
        When it was recorded.
    data : bytes
        Serialised content.
    """

    topic: Topic
    time_ns: int
    data: bytes


@dataclass(frozen=True)
class Unusable:
    """A stretch of a bag that cannot be used.

    Attributes
    ----------
    reason : str
    bytes : int
        Bytes of the file.
    """

    reason: str
    bytes: int


Content = Iterator[Message | Unusable]


def missing_package(compression: str) -> RecordingError:
    """Error for a compression whose package is not installed."""
    return RecordingError(
        f"is a ROS bag compressed with {compression}, which needs another package",
        hint="Install it with `pip install rosbags`, which brings it.",
    )


def unpacked(data: bytes, compression: str) -> bytes | None:
    """Unpack a chunk or a message of a bag.

    Parameters
    ----------
    data : bytes
    compression : {"", "none", "bz2", "lz4", "zstd"}
        As the bag names it.

    Returns
    -------
    bytes or None
        None if the data are damaged, or unpack to more than `MOST_BYTES`.

    Raises
    ------
    RecordingError
        If the package for this compression is not installed.
    """
    if compression in ("", "none"):
        return data
    try:
        begin = _DECOMPRESSORS[compression]
    except KeyError:
        return None
    try:
        member = begin()
    except ImportError:
        raise missing_package(compression) from None
    try:
        content: bytes = member.decompress(data, MOST_BYTES + 1)
    except Exception:  # each package raises errors of its own on damaged data
        return None
    return content if member.eof and len(content) <= MOST_BYTES else None


def _lz4() -> Any:
    return importlib.import_module("lz4.frame").LZ4FrameDecompressor()


def _zstd() -> Any:
    try:
        module = importlib.import_module("compression.zstd")  # Python 3.14
    except ImportError:
        module = importlib.import_module("backports.zstd")
    return module.ZstdDecompressor()


_DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": _lz4,
    "zstd": _zstd,
}


def rest_of(file: BinaryIO, begin: int) -> int:
    """Bytes of a file from a byte on."""
    return file.seek(0, 2) - begin
