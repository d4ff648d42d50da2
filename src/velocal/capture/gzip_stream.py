"""Content of gzip files, read forwards in little memory."""

from __future__ import annotations

import zlib
from typing import BinaryIO, Protocol

from velocal.errors import RecordingError

GZIP_MAGIC = b"\x1f\x8b"
#: Compressed bytes that are unpacked at a time: a fault costs no more than these.
PIECE_BYTES = 1 << 14
#: Largest number of bytes that one step of unpacking may give.
MOST_BYTES = 1 << 22
#: Number of bytes by which a seek may go back.
KEPT_BYTES = 1 << 20


class Content(Protocol):
    """The two methods of a file that readers need."""

    def seek(self, position: int, /) -> object:
        """Go to a byte of the content."""
        ...

    def read(self, size: int, /) -> bytes:
        """Read `size` bytes, fewer at the end."""
        ...


class GzipReader:
    """Content of a gzip file, of one or more members, with the methods of a file.

    Attributes
    ----------
    unreadable : int
        Compressed bytes that could not be unpacked, known at the end.
    cut : bool
        Whether the file ends within a member.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._member = zlib.decompressobj(31)
        self._packed = b""
        self._kept = bytearray()
        self._begin = 0
        self._at = 0
        self._ended = False
        self.unreadable = 0
        self.cut = False

    def seek(self, position: int, /) -> None:
        """Go to a byte of the content.

        Raises
        ------
        RecordingError
            If the byte lies more than `KEPT_BYTES` before the last one read.
        """
        if position < self._begin:
            raise RecordingError("a compressed recording can only be read forwards")
        self._at = position

    def read(self, size: int, /) -> bytes:
        """Unpack `size` bytes, fewer at the end."""
        stop = self._at + size
        while not self._ended and self._begin + len(self._kept) < stop:
            self._kept += self._more()
            spare = min(self._at - KEPT_BYTES - self._begin, len(self._kept))
            if spare > 0:
                del self._kept[:spare]
                self._begin += spare
        place = self._at - self._begin
        found = bytes(self._kept[place : place + size])
        self._at += len(found)
        return found

    def end(self) -> int:
        """Number of unpacked bytes, known at the end."""
        while not self._ended:
            self._at = self._begin + len(self._kept)
            self.read(MOST_BYTES)
        return self._begin + len(self._kept)

    def _more(self) -> bytes:
        """Unpack some more."""
        if self._member.eof:
            self._packed = self._member.unused_data or self._packed
            self._member = zlib.decompressobj(31)
            if not self._packed:
                self._packed = self._file.read(PIECE_BYTES)
            while self._packed and not self._packed.strip(b"\0"):
                self._packed = self._file.read(PIECE_BYTES)  # padding after the last member
            if not self._packed:
                self._ended = True
                return b""
        piece = self._packed or self._file.read(PIECE_BYTES)
        if not piece:
            self._ended = self.cut = True
            return b""
        try:
            content = self._member.decompress(piece, MOST_BYTES)
        except zlib.error:
            here = self._file.tell()
            self.unreadable = len(piece) + self._file.seek(0, 2) - here
            self._ended = True
            return b""
        self._packed = self._member.unconsumed_tail
        return content
