"""Packets out of classic pcap files."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.capture import framing
from velocal.capture.chunk import Chunk
from velocal.capture.compressed import Content
from velocal.capture.ledger import Ledger
from velocal.capture.udp import HEADER_BYTES, LINKS, Datagrams, Frames
from velocal.errors import RecordingError

FILE_HEADER_BYTES = 24
PACKET_HEADER_BYTES = 16
#: No frame on a scanner's network should be longer (jumbo frames excepted).
LONGEST_FRAME = 2048
#: Network cards that append a check sequence or a time stamp capture more than the frame had.
APPENDED_BYTES = 64
#: After this many packets of one size, the next ones are looked at as an array.
ALIKE = 16

#: Bytes of a packet before its payload, if its headers are as a scanner sends them.
_BEFORE = PACKET_HEADER_BYTES + HEADER_BYTES
#: Bytes of the longest packet.
_AHEAD = PACKET_HEADER_BYTES + framing.MAX_CAPTURED + APPENDED_BYTES
_NO_HEADER = "bytes without a packet header"

#: First four bytes of a file: byte order, and ticks per second of its times.
_MAGIC = {
    b"\xd4\xc3\xb2\xa1": ("<", 1e6),
    b"\xa1\xb2\xc3\xd4": (">", 1e6),
    b"\x4d\x3c\xb2\xa1": ("<", 1e9),
    b"\xa1\xb2\x3c\x4d": (">", 1e9),
}


@dataclass(frozen=True)
class Pcap:
    """Classic pcap, either byte order, micro- or nanoseconds.

    Attributes
    ----------
    byte_order : str
        "<" or ">", as in `struct`.
    ticks_per_second : float
        Unit of the fraction of a second in packet headers.
    link : int
        Link type of the frames, one of `udp.LINKS`.
    """

    byte_order: str
    ticks_per_second: float
    link: int = 1
    name: str = "pcap"
    first_packet: int = FILE_HEADER_BYTES
    seekable: bool = True
    addressed: bool = True

    def chunks(self, file: Content, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
        """Walk the packet headers; after a damaged one, find the next by its payload.

        Parameters and yields are those of `Framing.chunks`.
        """
        datagrams = Datagrams(ledger)
        position = start
        while position < stop:
            file.seek(position)
            # Longer than the chunk by the longest packet, so that a packet is never split.
            data = file.read(min(framing.CHUNK_BYTES, stop - position) + _AHEAD)
            limit = min(framing.CHUNK_BYTES, stop - position, len(data))
            places, here, lost = self._walk(data, limit, ledger)
            if len(places):
                yield datagrams.payloads(self._frames(data, places), position, position + here)
            if not lost and here < limit:
                ledger.reject("packet cut short at the end of the file", 1, len(data) - here)
                here = len(data)
            ended = limit == 0 or here >= len(data)
            del data  # before the next read: otherwise both are in memory
            position += here
            if lost:
                position = framing.resynchronise(file, position, _BEFORE, stop, ledger, _NO_HEADER)
            elif ended:
                break
        datagrams.finish()

    def _walk(self, data: bytes, limit: int, ledger: Ledger) -> tuple[NDArray[np.int64], int, bool]:
        """Where packets begin; where the last ends; whether only damage follows in the data."""
        parts: list[NDArray[np.int64]] = []
        here, lost = 0, True
        while lost and here < limit:
            found, here, lost = self._walk_intact(data, here, limit)
            parts.append(found)
            if lost:
                # The next packet is looked for in what is read already: reading again and again
                # would cost more than all packets.
                payload = framing.find_payload(data, here + _BEFORE + 1)
                if payload is None:
                    break
                ledger.reject(_NO_HEADER, 1, payload - _BEFORE - here)
                here = payload - _BEFORE
        else:
            lost = False
        return np.concatenate([*parts, np.empty(0, dtype=np.int64)]), here, lost

    def _walk_intact(
        self, data: bytes, here: int, limit: int
    ) -> tuple[NDArray[np.int64], int, bool]:
        """Where packets begin; where the last ends; whether a damaged header follows it."""
        lengths = struct.Struct(self.byte_order + "II").unpack_from
        parts: list[NDArray[np.int64]] = []
        places: list[int] = []
        alike, before, reach, lost = 0, -1, ALIKE, False
        size, last = len(data), min(limit, len(data) - PACKET_HEADER_BYTES + 1)
        while here < last:
            captured, original = lengths(data, here + 8)
            end = here + PACKET_HEADER_BYTES + captured
            # A header of zeros is that of no packet, but part of a hole in the file.
            if (
                original == 0
                or captured > original + APPENDED_BYTES
                or original > framing.MAX_CAPTURED
            ):
                lost = True
                break
            if end > size or captured > LONGEST_FRAME:
                # A misread length would swallow the packets it spans.
                lost = framing.find_payload(data, here + _BEFORE + 1, end) is not None
                if lost or end > size:
                    break
            places.append(here)
            alike = alike + 1 if captured == before else 0
            before, here = captured, end
            if alike >= ALIKE and captured <= LONGEST_FRAME and here < last:
                # Twice as many each time: what follows damage is looked at again after it.
                reach *= 2
                run = self._run(data, here, limit, reach, captured, original)
                parts += [np.array(places), run]
                here, places = here + len(run) * (PACKET_HEADER_BYTES + captured), []
                alike = ALIKE if len(run) == reach else 0
        parts.append(np.array(places, dtype=np.int64))
        return np.concatenate(parts), here, lost

    def _run(
        self, data: bytes, here: int, limit: int, most: int, captured: int, original: int
    ) -> NDArray[np.int64]:
        """Where the next packets begin, from `here` on, as long as their lengths stay the same."""
        stride = PACKET_HEADER_BYTES + captured
        n = min(-(-(limit - here) // stride), (len(data) - here) // stride, most)
        table = np.frombuffer(data, np.uint8, n * stride, here).reshape(n, stride)
        lengths = np.ascontiguousarray(table[:, 8:PACKET_HEADER_BYTES]).view(self.byte_order + "u4")
        other = np.flatnonzero((lengths != [captured, original]).any(axis=1))
        return here + stride * np.arange(int(other[0]) if len(other) else n, dtype=np.int64)

    def _frames(self, data: bytes, places: NDArray[np.int64]) -> Frames:
        """Frames of the packets that begin at `places`."""
        bytes_ = np.frombuffer(data, dtype=np.uint8)
        windows = np.lib.stride_tricks.sliding_window_view(bytes_, PACKET_HEADER_BYTES)
        heads = windows[places].view(self.byte_order + "u4").astype(np.int64)
        seconds, ticks, captured, original = heads.T
        return Frames(
            data,
            places,
            captured + PACKET_HEADER_BYTES,
            places + PACKET_HEADER_BYTES,
            captured,
            original,
            seconds + ticks / self.ticks_per_second,
            np.full(len(places), self.link),
        )


def pcap_of(head: bytes, where: str) -> Pcap | None:
    """Read the header of a pcap file.

    Parameters
    ----------
    head : bytes
        First bytes of the content.
    where : str
        The recording, for errors.

    Returns
    -------
    Pcap or None
        None if the content is no pcap.

    Raises
    ------
    RecordingError
        If frames have a link type that is not known here.
    """
    if head[:4] not in _MAGIC or len(head) < FILE_HEADER_BYTES:
        return None
    order, ticks = _MAGIC[head[:4]]
    link = struct.unpack_from(order + "I", head, 20)[0] & 0x0FFFFFFF
    if link not in LINKS:
        raise RecordingError(
            f"pcap of link type {link}",
            where=where,
            allowed=", ".join(f"{link} ({name})" for link, (name, *_) in LINKS.items()),
            hint="Capture on the network interface to which the scanner is wired.",
        )
    return Pcap(order, ticks, link)
