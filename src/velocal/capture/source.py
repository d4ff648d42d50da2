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
#: Number of senders that are told apart; in junk every packet may have another one.
MOST_SENDERS = 1000
#: Number of names in a message.
TOLD = 12


#: A sender: the two halves of its IPv6 address, and the port to which it sends. An IPv4 address is
#: the IPv6 address ::ffff:a.b.c.d (RFC 4291).
SENDER = np.dtype([("high", "u8"), ("low", "u8"), ("port", "u2")])
_HALF = (1 << 64) - 1
_MAPPED = 0xFFFF << 32
#: A sender as a key: the three numbers of `SENDER`.
_Key = tuple[int, int, int]
_OTHERS: _Key = (0, 0, 0)


def senders_of(heads: NDArray[np.uint8]) -> NDArray[np.void]:
    """Senders of packets.

    Parameters
    ----------
    heads : ndarray of uint8, shape (n, 6) or (n, 18)
        IPv4 or IPv6 source address and destination port, as in the headers.

    Returns
    -------
    ndarray of SENDER, shape (n,)
    """
    found = np.zeros(len(heads), dtype=SENDER)
    found["port"] = np.ascontiguousarray(heads[:, -2:]).view(">u2")[:, 0]
    if heads.shape[1] == 6:
        found["low"] = _MAPPED + np.ascontiguousarray(heads[:, :4]).view(">u4")[:, 0].astype(
            np.uint64
        )
    else:
        found["high"] = np.ascontiguousarray(heads[:, :8]).view(">u8")[:, 0]
        found["low"] = np.ascontiguousarray(heads[:, 8:16]).view(">u8")[:, 0]
    return found


@dataclass(frozen=True)
class SourceFilter:
    """Which of several scanners in a capture is meant.

    Attributes
    ----------
    port : int or None
        UDP port to which it sends; any port if None.
    address : str or None
        IPv4 or IPv6 address from which it sends, or the topic of a bag; any address if None.
    """

    port: int | None = None
    address: str | None = None

    def __str__(self) -> str:
        parts = [] if self.address is None else [f"from {self.address}"]
        return " ".join(parts + ([] if self.port is None else [f"to port {self.port}"]))

    def accepts(self, sender: NDArray[np.void]) -> NDArray[np.bool_]:
        """Tell which senders are meant.

        Parameters
        ----------
        sender : ndarray of SENDER, shape (n,)

        Returns
        -------
        ndarray of bool, shape (n,)

        Raises
        ------
        RecordingError
            If the address of this filter is not a valid IP address.
        """
        accepted = np.ones(len(sender), dtype=bool)
        if self.port is not None:
            accepted &= sender["port"] == self.port
        if self.address is not None:
            try:
                address = ipaddress.ip_address(self.address)
            except ValueError:
                raise RecordingError(
                    f"{self.address!r} is not an IP address",
                    where="address",
                    allowed="such as 192.168.1.201; in a bag, the topic",
                ) from None
            number = int(address) + (_MAPPED if address.version == 4 else 0)
            accepted &= (sender["high"] == number >> 64) & (sender["low"] == number & _HALF)
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
        self._counts: Counter[_Key] = Counter()

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
            found, of = chunk.sender[:1], np.zeros(len(chunk), dtype=np.int64)
            if (chunk.sender != found).any():
                found, of = np.unique(chunk.sender, return_inverse=True)
            counts, bytes_ = np.bincount(of), np.bincount(of, weights=chunk.sizes)
            accepted = self._source.accepts(found)
            for number, sender in enumerate(found):
                self._count(sender.item(), int(counts[number]))
                if not accepted[number]:
                    reason = f"from {sender_name(sender.item())}"
                    ledger.reject(reason, int(counts[number]), int(bytes_[number]))
            if not accepted.all():
                chunk = chunk.select(self._source.accepts(chunk.sender))
            # A mixture of several scanners is of no use. It is counted for the error at the end.
            if sum(n > STRAY_PACKETS for n in self._accepted().values()) < 2:
                yield chunk

    def _count(self, sender: _Key, packets: int) -> None:
        """Count packets; beyond `MOST_SENDERS`, all other senders are one."""
        known = sender in self._counts or len(self._counts) < MOST_SENDERS
        self._counts[sender if known else _OTHERS] += packets

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

    def _accepted(self) -> Counter[_Key]:
        """Senders that are meant."""
        keys = list(self._counts)
        accepted = self._source.accepts(np.array(keys, dtype=SENDER))
        return Counter(
            {key: self._counts[key] for key, is_ in zip(keys, accepted, strict=True) if is_}
        )

    def _scanners(self) -> Counter[_Key]:
        """Senders that are meant, without those that are damaged addresses."""
        accepted = self._accepted()
        del accepted[_OTHERS]
        most = max(accepted.values(), default=0)
        return Counter({s: n for s, n in accepted.items() if n > STRAY_PACKETS or 10 * n >= most})


def sender_name(sender: _Key) -> str:
    """Address and port of a sender: 192.168.1.201:2368, or [fe80::1]:2368."""
    if sender == _OTHERS:
        return "other senders"
    high, low, port = sender
    address = ipaddress.IPv6Address(high << 64 | low)
    return f"[{address}]:{port}" if address.ipv4_mapped is None else f"{address.ipv4_mapped}:{port}"


def listed(counts: Mapping[str, int], what: str = "packets") -> str:
    """Write counts by name in one line, for messages; of many, only the first ones."""
    found = [f"{name}, {n} {what}" for name, n in counts.items()]
    more = [f"and {len(found) - TOLD} others"] if len(found) > TOLD else []
    return "; ".join(found[:TOLD] + more)


def _named(counts: Counter[_Key]) -> dict[str, int]:
    """Packets by address and port, ascending."""
    return {sender_name(sender): counts[sender] for sender in sorted(counts)}
