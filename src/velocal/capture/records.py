"""Packets of equal size appended to each other: bare records of 1206 or 1248 bytes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.capture import framing
from velocal.capture.chunk import Chunk, joined
from velocal.capture.compressed import Content
from velocal.capture.ledger import Ledger
from velocal.capture.source import senders_of
from velocal.capture.udp import HEADER_BYTES, keep_valid
from velocal.packets.data import PAYLOAD_BYTES, check_payloads

_LOST = "bytes without a record"


@dataclass(frozen=True)
class Records:
    """Packets of equal size appended to each other, with or without their 42 header bytes.

    Attributes
    ----------
    header_bytes : int
        0, or 42 for the headers of Ethernet, IPv4 and UDP.
    """

    header_bytes: int
    first_packet: int = 0
    seekable: bool = True

    @property
    def name(self) -> str:
        """Name of the framing in ledgers."""
        return f"records of {self.header_bytes + PAYLOAD_BYTES} bytes"

    @property
    def addressed(self) -> bool:
        """Whether packets carry the address of their sender."""
        return self.header_bytes == HEADER_BYTES

    def chunks(self, file: Content, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
        """Read records; where bytes were lost, find the next record by its block flags.

        Parameters and yields are those of `Framing.chunks`.
        """
        size = self.header_bytes + PAYLOAD_BYTES
        most = framing.CHUNK_BYTES // size * size
        position = start
        while position < stop:
            file.seek(position)
            data = file.read(min(most, -(-(stop - position) // size) * size))
            if len(data) < size:
                cut = int(len(data) > 0)
                ledger.reject("record cut short at the end of the file", cut, len(data))
                return
            chunk, here = self._intact(data, position, ledger)
            if here + size <= len(data):
                places, here = self._walk(data, here, ledger)
                both = [chunk, self._chunk(data, places, position, position + here, ledger)]
                # Joined parts are copies: as views, they would keep all data in memory.
                chunk = joined(both)
            yield chunk
            position += here
            if here == 0:
                position = framing.resynchronise(
                    file, position, self.header_bytes, stop, ledger, _LOST
                )

    def _intact(self, data: bytes, position: int, ledger: Ledger) -> tuple[Chunk, int]:
        """Records before the first two bad ones, or the last one, and where they end."""
        size = self.header_bytes + PAYLOAD_BYTES
        n = len(data) // size
        records = np.frombuffer(data, np.uint8, n * size).reshape(n, size)
        # Copied once: later steps look at the payloads as packets again and again.
        payloads = np.ascontiguousarray(records[:, self.header_bytes :])
        flags_known, azimuths_valid = check_payloads(payloads)
        # One bad record before a good one is a bad record; two in a row are lost alignment. One
        # with nothing after it to judge by is read again with what follows.
        suspect = np.flatnonzero(~flags_known & ~np.append(flags_known[1:], False))
        aligned = int(suspect[0]) if len(suspect) else n
        offsets = position + size * np.arange(aligned, dtype=np.int64)
        here = aligned * size
        chunk = self._found(records[:aligned], payloads[:aligned], offsets, position + here)
        checked = flags_known[:aligned], azimuths_valid[:aligned]
        return keep_valid(chunk, ledger, checked), here

    def _walk(self, data: bytes, here: int, ledger: Ledger) -> tuple[NDArray[np.int64], int]:
        """Where records begin from a byte on, one by one, and where the last one ends."""
        size, header = self.header_bytes + PAYLOAD_BYTES, self.header_bytes
        is_payload = framing.PAYLOAD.match
        places: list[int] = []
        while here + size <= len(data):
            if is_payload(data, here + header):
                places.append(here)
                here += size
            elif here + 2 * size > len(data):
                break
            elif is_payload(data, here + size + header):
                places += [here, here + size]
                here += 2 * size
            else:
                payload = framing.find_payload(data, here + header + 1)
                if payload is None:
                    break
                ledger.reject(_LOST, 1, payload - header - here)
                here = payload - header
        return np.array(places, dtype=np.int64), here

    def _chunk(
        self, data: bytes, places: NDArray[np.int64], position: int, end: int, ledger: Ledger
    ) -> Chunk:
        """Valid records of those that begin at `places`."""
        size = self.header_bytes + PAYLOAD_BYTES
        windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), size)
        records = windows[places]
        payloads = np.ascontiguousarray(records[:, self.header_bytes :])
        return keep_valid(self._found(records, payloads, position + places, end), ledger)

    def _found(
        self,
        records: NDArray[np.uint8],
        payloads: NDArray[np.uint8],
        offsets: NDArray[np.int64],
        end: int,
    ) -> Chunk:
        """Records as a chunk."""
        sender = None
        if self.addressed:
            sender = senders_of(records[:, [26, 27, 28, 29, 36, 37]])
        sizes = np.full(len(records), records.shape[1], dtype=np.int64)
        return Chunk(payloads, offsets, sizes, end, None, sender)


def records_in(head: bytes) -> Records | None:
    """Find the size of the records of a file.

    Parameters
    ----------
    head : bytes
        First bytes of the content.

    Returns
    -------
    Records or None
        None if the file does not consist of records.
    """
    positions = framing.payload_positions(np.frombuffer(head, dtype=np.uint8))
    if len(positions) == 1:
        return Records(HEADER_BYTES if positions[0] >= HEADER_BYTES else 0)
    # Damage changes some of the distances between payloads, another container all of them.
    distances = np.diff(positions)
    votes = {
        header: int((distances == header + PAYLOAD_BYTES).sum()) for header in (0, HEADER_BYTES)
    }
    if not any(votes.values()):
        return None
    return Records(max(votes, key=lambda header: votes[header]))
