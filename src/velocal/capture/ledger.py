"""Ledger of a recording: every byte is payload, framing, or rejected for a stated reason."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from velocal.errors import RecordingError

#: Number of different reasons that a ledger keeps; junk may give any number of them.
REASONS = 100
#: Number of reasons that the error names if nothing could be used.
TOLD = 6
_WHOLE = "`velocal inspect` shows the whole ledger."
#: What to do, by the beginning of the reason for which most packets are not used.
_HINTS = {
    "captured ": "The capture holds only the beginning of packets. Capture them whole, as "
    "`tcpdump -s 0` does.",
    "position packets": "A scanner sends its data to another port than its position packets, "
    "2368 unless it was changed. Capture that port as well.",
    "payload of ": f"Data packets of a Velodyne scanner have a payload of 1206 bytes. "
    f"Other devices or scanners of another maker sent these. {_WHOLE}",
    "unknown block flag": "These packets have the size of Velodyne data packets, but not their "
    "block flags: they come from a scanner of another maker, or are encrypted or damaged.",
    "not UDP: GRE": "This is mirrored or tunnelled traffic. Remove the outer headers, for ERSPAN "
    "type II with `editcap -C 50 -L IN OUT`, or capture where the scanner is wired.",
    "not ": "Capture on the network interface to which the scanner is wired.",
    "fragment without": "Fragments of all packets are missing. A filter on ports drops all but "
    "the first fragment of a packet: capture without it.",
    "bytes without": "The file is damaged, or its end was never written.",
    "message ": "Record the topic /velodyne_packets.",
}


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
            if reason not in self.rejected and len(self.rejected) >= REASONS:
                reason = "other reasons"
            self.rejected.setdefault(reason, Count()).add(packets, bytes_)

    def nothing_usable(self, where: str) -> NothingUsableError:
        """Error for a recording without any valid data packet: what it holds instead, and a hint.

        Parameters
        ----------
        where : str
            The recording.

        Returns
        -------
        NothingUsableError
        """
        counts = dict(self.rejected)
        if self.position.packets:
            counts["position packets"] = self.position
        reasons = sorted(counts, key=lambda reason: (-counts[reason].packets, reason))
        found = [f"{reason} ({counts[reason].packets})" for reason in reasons[:TOLD]]
        if len(reasons) > TOLD:
            found.append(f"{len(reasons) - TOLD} other reasons")
        hint = next((_HINTS[k] for r in reasons for k in _HINTS if r.startswith(k)), _WHOLE)
        what = "holds no valid data packet"
        if not found:
            hint = "It holds no packets at all: its filter may leave out the scanner."
        else:
            what += f"; it holds, by number: {'; '.join(found)}"
        return NothingUsableError(what, self, where=where, hint=hint)

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


class NothingUsableError(RecordingError):
    """A recording holds no valid data packet.

    Parameters
    ----------
    what : str
        What is wrong.
    ledger : Ledger
        What the recording holds instead.
    where, hint : str
        See `VelocalError`.
    """

    def __init__(self, what: str, ledger: Ledger, *, where: str, hint: str) -> None:
        self.ledger = ledger
        super().__init__(what, where=where, hint=hint)

    def __reduce__(self) -> tuple[object, ...]:
        return (_rebuild, (self.what, self.ledger, self.where, self.hint))


def _rebuild(what: str, ledger: Ledger, where: str, hint: str) -> NothingUsableError:
    return NothingUsableError(what, ledger, where=where, hint=hint)
