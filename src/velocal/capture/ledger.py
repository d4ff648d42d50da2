"""Ledger of a recording: every byte is payload, framing, or rejected for a stated reason."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass
class Count:
    """Packets (or stretches of bytes) of one kind."""

    packets: int = 0
    bytes: int = 0

    def add(self, packets: int, bytes_: int) -> None:
        """Add packets and their bytes, framing included."""
        self.packets += packets
        self.bytes += bytes_


@dataclass
class Ledger:
    """What a recording contains and how it was used.

    Attributes
    ----------
    file_bytes : int
        Size of the file; of its content where that is compressed; of the messages of a bag.
    framing : str
        How packets were delimited.
    data : Count
        Valid data packets, and the bytes of their payloads.
    framing_bytes : int
        File header and packet headers of the valid data packets.
    position : Count
        Position (GPS) packets, noted but not used.
    rejected : dict of str to Count
        What was not used, by reason.
    reordered : int
        Data packets that had arrived late and were put back in their order.
    assembled : int
        Datagrams that were put together from IP fragments.
    senders : dict of str to int
        Data packets by source address and destination port, or by topic of a bag.
    nmea : str
        Last sentence of the position packets; empty where there was none.
    """

    file_bytes: int
    framing: str = "unknown"
    data: Count = field(default_factory=Count)
    framing_bytes: int = 0
    position: Count = field(default_factory=Count)
    rejected: dict[str, Count] = field(default_factory=dict)
    reordered: int = 0
    assembled: int = 0
    senders: dict[str, int] = field(default_factory=dict)
    nmea: str = ""

    def reject(self, reason: str, packets: int, bytes_: int) -> None:
        """Enter packets that are not used.

        Parameters
        ----------
        reason : str
            Why they are not used.
        packets, bytes_ : int
            Their number and their bytes, framing included. If both are zero, nothing is entered.
        """
        if packets or bytes_:
            self.rejected.setdefault(reason, Count()).add(packets, bytes_)

    @property
    def unaccounted_bytes(self) -> int:
        """Bytes of the file that no entry explains; zero after a complete scan."""
        return (
            self.file_bytes
            - self.data.bytes
            - self.framing_bytes
            - self.position.bytes
            - sum(count.bytes for count in self.rejected.values())
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain mapping for JSON, with the balance."""
        return {**asdict(self), "unaccounted_bytes": self.unaccounted_bytes}
