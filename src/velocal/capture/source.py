"""Senders of packets: which scanner of a capture is meant, and who sent what."""

from __future__ import annotations

import ipaddress
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from velocal.capture.chunk import Chunk
from velocal.capture.ledger import Ledger
from velocal.errors import RecordingError

#: A sender of no more packets than this is a damaged address, unless all senders are as rare.
STRAY_PACKETS = 2


@dataclass(frozen=True)
class SourceFilter:
    """Which of several scanners in a capture is meant.

    Attributes
    ----------
    port : int or None
        UDP port to which it sends; any port if None.
    address : str or None
        IPv4 address from which it sends, or the topic of a bag; any address if None.
    """

    port: int | None = None
    address: str | None = None

    def __str__(self) -> str:
        parts = [] if self.address is None else [f"from {self.address}"]
        return " ".join(parts + ([] if self.port is None else [f"to port {self.port}"]))

    def accepts(self, sender: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Tell which senders are meant.

        Parameters
        ----------
        sender : ndarray of int64, shape (n,)
            `65536 * address + port`, see `Chunk.sender`.

        Returns
        -------
        ndarray of bool, shape (n,)

        Raises
        ------
        RecordingError
            If the address of this filter is not a valid IPv4 address.
        """
        accepted = np.ones(len(sender), dtype=bool)
        if self.port is not None:
            accepted &= sender & 0xFFFF == self.port
        if self.address is not None:
            try:
                number = int(ipaddress.IPv4Address(self.address))
            except ValueError:
                raise RecordingError(
                    f"{self.address!r} is not an IPv4 address",
                    where="address",
                    allowed="such as 192.168.1.201; in a bag, the topic",
                ) from None
            accepted &= sender >> 16 == number
        return accepted


#: Accepts every sender; a capture of one scanner needs no other filter.
ANY_SOURCE = SourceFilter()


class Senders:
    """Counts of the packets of every sender in a capture.

    Parameters
    ----------
    source : SourceFilter
        Which of them is meant.
    """

    def __init__(self, source: SourceFilter) -> None:
        self._source = source
        self._counts: Counter[int] = Counter()

    def select(self, chunks: Iterator[Chunk], ledger: Ledger) -> Iterator[Chunk]:
        """Keep the packets of the scanner that is meant; the others are entered in the ledger.

        Parameters
        ----------
        chunks : iterator of Chunk
        ledger : Ledger

        Yields
        ------
        Chunk
        """
        for chunk in chunks:
            if chunk.sender is None or len(chunk) == 0:
                yield chunk
                continue
            found, counts = chunk.sender[:1], np.array([len(chunk)])
            if (chunk.sender != found).any():
                found, counts = np.unique(chunk.sender, return_counts=True)
            accepted = self._source.accepts(found)
            for sender, n, is_accepted in zip(found, counts, accepted, strict=True):
                self._counts[int(sender)] += int(n)
                if not is_accepted:
                    bytes_ = int(chunk.sizes[chunk.sender == sender].sum())
                    ledger.reject(f"from {sender_name(int(sender))}", int(n), bytes_)
            if not accepted.all():
                chunk = chunk.select(np.isin(chunk.sender, found[accepted]))
            # A mixture of several scanners is of no use. It is counted for the error at the end.
            if sum(n > STRAY_PACKETS for n in self._accepted().values()) < 2:
                yield chunk

    def by_name(self) -> dict[str, int]:
        """Packets by address and port."""
        return _named(self._counts)

    def check(self, where: str) -> None:
        """Check, after all packets were counted, that one scanner is meant and is there.

        Parameters
        ----------
        where : str
            The capture, for errors.

        Raises
        ------
        RecordingError
            If no packets come from the scanner that is meant, or several scanners could be meant.
        """
        scanners = self._scanners()
        if self._counts and not scanners:
            raise RecordingError(
                f"holds no data packets {self._source}",
                where=where,
                allowed=listed(self.by_name()),
                hint="The address is that of the scanner. The port is the one to which it sends.",
            )
        if len(scanners) > 1:
            raise RecordingError(
                f"holds data packets of {len(scanners)} scanners",
                where=where,
                allowed=listed(_named(scanners)),
                hint="Choose one by its port or its address (--port, --address).",
            )

    def _accepted(self) -> Counter[int]:
        """Senders that are meant."""
        keys = np.array(list(self._counts), dtype=np.int64)
        accepted = keys[self._source.accepts(keys)]
        return Counter({int(key): self._counts[int(key)] for key in accepted})

    def _scanners(self) -> Counter[int]:
        """Senders that are meant, without those that are damaged addresses."""
        accepted = self._accepted()
        most = max(accepted.values(), default=0)
        return Counter({s: n for s, n in accepted.items() if n > STRAY_PACKETS or 10 * n >= most})


def sender_name(sender: int) -> str:
    """Address and port of a sender, see `Chunk.sender`."""
    return f"{ipaddress.IPv4Address(sender >> 16)}:{sender & 0xFFFF}"


def listed(counts: Mapping[str, int], what: str = "packets") -> str:
    """Write counts by name in one line, for messages."""
    return "; ".join(f"{name}, {n} {what}" for name, n in counts.items())


def _named(counts: Counter[int]) -> dict[str, int]:
    """Packets by address and port, ascending."""
    return {sender_name(sender): counts[sender] for sender in sorted(counts)}
