"""A recording of any kind as a stream of packets in order, with a ledger of every byte."""

from __future__ import annotations

import ipaddress
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from velocal.capture import rosbag as bags
from velocal.capture.chunk import Chunk
from velocal.capture.framing import (
    PCAP_FILE_HEADER,
    Framing,
    Pcap,
    Records,
    payload_positions,
)
from velocal.capture.gzip_stream import GZIP_MAGIC, Content, Unpacked
from velocal.capture.ledger import Ledger
from velocal.capture.order import Sequence
from velocal.capture.pcapng import SECTION, PcapNg
from velocal.capture.udp import HEADER_BYTES, LINKS
from velocal.errors import RecordingError
from velocal.packets.data import PAYLOAD_BYTES

HEAD_BYTES = 1 << 20
#: A sender of so few packets is a damaged address, unless all senders are as rare.
STRAY_PACKETS = 2
#: The end of content whose length is not known.
_NO_END = 1 << 62

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Choice:
    """Which of several scanners in a capture.

    Attributes
    ----------
    port : int or None
        UDP port to which it sends; any if None.
    address : str or None
        IPv4 address from which it sends, or the topic of a bag; any if None.
    """

    port: int | None = None
    address: str | None = None

    def __str__(self) -> str:
        parts = [] if self.address is None else [f"from {self.address}"]
        return " ".join(parts + ([] if self.port is None else [f"to port {self.port}"]))

    def mask(self, sender: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Senders that are meant.

        Raises
        ------
        RecordingError
            If the address is none.
        """
        meant = np.ones(len(sender), dtype=bool)
        if self.port is not None:
            meant &= sender & 0xFFFF == self.port
        if self.address is not None:
            try:
                number = int(ipaddress.IPv4Address(self.address))
            except ValueError:
                raise RecordingError(
                    f"{self.address!r} is no IPv4 address",
                    where="address",
                    allowed="such as 192.168.1.201; in a bag, the topic",
                ) from None
            meant &= sender >> 16 == number
        return meant


ANY = Choice()


def sender_name(sender: int) -> str:
    """Address and port of a sender."""
    return f"{ipaddress.IPv4Address(sender >> 16)}:{sender & 0xFFFF}"


@dataclass
class Recording:
    """An opened recording; see `open_recording`.

    Attributes
    ----------
    path : Path
    choice : Choice
    framing : Framing or None
        None for a bag.
    compressed : bool
    enterable : bool
        Whether packets can be read from any on; after a complete read, also whether they were in
        order.
    """

    path: Path
    choice: Choice
    framing: Framing | None
    compressed: bool
    head: bytes = field(repr=False)
    enterable: bool = True

    @property
    def name(self) -> str:
        """Framing as it is called in ledgers."""
        if self.framing is None:
            return "ROS 1 bag" if self.head.startswith(b"#ROSBAG") else "ROS 2 bag"
        return self.framing.name + (", gzip" if self.compressed else "")

    def packets(self, ledger: Ledger, progress: Progress | None = None) -> Iterator[Chunk]:
        """All sound packets of the chosen scanner, in order; fills the ledger.

        Raises
        ------
        RecordingError
            At the end, if there are several scanners, or not the one that was meant.
        """
        senders: Counter[int] = Counter()
        sequence = Sequence(ledger)
        ledger.framing = self.name
        source = self._source(ledger, progress)
        for chunk in sequence.mended(self._chosen(source, ledger, senders)):
            n = len(chunk)
            ledger.data.add(n, n * PAYLOAD_BYTES)
            ledger.framing_bytes += int(chunk.sizes.sum()) - n * PAYLOAD_BYTES
            yield chunk
        if self.framing is None:
            ledger.senders = {self.choice.address or "": ledger.data.packets}
        else:
            self._check_senders(senders)
            ledger.senders = _named(senders)
        if sequence.changed or ledger.assembled:
            self.enterable = False

    def packets_from(self, start: int, stop: int) -> Iterator[Chunk]:
        """Sound packets of the chosen scanner that begin in [start, stop), as they lie there."""
        assert self.framing is not None
        ledger = Ledger(file_bytes=0)
        with self.path.open("rb") as file:
            chunks = self.framing.chunks(file, start, stop, ledger)
            yield from self._chosen(chunks, ledger, Counter())

    def _source(self, ledger: Ledger, progress: Progress | None) -> Iterator[Chunk]:
        """Packets of all scanners, as they lie in the file."""
        if self.framing is None:
            yield from bags.chunks(self.path, self.head, self.choice.address or "", ledger)
            return
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            content: Content = Unpacked(file) if self.compressed else file
            stop = _NO_END if self.compressed else size
            ledger.framing_bytes += self.framing.first_packet
            for chunk in self.framing.chunks(content, self.framing.first_packet, stop, ledger):
                yield chunk
                if progress is not None:
                    progress(file.tell() if self.compressed else chunk.end, size)
            ledger.file_bytes = size
            if isinstance(content, Unpacked):
                ledger.file_bytes = content.end() + content.unreadable
                faults = int(content.unreadable > 0)
                reason = "compressed bytes that cannot be unpacked"
                ledger.reject(reason, faults, content.unreadable)
                ledger.reject("compressed file cut short", int(content.cut), 0)

    def _chosen(
        self, chunks: Iterator[Chunk], ledger: Ledger, senders: Counter[int]
    ) -> Iterator[Chunk]:
        """Packets of the chosen scanner; the others go into the ledger."""
        for chunk in chunks:
            if chunk.sender is None or len(chunk) == 0:
                yield chunk
                continue
            found, counts = chunk.sender[:1], np.array([len(chunk)])
            if (chunk.sender != found).any():
                found, counts = np.unique(chunk.sender, return_counts=True)
            meant = self.choice.mask(found)
            for sender, n, is_meant in zip(found, counts, meant, strict=True):
                senders[int(sender)] += int(n)
                if not is_meant:
                    bytes_ = int(chunk.sizes[chunk.sender == sender].sum())
                    ledger.reject(f"from {sender_name(int(sender))}", int(n), bytes_)
            if not meant.all():
                chunk = chunk.take(np.isin(chunk.sender, found[meant]))
            # What is mixed of several scanners is of no use; it is counted up to the error.
            often = sum(n > STRAY_PACKETS for n in self._meant(senders).values())
            if often < 2:
                yield chunk

    def _meant(self, senders: Counter[int]) -> Counter[int]:
        """Senders that are meant."""
        keys = np.array(list(senders), dtype=np.int64)
        return Counter({int(key): senders[int(key)] for key in keys[self.choice.mask(keys)]})

    def _scanners(self, senders: Counter[int]) -> Counter[int]:
        """Senders that are meant, without those that are damaged addresses."""
        meant = self._meant(senders)
        most = max(meant.values(), default=0)
        return Counter({s: n for s, n in meant.items() if n > STRAY_PACKETS or 10 * n >= most})

    def _check_senders(self, senders: Counter[int]) -> None:
        scanners = self._scanners(senders)
        if senders and not scanners:
            raise RecordingError(
                f"holds no data packets {self.choice}",
                where=str(self.path),
                allowed=_listed(_named(senders)),
                hint="An address is that of the scanner, a port that to which it sends.",
            )
        if len(scanners) > 1:
            raise RecordingError(
                f"holds data packets of {len(scanners)} scanners",
                where=str(self.path),
                allowed=_listed(_named(scanners)),
                hint="Choose one by its port or its address (--port, --address).",
            )


def _named(senders: Counter[int]) -> dict[str, int]:
    return {sender_name(sender): senders[sender] for sender in sorted(senders)}


def _listed(counts: dict[str, int], what: str = "packets") -> str:
    return "; ".join(f"{name}, {n} {what}" for name, n in counts.items())


def open_recording(path: Path, choice: Choice = ANY) -> Recording:
    """Find out what a recording is.

    Raises
    ------
    RecordingError
        If it is missing, empty, of no known framing, or a bag in which no topic or several could
        be meant.
    """
    try:
        folder = path.is_dir() and (path / "metadata.yaml").is_file()
        head = b""
        if not folder:
            with path.open("rb") as file:
                head = file.read(HEAD_BYTES)
    except OSError as error:
        raise RecordingError(
            f"cannot be read: {error.strerror}", where=str(path), hint="Check the path."
        ) from None
    if folder or bags.is_bag(head):
        return Recording(path, _topic(path, head, choice), None, False, head, enterable=False)
    compressed = head.startswith(GZIP_MAGIC)
    if compressed:
        with path.open("rb") as file:
            head = Unpacked(file).read(HEAD_BYTES)
        if bags.is_bag(head):
            raise RecordingError(
                "is a compressed ROS bag", where=str(path), hint="Unpack it with `gunzip`."
            )
    framing = detect(head, str(path))
    if choice != ANY and not framing.addressed:
        raise RecordingError(
            f"{framing.name} have no addresses to choose by",
            where=str(path),
            hint="Leave out the port and the address.",
        )
    choice.mask(np.empty(0, dtype=np.int64))  # a wrong address is told before a long scan
    return Recording(path, choice, framing, compressed, head, framing.enterable and not compressed)


def _topic(path: Path, head: bytes, choice: Choice) -> Choice:
    """Choice of the topic of a bag.

    Raises
    ------
    RecordingError
        If none could be meant, or several.
    """
    found = bags.topics(path, head)
    if not found:
        raise RecordingError(
            "is a ROS bag without messages of type VelodyneScan",
            where=str(path),
            hint="Record the topic /velodyne_packets.",
        )
    topics = [choice.address] if choice.address in found else list(found)
    if choice.port is not None or (choice.address and choice.address not in found):
        raise RecordingError(
            f"holds no messages {choice}",
            where=str(path),
            allowed=_listed(found, "messages"),
            hint="In a bag a scanner is chosen by its topic, as --address.",
        )
    if len(topics) > 1:
        raise RecordingError(
            f"holds data of {len(topics)} scanners",
            where=str(path),
            allowed=_listed(found, "messages"),
            hint="Choose one by its topic, as --address.",
        )
    return Choice(address=topics[0])


_PCAP_MAGIC = {
    b"\xd4\xc3\xb2\xa1": ("<", 1e6),
    b"\xa1\xb2\xc3\xd4": (">", 1e6),
    b"\x4d\x3c\xb2\xa1": ("<", 1e9),
    b"\xa1\xb2\x3c\x4d": (">", 1e9),
}


def detect(head: bytes, where: str) -> Framing:
    """Find how packets are delimited, by the first MiB of the content.

    Raises
    ------
    RecordingError
        If the content is empty or of no known framing.
    """
    if not head:
        raise RecordingError("is empty", where=where)
    if head[:4] in _PCAP_MAGIC and len(head) >= PCAP_FILE_HEADER:
        order, ticks = _PCAP_MAGIC[head[:4]]
        link = struct.unpack_from(order + "I", head, 20)[0] & 0x0FFFFFFF
        if link not in LINKS:
            raise RecordingError(
                f"pcap of link type {link}",
                where=where,
                allowed=", ".join(f"{link} ({name})" for link, (name, *_) in LINKS.items()),
                hint="Capture on the network interface to which the scanner is wired.",
            )
        return Pcap(order, ticks, link)
    if head[:4] == SECTION:
        return PcapNg()
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
        where=where,
        allowed="records of 1206 or 1248 bytes, pcap, pcapng, any of them gzipped, or a ROS bag",
        hint="Capture with tcpdump or Wireshark, which write pcap or pcapng.",
    )
