"""Messages out of MCAP files (mcap.dev/spec), as far as their records are whole.

A file is records: a kind, a length, and content. Messages lie in chunks, which may be compressed,
or between them; a file that was not closed has no summary at its end.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO
from zlib import crc32

from velocal.capture.bag_message import (
    MOST_BYTES,
    Content,
    Message,
    Topic,
    Unusable,
    rest_of,
    unpacked,
)

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _DATA_END = 2, 3, 4, 5, 6, 11, 15
#: Footer record and magic at the end of a file.
_FOOTER_BYTES = 9 + 20 + len(MAGIC)
_COUNTS_AT = 8 + 2 + 4 + 4 + 4 + 4 + 8 + 8
#: Channel, sequence number, and two times.
_MESSAGE_HEAD = struct.Struct("<HIQQ")


@dataclass
class _Known:
    """Types by their schema, and topics by their channel, that have been read so far."""

    types: dict[int, str] = field(default_factory=dict)
    topics: dict[int, Topic] = field(default_factory=dict)

    def enter(self, kind: int, content: bytes) -> None:
        """Read a schema or a channel; other records are left alone."""
        if len(content) < 6:
            return
        if kind == _SCHEMA:
            (number,) = struct.unpack_from("<H", content)
            self.types[number] = _text(content, 2)[0]
        elif kind == _CHANNEL:
            number, schema = struct.unpack_from("<HH", content)
            name, at = _text(content, 4)
            encoding, _ = _text(content, at)
            self.topics[number] = Topic(name, self.types.get(schema, "?"), encoding == "ros1")


def messages(file: BinaryIO) -> Content:
    """Read the messages of a file in its order.

    Parameters
    ----------
    file : BinaryIO

    Yields
    ------
    Message or Unusable
    """
    known = _Known()
    end = len(MAGIC)
    for kind, begin, size in _records(file, end):
        end = begin + size
        if kind in (_DATA_END, _FOOTER):
            return  # the summary repeats what is known
        if kind in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK) and size > MOST_BYTES:
            yield Unusable("chunk that cannot be unpacked", size)
        elif kind in (_SCHEMA, _CHANNEL):
            known.enter(kind, _content(file, begin, size))
        elif kind == _MESSAGE:
            yield from _message(known, _content(file, begin, size))
        elif kind == _CHUNK:
            chunk = _chunk(_content(file, begin, size))
            if chunk is None:
                yield Unusable("chunk that cannot be unpacked", size)
            else:
                yield from _in_chunk(known, chunk)
    rest = rest_of(file, end)
    if rest:
        yield Unusable("bag cut short or damaged", rest)


def counted(file: BinaryIO) -> Counter[Topic]:
    """Count messages by topic, by the summary of the file; empty if it has none.

    Parameters
    ----------
    file : BinaryIO

    Returns
    -------
    Counter of Topic
    """
    found: Counter[Topic] = Counter()
    place = max(file.seek(0, 2) - _FOOTER_BYTES, 0)
    footer = _content(file, place, _FOOTER_BYTES)
    if len(footer) < _FOOTER_BYTES or footer[0] != _FOOTER or not footer.endswith(MAGIC):
        return found
    (summary,) = struct.unpack_from("<Q", footer, 9)
    if not len(MAGIC) < summary < place:
        return found
    known = _Known()
    counts: Counter[int] = Counter()
    for kind, begin, size in _records(file, summary):
        if size > MOST_BYTES or kind == _FOOTER:
            break
        content = _content(file, begin, size)
        known.enter(kind, content)
        if kind == _STATISTICS:
            for at in range(_COUNTS_AT, len(content) - 9, 10):
                number, n = struct.unpack_from("<HQ", content, at)
                counts[number] += n
    for number, topic in known.topics.items():
        found[topic] += counts[number]
    return found


def _records(file: BinaryIO, position: int) -> Iterator[tuple[int, int, int]]:
    """Kind, first byte and size of the content of records, as far as they are whole."""
    end = file.seek(0, 2)
    while position + 9 <= end:
        kind, size = struct.unpack("<BQ", _content(file, position, 9))
        if kind == 0 or position + 9 + size > end:
            return
        yield kind, position + 9, size
        position += 9 + size


def _content(file: BinaryIO, begin: int, size: int) -> bytes:
    """Bytes of the file."""
    file.seek(begin)
    return file.read(size)


def _text(content: bytes, at: int) -> tuple[str, int]:
    """Text with its length before it, and the byte after it."""
    size = int.from_bytes(content[at : at + 4], "little")
    return content[at + 4 : at + 4 + size].decode(errors="replace"), at + 4 + size


def _chunk(content: bytes) -> bytes | None:
    """Records of a chunk; None if it is damaged."""
    if len(content) < 40:
        return None
    size, checksum = struct.unpack_from("<QI", content, 16)
    compression, at = _text(content, 28)
    packed = content[at + 8 :]
    if int.from_bytes(content[at : at + 8], "little") != len(packed) or size > MOST_BYTES:
        return None
    chunk = unpacked(packed, compression)
    if chunk is None or len(chunk) != size or (checksum and crc32(chunk) != checksum):
        return None
    return chunk


def _in_chunk(known: _Known, chunk: bytes) -> Content:
    """Messages of a chunk."""
    at, end = 0, len(chunk)
    while at + 9 <= end:
        kind, size = struct.unpack_from("<BQ", chunk, at)
        if at + 9 + size > end:
            break
        content = chunk[at + 9 : at + 9 + size]
        if kind == _MESSAGE:
            yield from _message(known, content)
        else:
            known.enter(kind, content)
        at += 9 + size
    if at < end:
        yield Unusable("chunk cut short or damaged", end - at)


def _message(known: _Known, content: bytes) -> Content:
    """A message, if its channel is known."""
    if len(content) < _MESSAGE_HEAD.size:
        yield Unusable("message cut short", len(content))
        return
    number, _, time_ns, _ = _MESSAGE_HEAD.unpack_from(content)
    topic = known.topics.get(number)
    if topic is None:
        yield Unusable("message of an unknown channel", len(content))
        return
    yield Message(topic, time_ns, content[_MESSAGE_HEAD.size :])
