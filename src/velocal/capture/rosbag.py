"""Packets out of ROS 1 and ROS 2 bags with messages of type VelodyneScan, of any package.

A scan is a header and an array of packets, each a time and 1206 bytes. That is laid out evenly in
the serialised message, so it is viewed as an array and not taken apart one packet at a time.
"""

from __future__ import annotations

import sqlite3
import stat
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from velocal.capture import mcap, ros1_bag, ros2_db3
from velocal.capture.bag_message import Message, Topic, Unusable, unpacked
from velocal.capture.chunk import Chunk
from velocal.capture.ledger import Ledger
from velocal.capture.source import listed
from velocal.capture.udp import keep_valid
from velocal.errors import RecordingError
from velocal.packets.data import PAYLOAD_BYTES

_SUFFIXES = (".db3", ".mcap")
_BY_TOPIC = "Choose one by its topic, as --address or, in a study, as `address`."
_MAGIC = (b"#ROSBAG V", ros2_db3.MAGIC, mcap.MAGIC)
_MAGIC_BYTES = max(map(len, _MAGIC))
#: First bytes of a message that the bag has compressed by itself.
_ZSTD = b"\x28\xb5\x2f\xfd"
_STAMP_BYTES = 8
#: Types whose messages hold points instead of packets.
_CLOUDS = ("PointCloud2", "PointCloud", "LaserScan")

_REINDEX = "`ros2 bag reindex` or `rosbag reindex` may repair it."


def is_bag(head: bytes) -> bool:
    """Whether a file is a bag, by its first bytes."""
    return head.startswith(_MAGIC)


def is_scan(topic: Topic) -> bool:
    """Whether the messages of a topic are scans of a Velodyne scanner, of whatever package."""
    return topic.type.rpartition("/")[2] == "VelodyneScan"


def by_name(counts: Mapping[Topic, int], wanted: Callable[[Topic], bool]) -> Counter[str]:
    """Count the messages of the topics that are wanted, by the name of the topic."""
    found: Counter[str] = Counter()
    for topic, n in counts.items():
        if wanted(topic):
            found[topic.name] += n
    return found


def contents(counts: Mapping[Topic, int]) -> str:
    """Write what messages a bag holds, for errors."""
    types = {f"{topic.name} of type {topic.type}": n for topic, n in counts.items()}
    return f"it holds {listed(types, 'messages') if types else 'no messages'}"


def files(path: Path) -> list[Path]:
    """Files of a bag: of the folder of a ROS 2 bag in the order of their numbers.

    Raises
    ------
    RecordingError
        If a folder has no such file, or one that is no regular file.
    """
    if not path.is_dir():
        return [path]
    # Names end with a number without leading zeros.
    names = (name for name in path.iterdir() if name.suffix in _SUFFIXES)
    found = sorted(names, key=lambda each: (len(each.name), each.name))
    if not found:
        packed = sorted(each.name for each in path.iterdir() if each.suffix == ".zstd")
        raise RecordingError(
            "cannot be read: a folder without a file of a ROS 2 bag",
            where=str(path),
            allowed="a folder with .db3 or .mcap files",
            hint=f"Unpack it with `zstd -d {packed[0]}`." if packed else "Check the path.",
        )
    for each in found:
        if not stat.S_ISREG(each.stat().st_mode):
            raise RecordingError("is no regular file", where=str(each))
    return found


def topics(path: Path) -> Counter[Topic]:
    """Count the messages of a bag by topic.

    The index at the end of a file is used if it has one. If not, all messages are read.

    Parameters
    ----------
    path : Path
        File, or folder of a ROS 2 bag.

    Returns
    -------
    Counter of Topic

    Raises
    ------
    RecordingError
        If the bag cannot be read.
    """
    found: Counter[Topic] = Counter()
    for file in files(path):
        counts = _by_index(file)
        if not any(is_scan(topic) for topic in counts):
            seen = Counter(part.topic for part in messages(file) if isinstance(part, Message))
            counts = Counter({topic: seen[topic] for topic in {**counts, **seen}})
        for topic, n in counts.items():
            found[topic] += n
    return found


