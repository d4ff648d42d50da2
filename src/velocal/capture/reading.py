"""Captures of any kind as packets in order, with a ledger of every byte."""

from __future__ import annotations

import shlex
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np

from velocal.capture import rosbag
from velocal.capture.chunk import Chunk, gathered
from velocal.capture.compressed import (
    Compression,
    Content,
    UnpackedContent,
    compression_of,
)
from velocal.capture.framing import Framing
from velocal.capture.ledger import Ledger
from velocal.capture.order import Reorder
from velocal.capture.other_kinds import other_kind
from velocal.capture.pcap import pcap_of
from velocal.capture.pcapng import SECTION, PcapNg
from velocal.capture.records import records_in
from velocal.capture.source import ANY_SOURCE, SENDER, Senders, SourceFilter
from velocal.errors import RecordingError
from velocal.packets.data import PAYLOAD_BYTES

HEAD_BYTES = 1 << 20
#: Number of packets that are examined together, as damage may cut chunks to single packets.
GATHERED = 256
#: Just below the largest size to which glibc raises its limit, see `_keep_memory`.
_KEPT_BYTES = 31 << 20
#: Stands for the end of content whose length is not known.
_NO_END = 1 << 62

#: Called with the bytes that are done and with all bytes.
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Capture:
    """An opened capture; see `open_capture`.

    Attributes
    ----------
    path : Path
    source : SourceFilter
        Which of several scanners; of a bag, its topic.
    framing : Framing or None
        None for a bag.
    compression : Compression or None
        How the file is compressed.
    """

    path: Path
    source: SourceFilter
    framing: Framing | None
    compression: Compression | None
    head: bytes = field(repr=False)

    @property
    def name(self) -> str:
        """Name of the framing in ledgers."""
        if self.framing is None:
            return "ROS 1 bag" if self.head.startswith(b"#ROSBAG") else "ROS 2 bag"
        return self.framing.name + (f", {self.compression.name}" if self.compression else "")

    @property
    def seekable(self) -> bool:
        """Whether reading can start at any packet, without the bytes before it."""
        return self.framing is not None and self.framing.seekable and self.compression is None

    def read(self, progress: Progress | None = None) -> Reading:
        """Begin to read all packets.

        Parameters
        ----------
        progress : callable, optional
            Called with the bytes that are done and with all bytes.

        Returns
        -------
        Reading
            Its iteration raises a `RecordingError` at the end if the capture holds several
            scanners, or not the one that is meant.
        """
        return Reading(self, progress=progress)

    def read_between(self, start: int, stop: int) -> Reading:
        """Begin to read the packets that begin in [start, stop), in the order of the file.

        Parameters
        ----------
        start, stop : int
            Bytes of the file; a packet must begin at the first.

        Returns
        -------
        Reading
            Its ledger tells of the stretch only.

        Raises
        ------
        RecordingError
            If reading cannot start in the middle of this capture.
        """
        if not self.seekable:
            raise RecordingError(
                f"{self.name} can only be read from the beginning", where=str(self.path)
            )
        return Reading(self, stretch=(start, stop))


class _State(Enum):
    """How far a reading is."""

    NEW = "has not been read yet"
    PARTIAL = "has been read in part only"
    COMPLETE = "has been read to its end"


