"""What all framings share: their interface, sizes of reading, the search for the next payload.

A framing is the way in which packets are delimited in a file: records of equal size, pcap, pcapng.
Files are read in chunks. Damaged stretches are skipped up to the next valid packet, and every byte
is entered in a ledger. The end of the content need not be known: it is where reading ends.
"""

from __future__ import annotations

import errno
import io
import os
import re
from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from velocal.capture.chunk import Chunk
from velocal.capture.compressed import Content
from velocal.capture.ledger import Ledger
from velocal.packets.data import DUAL_BANKS_BLOCKS, FLAG_POSITIONS, PAYLOAD_BYTES
from velocal.scanner.models import BANK_FLAGS

#: Bytes that are read at a time.
CHUNK_BYTES = 8 << 20
#: Bytes that are read first after damage, as the next valid packet is usually near; reading then
#: grows up to `SEARCH_BYTES`.
FIRST_BYTES = 1 << 15
SEARCH_BYTES = 1 << 20
#: Bytes in which a payload is looked for first.
NEAR_BYTES = 1 << 13
#: By second byte: whether it is that of a block flag, whose first byte is FF.
_SECOND_OF_FLAG = np.isin(np.arange(256), [flag >> 8 for flag in BANK_FLAGS])
#: Longest packet that a header may state; a longer one is a damaged header.
MAX_CAPTURED = 1 << 18


class Framing(Protocol):
    """A way in which packets are delimited in a file."""

    @property
    def name(self) -> str:
        """Name of the framing in ledgers."""
        ...

    @property
    def first_packet(self) -> int:
        """Byte at which the first packet begins."""
        ...

    @property
    def seekable(self) -> bool:
        """Whether reading can start at any packet, without the bytes before it."""
        ...

    @property
    def addressed(self) -> bool:
        """Whether packets carry the address of their sender."""
        ...

    def chunks(self, file: Content, start: int, stop: int, ledger: Ledger) -> Iterator[Chunk]:
        """Read the valid packets that begin in [start, stop).

        Parameters
        ----------
        file : Content
        start, stop : int
            Bytes of the content.
        ledger : Ledger
            Receives what is not used, and the bytes of headers that belong to no data packet.

        Yields
        ------
        Chunk
        """
        ...