def topic_of_scanner(path: Path, address: str | None, meant: str, *, port: bool) -> str:
    """Topic of the scanner that is meant.

    Parameters
    ----------
    path : Path
        File, or folder of a ROS 2 bag.
    address : str or None
        Topic that is asked for; None if there can be only one.
    meant : str
        What is asked for, for the error.
    port : bool
        Whether a port is asked for, which messages do not have.

    Returns
    -------
    str

    Raises
    ------
    RecordingError
        If no topic could be meant, or several.
    """
    counts = topics(path)
    scans = by_name(counts, is_scan)
    if not scans:
        parts = (part for file in files(path) for part in messages(file))
        damage = Counter(part.reason for part in parts if isinstance(part, Unusable))
        what = contents(counts)
        what += "".join(f"; {reason} ({n})" for reason, n in damage.items())
        hint = "Record the topic /velodyne_packets."
        if any(topic.type.rpartition("/")[2] in _CLOUDS for topic in counts):
            hint += (
                " Clouds of points were computed with a calibration already; to calibrate on them, "
                "name the program that computed them (`dialect`)."
            )
        raise RecordingError(
            f"is a ROS bag without messages of type VelodyneScan; {what}",
            where=str(path),
            hint=_REINDEX if damage else hint,
        )
    if port:
        raise _no_such_topic(path, scans, f"holds no messages {meant}")
    several = f"holds data of {len(scans)} scanners"
    return one_topic(path, scans, address, f"holds no messages {meant}", several)


def one_topic(
    path: Path, found: Mapping[str, int], topic: str | None, missing: str, several: str
) -> str:
    """Topic that is asked for, or the only one.

    Parameters
    ----------
    path : Path
        File, or folder of a ROS 2 bag.
    found : mapping of str to int
        Number of messages by topic.
    topic : str or None
        Topic that is asked for; None if there can be only one.
    missing, several : str
        What is wrong where that topic is not found, and where several could be meant.

    Returns
    -------
    str

    Raises
    ------
    RecordingError
        In these two cases.
    """
    if topic and topic not in found:
        raise _no_such_topic(path, found, missing)
    if topic is None and len(found) > 1:
        raise RecordingError(
            several,
            where=str(path),
            allowed=listed(found, "messages"),
            hint=_BY_TOPIC,
        )
    return topic or next(iter(found))


def _no_such_topic(path: Path, found: Mapping[str, int], missing: str) -> RecordingError:
    return RecordingError(
        missing,
        where=str(path),
        allowed=listed(found, "messages"),
        hint=_BY_TOPIC,
    )


def messages(path: Path) -> Iterator[Message | Unusable]:
    """Messages of one file of a bag.

    Raises
    ------
    RecordingError
        If it is damaged as a whole.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_MAGIC_BYTES)
            if head.startswith(ros1_bag.MAGIC):
                yield from ros1_bag.messages(file)
            elif head.startswith(mcap.MAGIC):
                yield from mcap.messages(file)
            elif head.startswith(ros2_db3.MAGIC):
                yield from ros2_db3.messages(path)
            else:
                raise _damaged(path, "its first bytes are not those of a version that is known")
    except (sqlite3.Error, UnicodeError) as error:
        raise _damaged(path, str(error)) from None


def _by_index(path: Path) -> Counter[Topic]:
    """Messages by topic by the index of a file; empty if that is missing."""
    try:
        with path.open("rb") as file:
            head = file.read(_MAGIC_BYTES)
            if head.startswith(ros1_bag.MAGIC):
                return ros1_bag.counted(file)
            if head.startswith(mcap.MAGIC):
                return mcap.counted(file)
        return ros2_db3.counted(path) if head.startswith(ros2_db3.MAGIC) else Counter()
    except (sqlite3.Error, UnicodeError):
        return Counter()


def _damaged(path: Path, why: str) -> RecordingError:
    """Error for a bag that is damaged as a whole."""
    return RecordingError(
        f"cannot be read as a ROS bag: {why}",
        where=str(path),
        hint=_REINDEX,
    )


def chunks(path: Path, topic: str, ledger: Ledger) -> Iterator[Chunk]:
    """Read the valid packets of a topic, a message at a time.

    Parameters
    ----------
    path : Path
        File, or folder of a ROS 2 bag.
    topic : str
    ledger : Ledger
        Receives the bytes of all messages, and of what is damaged.

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
    for file in files(path):
        for part in messages(file):
            size = part.bytes if isinstance(part, Unusable) else len(part.data)
            ledger.file_bytes += size
            if isinstance(part, Unusable):
                ledger.reject(part.reason, 1, size)
            elif not is_scan(part.topic):
                ledger.reject(f"message of type {part.topic.type}", 1, size)
            elif part.topic.name != topic:
                ledger.reject(f"message of topic {part.topic.name}", 1, size)
            else:
                data = part.data
                if data.startswith(_ZSTD) and not part.topic.ros1:
                    data = unpacked(data, "zstd") or b""
                    ledger.file_bytes += len(data) - size
                    if not data:
                        ledger.file_bytes += size
                        ledger.reject("message that cannot be unpacked", 1, size)
                        continue
                    size = len(data)
                yield from _packets(data, part.topic.ros1, part.time_ns, position, ledger)
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
