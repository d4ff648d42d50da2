"""Packets out of capture files: bare records of 1206 or 1248 bytes, and classic pcap.

Files are read in chunks; damaged stretches are skipped to the next sound packet, and every
byte is entered in a ledger.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Protocol

import numpy as np
from numpy.typing import NDArray

from velocal.errors import RecordingError
from velocal.packets import FLAG_POSITIONS, PAYLOAD_BYTES, sound
from velocal.recording.ledger import Ledger

#: Ethernet, IPv4 and UDP headers before the payload.
HEADER_BYTES = 42
POSITION_PAYLOAD_BYTES = 512
CHUNK_BYTES = 8 << 20
#: Step in which the next sound packet is looked for after damage; it is usually near.
SEARCH_BYTES = 1 << 16
MAX_CAPTURED = 1 << 18
#: No frame on a scanner's network should be longer (jumbo frames excepted).
LONGEST_FRAME = 2048

PCAP_FILE_HEADER = 24
PCAP_PACKET_HEADER = 16
LINKTYPE_ETHERNET = 1


@dataclass(frozen=True)
class Chunk:
    """Sound data packets that follow one another in a file.

    Attributes
    ----------
    payloads : ndarray of uint8, shape (n, 1206)
        Payload of every packet.
    offsets : ndarray of int64, shape (n,)
        Where each packet, with its framing, begins in the file.
    end : int
        Byte after the last packet looked at.
    capture_time_s : ndarray of float64, shape (n,), or None
        Time of capture, where the framing has one.
    """

    payloads: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    end: int
    capture_time_s: NDArray[np.float64] | None


class Framing(Protocol):
    """A way in which packets are delimited in a file."""

    @property
    def name(self) -> str:
        """Framing as it is called in ledgers."""
        ...

    def chunks(self, file: BinaryIO, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
        """Read the sound packets that begin in [start, stop)."""
        ...

    @property
    def first_packet(self) -> int:
        """Where the first packet begins."""
        ...


def _sound_payloads(
    payloads: NDArray[np.uint8], packet_bytes: NDArray[np.int64], ledger: Ledger
) -> NDArray[np.bool_]:
    """Enter payloads in the ledger and tell which are sound."""
    known, turn = sound(payloads)
    good = known & turn
    ledger.reject("unknown block flag", int((~known).sum()), int(packet_bytes[~known].sum()))
    beyond = known & ~turn
    ledger.reject("azimuth beyond one turn", int(beyond.sum()), int(packet_bytes[beyond].sum()))
    n = int(good.sum())
    ledger.data.add(n, n * PAYLOAD_BYTES)
    ledger.framing_bytes += int(packet_bytes[good].sum()) - n * PAYLOAD_BYTES
    return good


def payload_positions(data: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Positions in bytes at which twelve block flags follow as in a payload."""
    last = len(data) - PAYLOAD_BYTES
    if last < 0:
        return np.empty(0, dtype=np.int64)
    candidate = np.ones(last + 1, dtype=bool)
    for at in FLAG_POSITIONS:
        first, second = data[at : at + last + 1], data[at + 1 : at + 1 + last + 1]
        candidate &= ((first == 0xFF) & (second == 0xEE)) | ((first == 0xFF) & (second == 0xDD))
    return np.flatnonzero(candidate)


def find_payload(data: NDArray[np.uint8]) -> int | None:
    """First position in bytes at which twelve block flags follow as in a payload, or None."""
    positions = payload_positions(data)
    return int(positions[0]) if len(positions) else None