class Reading:
    """One pass through a capture: iterate over it for its valid packets, in order.

    The ledger and `seekable` are known only after the last packet. Asking for them earlier is an
    error, and so is a second iteration.

    Parameters
    ----------
    capture : Capture
    stretch : (int, int), optional
        First byte, and the byte from which on no packet is read any more. All bytes if left out.
    progress : callable, optional
        Called with the bytes that are done and with all bytes.
    """

    def __init__(
        self,
        capture: Capture,
        *,
        stretch: tuple[int, int] | None = None,
        progress: Progress | None = None,
    ) -> None:
        self._capture = capture
        self._stretch = stretch
        self._progress = progress
        self._state = _State.NEW
        self._ledger = Ledger(file_bytes=0, framing=capture.name)
        self._seekable = capture.seekable
        _keep_memory()

    @property
    def complete(self) -> bool:
        """Whether all packets have been read."""
        return self._state is _State.COMPLETE

    @property
    def ledger(self) -> Ledger:
        """What became of every byte; of a stretch, `file_bytes` are the bytes looked at.

        Raises
        ------
        RecordingError
            If the reading is not complete.
        """
        self._check_complete()
        return self._ledger

    @property
    def seekable(self) -> bool:
        """Whether reading can start at any packet, and packets then come as they came here.

        Raises
        ------
        RecordingError
            If the reading is not complete.
        """
        self._check_complete()
        return self._seekable

    def __iter__(self) -> Iterator[Chunk]:
        if self._state is not _State.NEW:
            raise RecordingError(
                "a reading of a capture gives its packets once",
                where=str(self._capture.path),
                hint="Call `read()` again.",
            )
        self._state = _State.PARTIAL
        return self._all() if self._stretch is None else self._between(*self._stretch)

    def _check_complete(self) -> None:
        """Raise an error if packets are left to read."""
        if not self.complete:
            raise RecordingError(
                f"{self._state.value}, so its ledger is not complete",
                where=str(self._capture.path),
                hint="Iterate over the reading up to its last packet.",
            )

    def _all(self) -> Iterator[Chunk]:
        """All packets in order; then what is known at the end."""
        capture, ledger = self._capture, self._ledger
        senders, order = Senders(capture.source), Reorder(ledger)
        for chunk in order.reordered(
            senders.select(gathered(self._in_file_order(), GATHERED), ledger)
        ):
            self._enter(chunk)
            yield chunk
        if capture.framing is None:
            ledger.senders = {capture.source.address or "": ledger.data.packets}
        else:
            senders.check(str(capture.path))
            ledger.senders = senders.by_name()
        # A packet that was moved or assembled does not come again when one starts in the middle.
        self._seekable &= not order.changed and not ledger.assembled
        self._state = _State.COMPLETE

    def _between(self, start: int, stop: int) -> Iterator[Chunk]:
        """Packets that begin in [start, stop), in the order of the file."""
        capture, ledger = self._capture, self._ledger
        assert capture.framing is not None
        senders = Senders(capture.source)
        with capture.path.open("rb") as file:
            chunks = capture.framing.chunks(file, start, stop, ledger)
            for chunk in senders.select(gathered(chunks, GATHERED), ledger):
                self._enter(chunk)
                yield chunk
        ledger.senders = senders.by_name()
        ledger.file_bytes = -ledger.unaccounted_bytes
        self._state = _State.COMPLETE

    def _enter(self, chunk: Chunk) -> None:
        """Enter packets in the ledger that are used."""
        n = len(chunk)
        self._ledger.data.add(n, n * PAYLOAD_BYTES)
        self._ledger.framing_bytes += int(chunk.sizes.sum()) - n * PAYLOAD_BYTES

    def _in_file_order(self) -> Iterator[Chunk]:
        """Packets of all scanners, in the order of the file."""
        capture, ledger = self._capture, self._ledger
        if capture.framing is None:
            topic = capture.source.address or ""
            yield from rosbag.chunks(capture.path, topic, ledger)
            return
        size = capture.path.stat().st_size
        with capture.path.open("rb") as file:
            packed = capture.compression
            content: Content = UnpackedContent(file, packed) if packed else file
            stop = _NO_END if packed else size
            first = capture.framing.first_packet
            ledger.framing_bytes += first
            for chunk in capture.framing.chunks(content, first, stop, ledger):
                yield chunk
                if self._progress is not None:
                    self._progress(file.tell() if packed else chunk.end, size)
            ledger.file_bytes = size
            if isinstance(content, UnpackedContent):
                ledger.file_bytes = content.end() + content.unreadable
                faults = int(content.unreadable > 0)
                reason = "compressed bytes that cannot be unpacked"
                ledger.reject(reason, faults, content.unreadable)
                ledger.reject("compressed file cut short", int(content.cut), 0)


