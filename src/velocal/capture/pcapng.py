"""Packets out of pcapng files (IETF draft-ietf-opsawg-pcapng)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from velocal.capture import framing
from velocal.capture.chunk import Chunk
from velocal.capture.compressed import Content
from velocal.capture.ledger import Ledger
from velocal.capture.udp import Datagrams, Frames

#: Block types: section header (the same in both byte orders), interface, packets of three kinds.
SECTION = b"\x0a\x0d\x0d\x0a"
_SECTION, _INTERFACE, _OBSOLETE, _SIMPLE, _ENHANCED = 0x0A0D0D0A, 1, 2, 3, 6
_BYTE_ORDER = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}
_LEAST = 12
#: Least size of an enhanced packet, and its bytes before the frame, in words of 32 bits: type, size
#: of the block, interface, time (high, low), captured, original.
_LEAST_PACKET, _HEAD_BYTES = 32, 28
#: After this many packets whose blocks have one size, the next ones are looked at as an array.
ALIKE = 16
_RESOLUTION, _OFFSET = 9, 14

#: Place in the block, seconds, captured, original, link type, and bytes before the frame.
_Row = tuple[int, int, float, int, int, int, int]
#: The same of several packets, by column.
_Columns = tuple[NDArray[np.generic], ...]


@dataclass
class _Section:
    """What the blocks of a section refer to."""

    order: str = "<"
    #: Link type, ticks per second, offset in seconds, largest captured length.
    interfaces: list[tuple[int, float, int, int]] = field(default_factory=list)


@dataclass(frozen=True)
class PcapNg:
    """Blocks of pcapng; sections and interfaces before a packet must have been read."""

    name: str = "pcapng"
    first_packet: int = 0
    seekable: bool = False
    addressed: bool = True

    def chunks(self, file: Content, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
        """Walk the blocks; after a damaged one, find the next by its two lengths.

        Parameters and yields are those of `Framing.chunks`.
        """
        datagrams, section = Datagrams(ledger), _Section()
        position = start
        while position < stop:
            hole = framing.after_hole(file, position) - position
            if hole > _LEAST:
                ledger.reject("bytes without a block", 1, hole - _LEAST)
                position += hole - _LEAST
            file.seek(position)
            wanted = min(framing.CHUNK_BYTES, stop - position) + framing.MAX_CAPTURED
            data = file.read(wanted)
            limit = min(framing.CHUNK_BYTES, stop - position, len(data))
            parts: list[_Columns] = []
            rows: list[_Row] = []
            # Runs of packets between damage are taken together: a run may be short.
            runs: list[NDArray[np.int64]] = []
            here = 0
            while here < limit:
                places, here = _walk(data, here, limit, section.order)
                if len(places):
                    if rows:
                        parts.append(_columns(rows))
                        rows = []
                    runs.append(places)
                    continue
                length = _block_length(data, here, section.order)
                if length is None:
                    skipped, reason = _damaged(data, here, section.order, whole=len(data) < wanted)
                    ledger.reject(reason, 1, skipped)
                    here += skipped
                    continue
                if runs:  # the block may change what packets mean
                    parts.append(_packets(data, np.concatenate(runs), section))
                    runs = []
                row = _read_block(data, here, length, section)
                if row is None:
                    ledger.framing_bytes += length
                else:
                    rows.append(row)
                here += length
            if rows:
                parts.append(_columns(rows))
            if runs:
                parts.append(_packets(data, np.concatenate(runs), section))
            if parts:
                yield datagrams.payloads(_frames(data, parts), position, position + here)
            ended = here >= len(data)
            position += here
            if ended:
                break
        datagrams.finish()


def _walk(data: bytes, here: int, limit: int, order: str) -> tuple[NDArray[np.int64], int]:
    """Where enhanced packets begin, as long as each follows the other; where the last ends."""
    head, tail = struct.Struct(order + "II").unpack_from, struct.Struct(order + "I").unpack_from
    parts: list[NDArray[np.int64]] = []
    places: list[int] = []
    alike, before, reach, size = 0, 0, ALIKE, len(data)
    while here < limit and here + _LEAST_PACKET <= size:
        kind, length = head(data, here)
        if (
            kind != _ENHANCED
            or length < _LEAST_PACKET
            or length % 4
            or length > framing.MAX_CAPTURED
            or here + length > size
            or tail(data, here + length - 4)[0] != length
        ):
            break
        places.append(here)
        alike = alike + 1 if length == before else 0
        before, here = length, here + length
        if alike >= ALIKE and here < limit:
            # Twice as many each time, so that short runs cost no more than their packets.
            reach *= 2
            run = _run(data, here, limit, reach, length, order)
            parts += [np.array(places), run]
            here, places = here + len(run) * length, []
            alike = ALIKE if len(run) == reach else 0
    parts.append(np.array(places, dtype=np.int64))
    return np.concatenate(parts), here


def _run(
    data: bytes, here: int, limit: int, most: int, length: int, order: str
) -> NDArray[np.int64]:
    """Where the next enhanced packets begin, from `here` on, while their sizes are the same."""
    n = min(-(-(limit - here) // length), (len(data) - here) // length, most)
    blocks = np.frombuffer(data, np.uint8, n * length, here).reshape(n, length)
    head, tail = (np.ascontiguousarray(each).view(order + "u4") for each in
                  (blocks[:, :8], blocks[:, -4:]))  # fmt: skip
    other = np.flatnonzero((head != [_ENHANCED, length]).any(axis=1) | (tail[:, 0] != length))
    return here + length * np.arange(int(other[0]) if len(other) else n, dtype=np.int64)


def _packets(data: bytes, places: NDArray[np.int64], section: _Section) -> _Columns:
    """Columns of the enhanced packets that begin at `places`."""
    bytes_ = np.frombuffer(data, np.uint8)
    windows = np.lib.stride_tricks.sliding_window_view(bytes_, _HEAD_BYTES)
    words = windows[places].view(section.order + "u4").astype(np.int64)
    _, length, number, high, low, captured, original = words.T
    known = [_interface(section, each) for each in range(len(section.interfaces) + 1)]
    link, ticks, offset, _ = (np.array(each) for each in zip(*known, strict=True))
    number = np.minimum(number, len(section.interfaces))
    counted = (high.astype(np.uint64) << np.uint64(32)) + low.astype(np.uint64)
    time = offset[number] + counted.astype(np.float64) / ticks[number]
    captured = np.minimum(captured, length - _LEAST_PACKET)
    before = np.full(len(places), _HEAD_BYTES)
    return places, length, time, captured, original, link[number], before


def _damaged(data: bytes, here: int, order: str, *, whole: bool) -> tuple[int, str]:
    """Bytes up to the next block, and why they are rejected; `whole` data end with the file."""
    zeros = 0
    if not data[here : here + _LEAST].strip(b"\0"):
        # Skipped quickly: the type of a block has three zeros at most before other bytes.
        other = np.frombuffer(data, np.uint8, offset=here) != 0
        zeros = int(other.argmax()) if other.any() else len(other)
    ahead = _next_block(data, here + max(1, zeros - 3), order)
    if ahead is not None:
        return ahead - here, "bytes without a block"
    rest = len(data) - here
    if whole:
        return rest, "packet cut short at the end of the file"
    # What is not found here may begin in the last bytes read.
    return max(rest - framing.MAX_CAPTURED, 1), "bytes without a block"


def _block_length(data: bytes, at: int, order: str) -> int | None:
    """Length of a block if both of its copies agree and can be true, else None."""
    if at + _LEAST > len(data):
        return None
    if data[at : at + 4] == SECTION:
        order = _BYTE_ORDER.get(data[at + 8 : at + 12], order)
    (length,) = struct.unpack_from(order + "I", data, at + 4)
    if length < _LEAST or length % 4 or at + length > len(data) or length > framing.MAX_CAPTURED:
        return None
    again = struct.unpack_from(order + "I", data, at + length - 4)[0]
    return int(length) if again == length else None


def _next_block(data: bytes, at: int, order: str) -> int | None:
    """Where the next packet or section begins."""
    kinds = [struct.pack(order + "I", kind) for kind in (_ENHANCED, _SIMPLE, _OBSOLETE)]
    nearest = len(data)
    for kind in [*kinds, SECTION]:
        found = data.find(kind, at, nearest)
        while found >= 0 and _block_length(data, found, order) is None:
            found = data.find(kind, found + 1, nearest)
        if found >= 0:
            nearest = found
    return nearest if nearest < len(data) else None


def _read_block(data: bytes, at: int, length: int, section: _Section) -> _Row | None:
    """Packet in a block, but not an enhanced one; others may change what the section says."""
    order = section.order
    (kind,) = struct.unpack_from(order + "I", data, at)
    if data[at : at + 4] == SECTION:
        section.order = _BYTE_ORDER.get(data[at + 8 : at + 12], order)
        section.interfaces.clear()
    elif kind == _INTERFACE and length >= 20:
        link, _, longest = struct.unpack_from(order + "HHI", data, at + 8)
        ticks, offset = _clock(data[at + 16 : at + length - 4], order)
        section.interfaces.append((link, ticks, offset, longest or framing.MAX_CAPTURED))
    elif kind == _OBSOLETE and length >= _LEAST_PACKET:
        number, _, high, low, captured, original = struct.unpack_from(
            order + "HHIIII", data, at + 8
        )
        link, ticks, offset, _ = _interface(section, number)
        captured = min(captured, length - _LEAST_PACKET)
        time = offset + ((high << 32) + low) / ticks
        return at, length, time, captured, original, link, _HEAD_BYTES
    elif kind == _SIMPLE and length >= 16:
        (original,) = struct.unpack_from(order + "I", data, at + 8)
        link, _, _, longest = _interface(section, 0)
        return at, length, float("nan"), min(original, longest, length - 16), original, link, 12
    return None


def _interface(section: _Section, number: int) -> tuple[int, float, int, int]:
    """What is known of an interface; Ethernet and microseconds if its block was lost."""
    if number < len(section.interfaces):
        return section.interfaces[number]
    return 1, 1e6, 0, framing.MAX_CAPTURED


def _clock(options: bytes, order: str) -> tuple[float, int]:
    """Ticks per second and offset in seconds of an interface, from its options."""
    ticks, offset, at = 1e6, 0, 0
    while at + 4 <= len(options):
        code, size = struct.unpack_from(order + "HH", options, at)
        value = options[at + 4 : at + 4 + size]
        if code == _RESOLUTION and size == 1:
            ticks = float(2 ** (value[0] & 127) if value[0] & 128 else 10 ** value[0])
        elif code == _OFFSET and len(value) == 8:
            (offset,) = struct.unpack(order + "q", value)
        at += 4 + -(-size // 4) * 4
    return ticks, offset


def _columns(rows: list[_Row]) -> _Columns:
    """Columns of packets that were read one by one."""
    return tuple(map(np.array, zip(*rows, strict=True)))


def _frames(data: bytes, parts: list[_Columns]) -> Frames:
    """Frames of the packets, as arrays."""
    start, size, time, captured, original, link, before = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    return Frames(data, start, size, start + before, captured, original, time, link)
