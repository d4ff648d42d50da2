"""Packets out of capture files: bare records of 1206 or 1248 bytes, pcap and pcapng.

Files are read in chunks; damaged stretches are skipped to the next sound packet, and every
byte is entered in a ledger. The end of the content need not be known: it is where reading ends.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from velocal.capture.chunk import Chunk
from velocal.capture.gzip_stream import Content
from velocal.capture.ledger import Ledger
from velocal.capture.udp import (
    HEADER_BYTES,
    Datagrams,
    Frames,
    enter_sound,
    sender_of,
)
from velocal.packets.data import DUAL_BANKS_BLOCKS, FLAG_POSITIONS, PAYLOAD_BYTES, sound

CHUNK_BYTES = 8 << 20
#: Step in which the next sound packet is looked for after damage; it is usually near.
SEARCH_BYTES = 1 << 16
MAX_CAPTURED = 1 << 18
#: No frame on a scanner's network should be longer (jumbo frames excepted).
LONGEST_FRAME = 2048
#: So many packets of one size, and the next are looked at as an array.
ALIKE = 16

PCAP_FILE_HEADER = 24
PCAP_PACKET_HEADER = 16


class Framing(Protocol):
    """A way in which packets are delimited in a file."""

    @property
    def name(self) -> str:
        """Framing as it is called in ledgers."""
        ...

    @property
    def first_packet(self) -> int:
        """Where the first packet begins."""
        ...

    @property
    def enterable(self) -> bool:
        """Whether packets can be read from any packet on, without what is before it."""
        ...

    @property
    def addressed(self) -> bool:
        """Whether packets come with the address of their sender."""
        ...

    def chunks(self, file: Content, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
        """Read the sound packets that begin in [start, stop)."""
        ...


def payload_positions(data: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Positions in bytes at which twelve block flags follow as in a payload."""
    last = len(data) - PAYLOAD_BYTES
    if last < 0:
        return np.empty(0, dtype=np.int64)
    candidate = np.ones(last + 1, dtype=bool)
    for number, at in enumerate(FLAG_POSITIONS):
        first, second = data[at : at + last + 1], data[at + 1 : at + 1 + last + 1]
        if number == 0:
            candidate = first == 0xFF
        flagged = (first == 0xFF) & ((second == 0xEE) | (second == 0xDD))
        flagged |= (first == 0xFF) & ((second == 0xCC) | (second == 0xBB))
        if number >= DUAL_BANKS_BLOCKS:
            flagged |= (first == second) & ((first == 0) | (first == 0xFF))
        candidate &= flagged
        if not candidate.any():
            break
    return np.flatnonzero(candidate)


def find_payload(data: NDArray[np.uint8]) -> int | None:
    """First position in bytes at which twelve block flags follow as in a payload, or None."""
    positions = payload_positions(data)
    return int(positions[0]) if len(positions) else None


def _next_payload(file: Content, search: int, stop: int) -> tuple[int | None, int]:
    """Where the next payload lies from `search` on, or None; and where reading ended."""
    while search < stop:
        file.seek(search)
        data = np.frombuffer(file.read(SEARCH_BYTES), dtype=np.uint8)
        found = find_payload(data)
        if found is not None:
            return search + found, stop
        if len(data) < SEARCH_BYTES:
            return None, min(stop, search + len(data))
        search += len(data) - PAYLOAD_BYTES + 1
    return None, stop


