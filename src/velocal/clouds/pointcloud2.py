"""Points out of messages of the type sensor_msgs/PointCloud2, in bags of ROS 1 and ROS 2.

A message is a header, height and width, a description of the fields, and rows of points. ROS 1
writes the parts one after the other; CDR (ROS 2) aligns numbers of four bytes to multiples of four.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.capture import rosbag
from velocal.capture.bag_message import Message, Topic, Unusable, unpacked
from velocal.clouds.packed import MOST_FIELDS, ROW_BYTES
from velocal.errors import RecordingError

#: Datatypes 1 to 8 of sensor_msgs/PointField.
_KINDS = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_LONGEST_NAME = 1024
_ZSTD = b"\x28\xb5\x2f\xfd"


class _MessageError(Exception):
    """What is wrong with a message."""


@dataclass
class _Reader:
    """Parts of a message, one after the other."""

    data: bytes
    order: str
    cdr: bool
    at: int

    def take(self, form: str) -> Any:
        size = struct.calcsize(form)
        if self.cdr:  # alignment counts from behind the four bytes of the encapsulation
            self.at += -(self.at - 4) % size
        if self.at + size > len(self.data):
            raise _MessageError("message cut short")
        (value,) = struct.unpack_from(self.order + form, self.data, self.at)
        self.at += size
        return value

    def text(self) -> str:
        size = self.take("I")
        if size > _LONGEST_NAME or self.at + size > len(self.data):
            raise _MessageError("message with a damaged text")
        value = self.data[self.at : self.at + size]
        self.at += size
        return value.rstrip(b"\0").decode("utf-8", "replace")


def is_cloud(topic: Topic) -> bool:
    """Whether the messages of a topic are clouds."""
    return topic.type.rpartition("/")[2] == "PointCloud2"


def topic_of_cloud(path: Path, topic: str | None) -> str:
    """Topic of the clouds that are meant.

    Parameters
    ----------
    path : Path
        File, or folder of a ROS 2 bag.
    topic : str or None
        Topic that is asked for; None if there can be only one.

    Returns
    -------
    str

    Raises
    ------
    RecordingError
        If no topic could be meant, or several.
    """
    counts = rosbag.topics(path)
    found = rosbag.by_name(counts, is_cloud)
    if not found:
        raise RecordingError(
            f"is a ROS bag without messages of type PointCloud2; {rosbag.contents(counts)}",
            where=str(path),
            hint="Record the topic of the points, such as /velodyne_points.",
        )
    missing = f"holds no clouds of the topic {topic!r}"
    return rosbag.one_topic(path, found, topic, missing, f"holds clouds of {len(found)} topics")


def blocks(
    path: Path, topic: str, lost: Counter[str]
) -> Iterator[tuple[float, dict[str, NDArray[Any]]]]:
    """Read the clouds of a topic, a message at a time.

    Parameters
    ----------
    path : Path
        File, or folder of a ROS 2 bag.
    topic : str
    lost : Counter of str
        Receives why messages and stretches of the bag are not used.

    Yields
    ------
    stamp_s : float
        Time of the message.
    columns : dict of str to ndarray, shape (n,)

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
    for file in rosbag.files(path):
        for part in rosbag.messages(file):
            if isinstance(part, Unusable):
                lost[part.reason] += 1
            elif is_cloud(part.topic) and part.topic.name == topic:
                try:
                    yield parse(part)
                except _MessageError as error:
                    lost[str(error)] += 1


def parse(message: Message) -> tuple[float, dict[str, NDArray[Any]]]:
    """Time and fields of one message.

    Parameters
    ----------
    message : Message

    Returns
    -------
    stamp_s : float
        Time of its header, or of its recording where that is zero.
    columns : dict of str to ndarray, shape (n,)
        Fields with one number a point.

    Raises
    ------
    _MessageError
        If it is damaged.
    """
    data, ros1 = message.data, message.topic.ros1
    if data.startswith(_ZSTD) and not ros1:
        data = unpacked(data, "zstd") or b""
        if not data:
            raise _MessageError("message that cannot be unpacked")
    big = not ros1 and data[1:2] != b"\x01"
    read = _Reader(data, ">" if big else "<", cdr=not ros1, at=0 if ros1 else 4)
    if ros1:
        read.take("I")  # sequence number
    seconds, nanoseconds = read.take("I"), read.take("I")
    read.text()  # name of the frame
    height, width = read.take("I"), read.take("I")
    kind_of = _fields(read)
    order = ">" if read.take("B") else "<"
    step, row = read.take("I"), read.take("I")
    size = read.take("I")
    if size > len(data) - read.at:
        raise _MessageError("message cut short")
    if not 0 < step <= ROW_BYTES or height * width * step > size or row * height > size:
        raise _MessageError("message whose points do not fit into its data")
    if height > 1 and row < width * step:
        raise _MessageError("message whose points do not fit into its rows")
    kind = kind_of(order, step)
    content = np.frombuffer(data, np.uint8, size, read.at)
    if height > 1:
        content = np.ascontiguousarray(
            content[: height * row].reshape(height, row)[:, : width * step]
        ).reshape(-1)
    rows = content[: height * width * step].view(kind)
    stamp = seconds + nanoseconds * 1e-9 if seconds or nanoseconds else message.time_ns * 1e-9
    return stamp, {name: rows[name] for name in kind.names or ()}


def _fields(read: _Reader) -> Any:
    """Type of a point by the order of its bytes and its size, as the message describes it."""
    number = read.take("I")
    if number > MOST_FIELDS:
        raise _MessageError("message with too many fields")
    found: dict[str, tuple[str, int]] = {}
    for _ in range(number):
        name, offset, datatype, count = read.text(), read.take("I"), read.take("B"), read.take("I")
        if not 1 <= datatype <= len(_KINDS):
            raise _MessageError("message with a field of an unknown type")
        if count <= 1 and name:
            found.setdefault(name, (_KINDS[datatype - 1], offset))

    def kind(order: str, step: int) -> np.dtype[Any]:
        if any(offset + int(form[1:]) > step for form, offset in found.values()):
            raise _MessageError("message with a field outside of its points")
        return np.dtype(
            {
                "names": list(found),
                "formats": [order + form for form, _ in found.values()],
                "offsets": [offset for _, offset in found.values()],
                "itemsize": step,
            }
        )

    return kind