def payload_positions(data: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Positions in bytes at which twelve block flags follow as in a payload.

    Parameters
    ----------
    data : ndarray of uint8, shape (n,)

    Returns
    -------
    ndarray of int64
    """
    last = len(data) - PAYLOAD_BYTES
    if last < 0:
        return np.empty(0, dtype=np.int64)

    def of_bank(places: NDArray[np.int64]) -> NDArray[np.bool_]:
        return np.asarray((data[places] == 0xFF) & _SECOND_OF_FLAG[data[places + 1]])

    # Long runs of FF are left out before places are listed.
    starts = (data[: last + 1] == 0xFF) & (data[1 : last + 2] != 0xFF)
    positions: NDArray[np.int64] = np.flatnonzero(starts)
    for at in FLAG_POSITIONS[:DUAL_BANKS_BLOCKS]:
        positions = positions[of_bank(positions + at)]
    tails = positions[:, None] + FLAG_POSITIONS[DUAL_BANKS_BLOCKS:]
    first, second = data[tails], data[tails + 1]
    empty = (first == second) & ((first == 0) | (first == 0xFF))
    complete: NDArray[np.bool_] = of_bank(tails).all(axis=1) | empty.all(axis=1)
    return positions[complete]


def _pattern() -> re.Pattern[bytes]:
    """Payload of which only the block flags are known, see `payload_positions`."""
    between = b".{%d}" % (int(FLAG_POSITIONS[1]) - 2)
    full = b"\xff[\xee\xdd\xcc\xbb]" + between
    empty = b"(?:\xff\xff|\x00\x00)" + between
    unused = len(FLAG_POSITIONS) - DUAL_BANKS_BLOCKS
    tail = b"(?:%s|%s)" % (full * unused, empty * unused)
    rest = b".{%d}" % (PAYLOAD_BYTES - len(FLAG_POSITIONS) * int(FLAG_POSITIONS[1]))
    return re.compile(full * DUAL_BANKS_BLOCKS + tail + rest, re.DOTALL)


#: Matches a payload of which all block flags are known.
PAYLOAD = _pattern()


def find_payload(data: bytes, begin: int, end: int | None = None) -> int | None:
    """First of `payload_positions` from a byte on; what lies near costs little.

    Parameters
    ----------
    data : bytes
    begin : int
        Byte at which the search begins.
    end : int, optional
        Byte before which the payload ends; all bytes if left out.

    Returns
    -------
    int or None
        Byte at which the payload begins, or None if there is none.
    """
    end = len(data) if end is None else min(end, len(data))
    near = PAYLOAD.search(data, begin, min(begin + NEAR_BYTES, end))
    if near is not None:
        return near.start()
    begin, step = max(begin, min(begin + NEAR_BYTES, end) - PAYLOAD_BYTES + 1), NEAR_BYTES
    while end - begin >= PAYLOAD_BYTES:
        # A payload begins with FF: looking for that byte is quicker than comparing all of them.
        begin = data.find(b"\xff", begin, end)
        if begin < 0:
            return None
        stop = min(begin + step, end)
        found = payload_positions(np.frombuffer(data, np.uint8, stop - begin, begin))
        if len(found):
            return begin + int(found[0])
        begin = max(stop - PAYLOAD_BYTES + 1, begin)
        if stop == end:
            return None
        step = min(4 * step, SEARCH_BYTES)
    return None


def resynchronise(
    file: Content, position: int, header_bytes: int, stop: int, ledger: Ledger, reason: str
) -> int:
    """Skip damaged bytes up to the next packet that looks valid.

    Parameters
    ----------
    file : Content
    position : int
        Byte at which a packet was expected.
    header_bytes : int
        Bytes of a packet before its payload.
    stop : int
        Byte at which the search ends.
    ledger : Ledger
        Receives the bytes that are skipped.
    reason : str
        Why they are rejected.

    Returns
    -------
    int
        Byte at which the next packet begins, or at which reading ended.
    """
    found, end = _next_payload(file, position, header_bytes + 1, stop)
    after = end if found is None else found - header_bytes
    ledger.reject(reason, 1, after - position)
    return after


def _next_payload(file: Content, search: int, least: int, stop: int) -> tuple[int | None, int]:
    """Where the next payload lies, `least` bytes behind `search` or later; and where reading ended.

    Reading begins at `search`, because the content may end within the `least` bytes.
    """
    step = min(FIRST_BYTES, SEARCH_BYTES)
    while search < stop:
        hole = after_hole(file, search) - search
        search, least = search + hole, max(least - hole, 0)
        file.seek(search)
        data = file.read(step)
        found = find_payload(data, least)
        if found is not None:
            return search + found, stop
        if len(data) < step:
            return None, min(stop, search + len(data))
        search, least = search + len(data) - PAYLOAD_BYTES + 1, 0
        step = min(4 * step, SEARCH_BYTES)
    return None, stop


def after_hole(file: Content, position: int) -> int:
    """Skip the bytes of a sparse file that were never written; a payload cannot begin there.

    Parameters
    ----------
    file : Content
    position : int

    Returns
    -------
    int
        The same byte, or the first one after a hole; the end of the file if none follows. The same
        byte where the system or the content has no holes.
    """
    whence = getattr(os, "SEEK_DATA", None)
    if whence is None or not isinstance(file, io.BufferedReader):
        return position
    descriptor = file.fileno()
    before = os.lseek(descriptor, 0, os.SEEK_CUR)
    try:
        return os.lseek(descriptor, position, whence)
    except OSError as error:
        # No data follow; file systems without holes give another error.
        return os.fstat(descriptor).st_size if error.errno == errno.ENXIO else position
    finally:
        os.lseek(descriptor, before, os.SEEK_SET)
