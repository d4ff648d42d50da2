"""Packets of equal size appended to each other: bare records of 1206 or 1248 bytes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.capture import framing
from velocal.capture.chunk import Chunk
from velocal.capture.compressed import Content
from velocal.capture.ledger import Ledger
from velocal.capture.source import senders_of
from velocal.capture.udp import HEADER_BYTES, keep_valid
from velocal.packets.data import PAYLOAD_BYTES, check_payloads


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
        most = framing.CHUNK_BYTES // size
        position, at_once = start, most
        while position < stop:
            file.seek(position)
            wanted = min(at_once * size, -(-(stop - position) // size) * size)
            data = np.frombuffer(file.read(wanted), dtype=np.uint8)
            n = len(data) // size
            if n == 0:
                cut = int(len(data) > 0)
                ledger.reject("record cut short at the end of the file", cut, len(data))
                return
            records = data[: n * size].reshape(n, size)
            # Copied once: later steps look at the payloads as packets again and again.
            payloads = np.ascontiguousarray(records[:, self.header_bytes :])
            flags_known, azimuths_valid = check_payloads(payloads)
            # One bad record before a good one is a bad record; two in a row are lost alignment. One
            # with nothing after it to judge by is read again with what follows.
            suspect = np.flatnonzero(~flags_known & ~np.append(flags_known[1:], False))
            aligned = int(suspect[0]) if len(suspect) else n
            if aligned:
                end = position + aligned * size
                # A part of what was read is copied: as a view it would keep all of it in memory.
                part = payloads if aligned == n else payloads[:aligned].copy()
                chunk = self._chunk(records[:aligned], part, position, end)
                checked = flags_known[:aligned], azimuths_valid[:aligned]
                yield keep_valid(chunk, ledger, checked)
                position = end
            if aligned == 0 or aligned < n - 1:
                position = framing.resynchronise(
                    file, position, self.header_bytes, stop, ledger, "bytes without a record"
                )
            # After damage little is read at a time, as what follows the next damage is read again.
            few = max(framing.FIRST_BYTES // size, 2)
            at_once = min(2 * at_once if aligned == n else few, most)

    def _chunk(
        self, records: NDArray[np.uint8], payloads: NDArray[np.uint8], position: int, end: int
    ) -> Chunk:
        """Records that follow one another from a byte of the file on, as a chunk."""
        n, size = records.shape
        sender = None
        if self.addressed:
            sender = senders_of(records[:, [26, 27, 28, 29, 36, 37]])
        offsets = position + size * np.arange(n, dtype=np.int64)
        return Chunk(payloads, offsets, np.full(n, size, dtype=np.int64), end, None, sender)


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
