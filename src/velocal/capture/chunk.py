"""Chunks of packets as they pass from reader to reader."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array, joined_rows, rows_of


@dataclass(frozen=True)
class Chunk:
    """Valid data packets that follow one another in a file.

    Attributes
    ----------
    payloads : ndarray of uint8, shape (n, 1206)
        Payload of every packet.
    offsets : ndarray of int64, shape (n,)
        Where each packet, with its framing, begins in the file.
    sizes : ndarray of int64, shape (n,)
        Bytes of each packet in the file, with its framing.
    end : int
        Byte after the last packet looked at.
    capture_time_s : ndarray of float64, shape (n,), or None
        Time of capture, where the framing has one.
    sender : ndarray of `source.SENDER`, shape (n,), or None
        Source address and destination port, where the framing has them.
    """

    payloads: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    sizes: NDArray[np.int64]
    end: int
    capture_time_s: Array | None = None
    sender: NDArray[np.void] | None = None

    def __len__(self) -> int:
        return len(self.payloads)

    def select(self, rows: NDArray[np.generic] | slice) -> Chunk:
        """Select packets by a mask, by their numbers or by a slice."""
        return rows_of(self, rows)


def joined(parts: Sequence[Chunk]) -> Chunk:
    """Join chunks that follow one another in one file; there must be one at least."""
    if len(parts) == 1:
        return parts[0]
    return replace(joined_rows(parts), end=parts[-1].end)


def gathered(chunks: Iterable[Chunk], least: int) -> Iterator[Chunk]:
    """Join chunks, which damage may cut to single packets, to at least so many packets.

    Parameters
    ----------
    chunks : iterable of Chunk
        They follow one another.
    least : int
        Packets of every chunk but the last.

    Yields
    ------
    Chunk
    """
    held: list[Chunk] = []
    n = 0
    for chunk in chunks:
        held.append(chunk)
        n += len(chunk)
        if n >= least:
            yield joined(held)
            held, n = [], 0
    if n:
        yield joined(held)