@dataclass(frozen=True)
class Records:
    """Packets of equal size appended to each other, with or without their 42 header bytes."""

    header_bytes: int
    first_packet: int = 0
    enterable: bool = True

    @property
    def name(self) -> str:
        """Framing as it is called in ledgers."""
        return f"records of {self.header_bytes + PAYLOAD_BYTES} bytes"

    @property
    def addressed(self) -> bool:
        """Whether packets come with the address of their sender."""
        return self.header_bytes == HEADER_BYTES

    def chunks(self, file: Content, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
        """Read records; where bytes were lost, find the next record by its block flags."""
        size = self.header_bytes + PAYLOAD_BYTES
        per_chunk = CHUNK_BYTES // size
        position = start
        while position < stop:
            file.seek(position)
            wanted = min(per_chunk * size, -(-(stop - position) // size) * size)
            data = np.frombuffer(file.read(wanted), dtype=np.uint8)
            n = len(data) // size
            if n == 0:
                cut = int(len(data) > 0)
                ledger.reject("record cut short at the end of the file", cut, len(data))
                return
            records = data[: n * size].reshape(n, size)
            # Copied once: later steps look at the payloads as packets again and again.
            payloads = np.ascontiguousarray(records[:, self.header_bytes :])
            judged = sound(payloads)
            known = judged[0]
            # One bad record before a good one is a bad record; two in a row, or one with nothing
            # after it to judge by, may be lost alignment.
            suspect = np.flatnonzero(~known & ~np.append(known[1:], False))
            aligned = int(suspect[0]) if len(suspect) else n
            if aligned:
                end = position + aligned * size
                chunk = self._chunk(records[:aligned], payloads[:aligned], position, end)
                yield enter_sound(chunk, ledger, (known[:aligned], judged[1][:aligned]))
                position = end
                continue
            position = self._resynchronise(file, position, stop, ledger)

    def _chunk(
        self, records: NDArray[np.uint8], payloads: NDArray[np.uint8], position: int, end: int
    ) -> Chunk:
        n, size = records.shape
        sender = None
        if self.addressed:
            sender = sender_of(records[:, [26, 27, 28, 29, 36, 37]])
        offsets = position + size * np.arange(n, dtype=np.int64)
        return Chunk(payloads, offsets, np.full(n, size, dtype=np.int64), end, None, sender)

    def _resynchronise(self, file: Content, position: int, stop: int, ledger: Ledger) -> int:
        """Skip from a bad record to the next that looks sound."""
        found, end = _next_payload(file, position + self.header_bytes + 1, stop)
        after = end if found is None else found - self.header_bytes
        ledger.reject("bytes without a record", 1, after - position)
        return after


@dataclass(frozen=True)
class Pcap:
    """Classic pcap, either byte order, micro- or nanoseconds."""

    byte_order: str
    ticks_per_second: float
    link: int = 1
    name: str = "pcap"
    first_packet: int = PCAP_FILE_HEADER
    enterable: bool = True
    addressed: bool = True

    def chunks(self, file: Content, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
        """Walk the packet headers; after a damaged one, find the next by its payload."""
        datagrams = Datagrams(ledger)
        position = start
        while position < stop:
            file.seek(position)
            # Longer than the chunk by the longest packet, so that a packet is never split.
            data = file.read(min(CHUNK_BYTES, stop - position) + MAX_CAPTURED)
            limit = min(CHUNK_BYTES, stop - position, len(data))
            places, here, lost = self._walk(data, limit)
            if len(places):
                yield datagrams.take(self._frames(data, places), position, position + here)
            if not lost and here < limit:
                ledger.reject("packet cut short at the end of the file", 1, len(data) - here)
                here = len(data)
            position += here
            if lost:
                position = self._resynchronise(file, position, stop, ledger)
            elif limit == 0 or here >= len(data):
                break
        datagrams.finish()

    def _walk(self, data: bytes, limit: int) -> tuple[NDArray[np.int64], int, bool]:
        """Where packets begin; where they end; whether that is for a damaged header."""
        lengths = struct.Struct(self.byte_order + "II").unpack_from
        parts: list[NDArray[np.int64]] = []
        places: list[int] = []
        here, alike, before, lost = 0, 0, -1, False
        size, last = len(data), min(limit, len(data) - PCAP_PACKET_HEADER + 1)
        while here < last:
            captured, original = lengths(data, here + 8)
            end = here + PCAP_PACKET_HEADER + captured
            if captured > original or original > MAX_CAPTURED:
                lost = True
                break
            if end > size or captured > LONGEST_FRAME:
                # A misread length would swallow the packets it spans.
                inner = data[here + PCAP_PACKET_HEADER + HEADER_BYTES + 1 : end]
                lost = find_payload(np.frombuffer(inner, dtype=np.uint8)) is not None
                if lost or end > size:
                    break
            places.append(here)
            alike = alike + 1 if captured == before else 0
            before, here = captured, end
            if alike >= ALIKE and captured <= LONGEST_FRAME and here < last:
                run = self._run(data, here, limit, captured, original)
                parts += [np.array(places), run]
                here, alike, places = here + len(run) * (PCAP_PACKET_HEADER + captured), 0, []
        parts.append(np.array(places, dtype=np.int64))
        return np.concatenate(parts), here, lost

    def _run(
        self, data: bytes, here: int, limit: int, captured: int, original: int
    ) -> NDArray[np.int64]:
        """Where the packets from `here` on begin that have the same lengths."""
        stride = PCAP_PACKET_HEADER + captured
        n = min(-(-(limit - here) // stride), (len(data) - here) // stride)
        table = np.frombuffer(data, np.uint8, n * stride, here).reshape(n, stride)
        lengths = np.ascontiguousarray(table[:, 8:PCAP_PACKET_HEADER]).view(self.byte_order + "u4")
        other = np.flatnonzero((lengths != [captured, original]).any(axis=1))
        return here + stride * np.arange(int(other[0]) if len(other) else n, dtype=np.int64)

    def _frames(self, data: bytes, places: NDArray[np.int64]) -> Frames:
        bytes_ = np.frombuffer(data, dtype=np.uint8)
        windows = np.lib.stride_tricks.sliding_window_view(bytes_, PCAP_PACKET_HEADER)
        heads = windows[places].view(self.byte_order + "u4").astype(np.int64)
        seconds, ticks, captured, original = heads.T
        return Frames(
            data,
            places,
            captured + PCAP_PACKET_HEADER,
            places + PCAP_PACKET_HEADER,
            captured,
            original,
            seconds + ticks / self.ticks_per_second,
            np.full(len(places), self.link),
        )

    @staticmethod
    def _resynchronise(file: Content, position: int, stop: int, ledger: Ledger) -> int:
        lead = PCAP_PACKET_HEADER + HEADER_BYTES
        found, end = _next_payload(file, position + lead + 1, stop)
        after = end if found is None else found - lead
        ledger.reject("bytes without a packet header", 1, after - position)
        return after
