"""Packets out of ROS 1 and ROS 2 bags with messages of type VelodyneScan.

A scan is a header and an array of packets, each a time and 1206 bytes. That is laid out evenly in
the serialised message, so it is viewed as an array and not taken apart one packet at a time.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from velocal.capture.chunk import Chunk
from velocal.capture.ledger import Ledger
from velocal.capture.udp import keep_valid
from velocal.errors import RecordingError
from velocal.packets.data import PAYLOAD_BYTES

_MAGIC = (b"#ROSBAG V", b"SQLite format 3\0", b"\x89MCAP0\r\n")
_SCAN = ("velodyne_msgs/msg/VelodyneScan", "velodyne_msgs/VelodyneScan")
_STAMP_BYTES = 8


def is_bag(head: bytes) -> bool:
    """Whether a file is a bag, by its first bytes."""
    return head.startswith(_MAGIC)


@contextmanager
def _opened(path: Path, head: bytes) -> Iterator[Any]:
    """Open a bag with the library for it.

    Raises
    ------
    RecordingError
        If the library is missing or the bag damaged.
    """
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    except ImportError:
        raise RecordingError(
            "is a ROS bag, which the package rosbags reads",
            where=str(path),
            hint="Install it with `pip install 'velocal[ros]'`.",
        ) from None
    try:
        with Reader1(path) if head.startswith(b"#ROSBAG") else Reader2(path) as reader:
            yield reader
    except RecordingError:
        raise
    except Exception as error:  # readers and their decompressors raise many kinds
        raise RecordingError(
            f"cannot be read as a ROS bag: {error}",
            where=str(path),
            hint="`ros2 bag reindex` or `rosbag reindex` may repair it.",
        ) from None


def topics(path: Path, head: bytes) -> dict[str, int]:
    """Count the messages of type VelodyneScan by topic.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file; empty for the folder of a ROS 2 bag.

    Returns
    -------
    dict of str to int

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
    with _opened(path, head) as reader:
        found: dict[str, int] = {}
        for connection in reader.connections:
            if connection.msgtype in _SCAN:
                found[connection.topic] = found.get(connection.topic, 0) + connection.msgcount
        return found


def chunks(path: Path, head: bytes, topic: str, ledger: Ledger) -> Iterator[Chunk]:
    """Read the valid packets of a topic, a message at a time.

    Parameters
    ----------
    path : Path
    head : bytes
        First bytes of the file; empty for the folder of a ROS 2 bag.
    topic : str
    ledger : Ledger
        Receives the bytes of all messages.

    Yields
    ------
    Chunk
        Its offsets count the bytes of all messages before it.

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
    position = 0
    ros1 = head.startswith(b"#ROSBAG")
    with _opened(path, head) as reader:
        for connection, time_ns, message in reader.messages():
            size = len(message)
            ledger.file_bytes += size
            if connection.msgtype not in _SCAN:
                ledger.reject(f"message of type {connection.msgtype}", 1, size)
            elif connection.topic != topic:
                ledger.reject(f"message of topic {connection.topic}", 1, size)
            else:
                yield from _packets(bytes(message), ros1, time_ns, position, ledger)
            position += size


def _packets(
    message: bytes, ros1: bool, time_ns: int, position: int, ledger: Ledger
) -> Iterator[Chunk]:
    """Packets of one message."""
    order = "<" if ros1 or message[1:2] == b"\x01" else ">"
    # ROS 1: sequence number, time, name; ROS 2 (CDR): encapsulation, time, name, 4-byte alignment.
    begin = 0 if ros1 else 4
    lead = 12 if ros1 else begin + _STAMP_BYTES
    try:
        (length,) = struct.unpack_from(order + "I", message, lead)
        at = lead + 4 + length
        at += 0 if ros1 else -(at - begin) % 4
        (n,) = struct.unpack_from(order + "I", message, at)
    except struct.error:
        ledger.reject("message cut short", 1, len(message))
        return
    at += 4
    stride = _STAMP_BYTES + PAYLOAD_BYTES + (0 if ros1 else -(_STAMP_BYTES + PAYLOAD_BYTES) % 4)
    # The last packet of a CDR message is not padded.
    content = message[at:] + bytes(-(_STAMP_BYTES + PAYLOAD_BYTES) % 4)
    whole = min(n, len(content) // stride)
    used = min(at + whole * stride, len(message))
    if whole < n:
        ledger.reject("message cut short", 1, len(message) - used)
    elif used < len(message):
        ledger.reject("bytes after the packets of a message", 1, len(message) - used)
    if whole == 0:
        ledger.framing_bytes += used
        return
    rows = np.frombuffer(content, np.uint8, whole * stride).reshape(whole, stride)
    stamps = np.ascontiguousarray(rows[:, :_STAMP_BYTES]).view(order + "u4").astype(np.float64)
    times = stamps[:, 0] + stamps[:, 1] * 1e-9
    if not times.any():
        times = np.full(whole, time_ns * 1e-9)
    offsets = position + at + stride * np.arange(whole, dtype=np.int64)
    sizes = np.full(whole, stride, dtype=np.int64)
    # The header of the message goes with its first packet.
    offsets[0] -= at
    sizes[0] += at
    sizes[-1] -= at + whole * stride - used
    payloads = rows[:, _STAMP_BYTES : _STAMP_BYTES + PAYLOAD_BYTES]
    end = position + len(message)
    yield keep_valid(Chunk(payloads, offsets, sizes, end, times), ledger)