def _keep_memory() -> None:
    """Let the C library keep memory that was freed for the next chunks and arrays.

    glibc returns large blocks to the system when they are freed, and the system clears every page
    of the next ones: up to a quarter of the time of a scan. From the size of the largest block that
    was freed on it does so no more (mallopt(3), M_MMAP_THRESHOLD). This block is freed untouched,
    so that it never takes memory. Other C libraries do nothing.
    """
    np.empty(_KEPT_BYTES, dtype=np.uint8)


def open_capture(path: Path, source: SourceFilter = ANY_SOURCE) -> Capture:
    """Find out what a capture is.

    Parameters
    ----------
    path : Path
        File, or folder of a ROS 2 bag.
    source : SourceFilter
        Which of several scanners.

    Returns
    -------
    Capture

    Raises
    ------
    RecordingError
        If it is missing, empty, of no known framing, or a bag in which no topic or several could
        be meant.
    """
    try:
        kind = path.stat().st_mode
        folder = stat.S_ISDIR(kind)
        if not folder and not stat.S_ISREG(kind):
            raise RecordingError(
                "is no regular file: reading it might never end",
                where=str(path),
                allowed="a file, or the folder of a ROS 2 bag",
                hint="Write what a pipe or a device gives into a file first.",
            )
        head = b""
        if not folder:
            with path.open("rb") as file:
                head = file.read(HEAD_BYTES)
    except OSError as error:
        raise RecordingError(
            f"cannot be read: {error.strerror}", where=str(path), hint="Check the path."
        ) from None
    if folder or rosbag.is_bag(head):
        topic = rosbag.topic_of_scanner(
            path, source.address, str(source), port=source.port is not None
        )
        return Capture(path, SourceFilter(address=topic), None, None, head)
    compression = compression_of(head)
    if compression is not None:
        unpack = f"`{compression.command} {shlex.quote(path.name)}`"
        with path.open("rb") as file:
            content = UnpackedContent(file, compression)
            head = content.read(HEAD_BYTES)
        if not head and content.unreadable:
            raise RecordingError(
                f"cannot be unpacked: its {compression.name} data are damaged, or need more memory "
                "than is allowed",
                where=str(path),
                hint=f"Copy it again, or unpack it with {unpack}.",
            )
        if rosbag.is_bag(head):
            raise RecordingError(
                "is a compressed ROS bag",
                where=str(path),
                hint=f"Unpack it with {unpack}.",
            )
    framing = detect(head, str(path))
    if source != ANY_SOURCE and not framing.addressed:
        raise RecordingError(
            f"{framing.name} have no addresses to choose by",
            where=str(path),
            hint="Leave out the port and the address.",
        )
    source.accepts(np.empty(0, dtype=SENDER))  # report a wrong address before a long scan
    return Capture(path, source, framing, compression, head)


def detect(head: bytes, where: str) -> Framing:
    """Find how packets are delimited.

    Parameters
    ----------
    head : bytes
        First MiB of the content.
    where : str
        The capture, for errors.

    Returns
    -------
    Framing

    Raises
    ------
    RecordingError
        If the content is empty or of no known framing.
    """
    if not head:
        raise RecordingError("is empty", where=where)
    if head[:4] == SECTION:
        return PcapNg()
    framing: Framing | None = pcap_of(head, where) or records_in(head)
    if framing is None:
        what, hint = other_kind(head, where)
        raise RecordingError(
            f"{what}: no Velodyne data packets in a known framing in its first MiB",
            where=where,
            allowed="records of 1206 or 1248 bytes, pcap, pcapng, any of them compressed with "
            "gzip, bzip2 or xz, or a ROS bag",
            hint=hint,
        )
    return framing