@dataclass(frozen=True)
class Records:
    """Packets of equal size appended to each other, with or without their 42 header bytes."""

    header_bytes: int

    @property
    def name(self) -> str:
        """Framing as it is called in ledgers."""
        return f"records of {self.header_bytes + PAYLOAD_BYTES} bytes"

    @property
    def first_packet(self) -> int:
        """Records begin with the file."""
        return 0

    def chunks(self, file: BinaryIO, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
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
                ledger.reject("record cut short at the end of the file", 1, len(data))
                return
            payloads = data[: n * size].reshape(n, size)[:, self.header_bytes :]
            known, _ = sound(payloads)
            # One bad record before a good one is a bad record; two in a row, or one with nothing
            # after it to judge by, may be lost alignment.
            suspect = np.flatnonzero(~known & ~np.append(known[1:], False))
            aligned = int(suspect[0]) if len(suspect) else n
            if aligned:
                sizes = np.full(aligned, size, dtype=np.int64)
                good = _sound_payloads(payloads[:aligned], sizes, ledger)
                offsets = position + size * np.flatnonzero(good)
                end = position + aligned * size
                yield Chunk(payloads[:aligned][good], offsets, end, None)
                position = end
                continue
            position = self._resynchronise(file, position, stop, ledger)

    def _resynchronise(self, file: BinaryIO, position: int, stop: int, ledger: Ledger) -> int:
        """Skip from a bad record to the next that looks sound."""
        origin = position
        search = position + self.header_bytes + 1
        while search < stop:
            file.seek(search)
            data = np.frombuffer(file.read(SEARCH_BYTES), dtype=np.uint8)
            found = find_payload(data)
            if found is not None:
                position = search + found - self.header_bytes
                ledger.reject("bytes without a record", 1, position - origin)
                return position
            if len(data) < SEARCH_BYTES:
                break
            search += len(data) - PAYLOAD_BYTES + 1
        ledger.reject("bytes without a record", 1, stop - origin)
        return stop


@dataclass(frozen=True)
class Pcap:
    """Classic pcap of Ethernet frames, either byte order, micro- or nanoseconds."""

    byte_order: str
    ticks_per_second: float

    @property
    def name(self) -> str:
        """Framing as it is called in ledgers."""
        return "pcap"

    @property
    def first_packet(self) -> int:
        """Packets begin after the file header."""
        return PCAP_FILE_HEADER

    def chunks(self, file: BinaryIO, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
        """Walk the packet headers; after a damaged one, find the next by its payload."""
        header = struct.Struct(self.byte_order + "IIII")
        position = start
        while position < stop:
            file.seek(position)
            # Longer than the chunk by the longest packet, so that a packet is never split.
            data = file.read(min(CHUNK_BYTES, stop - position) + MAX_CAPTURED)
            here, limit = 0, min(CHUNK_BYTES, stop - position)
            rows: list[int] = []
            times: list[float] = []
            lost = False
            while here < limit:
                if here + PCAP_PACKET_HEADER > len(data):
                    ledger.reject("packet cut short at the end of the file", 1, len(data) - here)
                    here = len(data)
                    break
                seconds, ticks, captured, original = header.unpack_from(data, here)
                if captured > original or original > MAX_CAPTURED:
                    lost = True
                    break
                end = here + PCAP_PACKET_HEADER + captured
                if end > len(data) or captured > LONGEST_FRAME:
                    # A misread length would swallow the packets it spans.
                    inner = data[here + PCAP_PACKET_HEADER + HEADER_BYTES + 1 : end]
                    if find_payload(np.frombuffer(inner, dtype=np.uint8)) is not None:
                        lost = True
                        break
                if end > len(data):
                    ledger.reject("packet cut short at the end of the file", 1, len(data) - here)
                    here = len(data)
                    break
                kind = _kind_of_frame(data, here + PCAP_PACKET_HEADER, captured, original)
                if kind is None:
                    rows.append(here)
                    times.append(seconds + ticks / self.ticks_per_second)
                elif kind == "position":
                    ledger.position.add(1, end - here)
                else:
                    ledger.reject(kind, 1, end - here)
                here = end
            if rows:
                yield self._chunk(data, rows, times, position, position + here, ledger)
            position += here
            if lost:
                position = self._resynchronise(file, position, stop, ledger)

    @staticmethod
    def _chunk(
        data: bytes, rows: list[int], times: list[float], base: int, end: int, ledger: Ledger
    ) -> Chunk:
        first = np.asarray(rows, dtype=np.int64)
        bytes_ = np.frombuffer(data, dtype=np.uint8)
        windows = np.lib.stride_tricks.sliding_window_view(bytes_, PAYLOAD_BYTES)
        payloads = windows[first + PCAP_PACKET_HEADER + HEADER_BYTES]
        sizes = np.full(len(first), PCAP_PACKET_HEADER + HEADER_BYTES + PAYLOAD_BYTES)
        good = _sound_payloads(payloads, sizes, ledger)
        return Chunk(payloads[good], base + first[good], end, np.asarray(times)[good])

    @staticmethod
    def _resynchronise(file: BinaryIO, position: int, stop: int, ledger: Ledger) -> int:
        origin = position
        lead = PCAP_PACKET_HEADER + HEADER_BYTES
        search = position + lead + 1
        while search < stop:
            file.seek(search)
            data = np.frombuffer(file.read(SEARCH_BYTES), dtype=np.uint8)
            found = find_payload(data)
            if found is not None:
                position = search + found - lead
                ledger.reject("bytes without a packet header", 1, position - origin)
                return position
            if len(data) < SEARCH_BYTES:
                break
            search += len(data) - PAYLOAD_BYTES + 1
        ledger.reject("bytes without a packet header", 1, stop - origin)
        return stop


def _kind_of_frame(data: bytes, at: int, captured: int, original: int) -> str | None:
    """Why an Ethernet frame is not a data packet; None if it is one."""
    if captured < HEADER_BYTES or data[at + 12 : at + 14] != b"\x08\x00":
        return "not IPv4 over Ethernet"
    if data[at + 14] != 0x45 or data[at + 23] != 17:
        return "not UDP, or with IP options"
    payload = int.from_bytes(data[at + 38 : at + 40], "big") - 8
    if payload == POSITION_PAYLOAD_BYTES:
        return "position"
    if payload != PAYLOAD_BYTES:
        return f"payload of {payload} bytes"
    if captured < HEADER_BYTES + PAYLOAD_BYTES:
        return f"captured {captured} of {original} bytes"
    if captured > HEADER_BYTES + PAYLOAD_BYTES:
        return f"frame of {captured} bytes"
    return None


_PCAP_MAGIC = {
    b"\xd4\xc3\xb2\xa1": ("<", 1e6),
    b"\xa1\xb2\xc3\xd4": (">", 1e6),
    b"\x4d\x3c\xb2\xa1": ("<", 1e9),
    b"\xa1\xb2\x3c\x4d": (">", 1e9),
}


def detect(path: Path) -> Framing:
    """Find how the packets of a file are delimited.

    Raises
    ------
    RecordingError
        If the file is missing, empty, or of no known framing.
    """
    try:
        with path.open("rb") as file:
            head = file.read(1 << 20)
    except OSError as error:
        raise RecordingError(
            f"cannot be read: {error.strerror}", where=str(path), hint="Check the path."
        ) from None
    if not head:
        raise RecordingError("is empty", where=str(path))
    if head[:4] in _PCAP_MAGIC and len(head) >= PCAP_FILE_HEADER:
        order, ticks = _PCAP_MAGIC[head[:4]]
        link = struct.unpack_from(order + "I", head, 20)[0] & 0x0FFFFFFF
        if link != LINKTYPE_ETHERNET:
            raise RecordingError(
                f"pcap of link type {link}",
                where=str(path),
                allowed="1 (Ethernet)",
                hint="Capture on the network interface to which the scanner is wired.",
            )
        return Pcap(order, ticks)
    positions = payload_positions(np.frombuffer(head, dtype=np.uint8))
    if len(positions) == 1:
        return Records(HEADER_BYTES if positions[0] >= HEADER_BYTES else 0)
    # Damage changes some of the distances between payloads, another container all of them.
    distances = np.diff(positions)
    votes = {
        header: int((distances == header + PAYLOAD_BYTES).sum()) for header in (0, HEADER_BYTES)
    }
    if any(votes.values()):
        return Records(max(votes, key=lambda header: votes[header]))
    raise RecordingError(
        "holds no Velodyne data packets in a known framing in its first MiB",
        where=str(path),
        allowed="records of 1206 or 1248 bytes, or a classic pcap of Ethernet frames",
        hint="Convert pcapng with `editcap -F pcap IN OUT`.",
    )
