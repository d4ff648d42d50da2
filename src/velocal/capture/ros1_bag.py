"""Messages out of ROS 1 bags (wiki.ros.org/Bags/Format/2.0), as far as their records are whole.

A bag is records: a header of fields "name=value", and data. Messages lie in chunks, which may be
compressed; a bag that was not closed has chunks but no index.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from typing import BinaryIO

from velocal.capture.bag_message import (
    MOST_BYTES,
    Content,
    Message,
    Topic,
    Unusable,
    rest_of,
    unpacked,
)

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _CHUNK, _INFO, _CONNECTION = (bytes([op]) for op in (2, 3, 5, 6, 7))
#: Longest header of a record that is read; those of connections are some kilobytes.
_HEADER_BYTES = 1 << 20

_Fields = dict[bytes, bytes]


def messages(file: BinaryIO) -> Content:
    """Read the messages of a bag in the order of the file.

    Parameters
    ----------
    file : BinaryIO

    Yields
    ------
    Message or Unusable
    """
    topics: dict[bytes, Topic] = {}
    end = len(MAGIC)
    for fields, begin, size in _records(file, end):
        end = begin + size
        operation = fields.get(b"op")
        if operation == _CONNECTION:
            file.seek(begin)
            _enter(topics, fields, file.read(size))
        elif operation == _MESSAGE:
            file.seek(begin)
            yield from _message(topics, fields, file.read(size))
        elif operation == _CHUNK:
            file.seek(begin)
            packed = file.read(size) if size <= MOST_BYTES else b""
            compression = fields.get(b"compression", b"").decode("ascii", "replace")
            chunk = unpacked(packed, compression) if packed else None
            if chunk is None:
                yield Unusable("chunk that cannot be unpacked", size)
            else:
                yield from _in_chunk(topics, chunk)
    rest = rest_of(file, end)
    if rest:
        yield Unusable("bag cut short or damaged", rest)


def counted(file: BinaryIO) -> Counter[Topic]:
    """Count messages by topic, by the index of the bag; empty if it has none.

    Parameters
    ----------
    file : BinaryIO

    Returns
    -------
    Counter of Topic
    """
    topics: dict[bytes, Topic] = {}
    found: Counter[Topic] = Counter()
    for fields, _, _ in _records(file, len(MAGIC)):
        index = fields.get(b"index_pos", b"")
        break
    else:
        return found
    place = int.from_bytes(index, "little")
    if not len(MAGIC) < place < file.seek(0, 2):
        return found
    counts: Counter[bytes] = Counter()
    for fields, begin, size in _records(file, place):
        file.seek(begin)
        if fields.get(b"op") == _CONNECTION:
            _enter(topics, fields, file.read(size))
        elif fields.get(b"op") == _INFO and size <= MOST_BYTES:
            data = file.read(size)
            for at in range(0, len(data) - 7, 8):
                counts[data[at : at + 4]] += int.from_bytes(data[at + 4 : at + 8], "little")
    for number, topic in topics.items():
        found[topic] += counts[number]
    return found


def _records(file: BinaryIO, position: int) -> Iterator[tuple[_Fields, int, int]]:
    """Fields, first byte of the data and size of the data of records, as far as they are whole."""
    end = file.seek(0, 2)
    while position + 8 <= end:
        file.seek(position)
        header = int.from_bytes(file.read(4), "little")
        if header > min(_HEADER_BYTES, end - position - 8):
            return
        fields = _fields(file.read(header))
        size = int.from_bytes(file.read(4), "little")
        begin = position + 8 + header
        if b"op" not in fields or begin + size > end:
            return
        yield fields, begin, size
        position = begin + size


def _fields(header: bytes) -> _Fields:
    """Fields of a header, as far as they are whole."""
    found: _Fields = {}
    at = 0
    while at + 4 <= len(header):
        size = int.from_bytes(header[at : at + 4], "little")
        name, _, value = header[at + 4 : at + 4 + size].partition(b"=")
        found[name] = value
        at += 4 + size
    return found


def _in_chunk(topics: dict[bytes, Topic], chunk: bytes) -> Content:
    """Messages of a chunk."""
    at, end = 0, len(chunk)
    while at + 8 <= end:
        (header,) = struct.unpack_from("<I", chunk, at)
        begin = at + 8 + header
        if begin > end:
            break
        (size,) = struct.unpack_from("<I", chunk, begin - 4)
        if begin + size > end:
            break
        fields, data = _fields(chunk[at + 4 : begin - 4]), chunk[begin : begin + size]
        if fields.get(b"op") == _CONNECTION:
            _enter(topics, fields, data)
        elif fields.get(b"op") == _MESSAGE:
            yield from _message(topics, fields, data)
        at = begin + size
    if at < end:
        yield Unusable("chunk cut short or damaged", end - at)


def _enter(topics: dict[bytes, Topic], fields: _Fields, data: bytes) -> None:
    """Enter the topic of a connection."""
    type_ = _fields(data).get(b"type", b"?")
    name, number = fields.get(b"topic", b"?"), fields.get(b"conn", b"")
    topics[number] = Topic(name.decode(errors="replace"), type_.decode(errors="replace"), True)


def _message(topics: dict[bytes, Topic], fields: _Fields, data: bytes) -> Content:
    """A message, if its connection is known."""
    topic = topics.get(fields.get(b"conn", b""))
    if topic is None:
        yield Unusable("message of an unknown connection", len(data))
        return
    time = fields.get(b"time", b"").ljust(8, b"\0")
    seconds, nanoseconds = struct.unpack("<II", time[:8])
    yield Message(topic, seconds * 10**9 + nanoseconds, data)
