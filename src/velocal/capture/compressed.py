"""Content of compressed files, read forwards in little memory."""

from __future__ import annotations

import bz2
import lzma
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import BinaryIO, Protocol

from velocal.errors import RecordingError

#: Compressed bytes that are unpacked at a time: a fault costs no more than these.
PIECE_BYTES = 1 << 14
#: Largest number of bytes that one step of unpacking may give.
MOST_BYTES = 1 << 22
#: Number of bytes by which a seek may go back.
KEPT_BYTES = 1 << 20
#: Memory that the dictionary of an xz file may need: `xz -9` needs 64 MiB.
_XZ_BYTES = 1 << 28


class Content(Protocol):
    """The two methods of a file that readers need."""

    def seek(self, position: int, /) -> object:
        """Go to a byte of the content."""
        ...

    def read(self, size: int, /) -> bytes:
        """Read `size` bytes, fewer at the end."""
        ...


class _Unpacker(Protocol):
    """What the standard library's decompressors share."""

    @property
    def eof(self) -> bool: ...
    @property
    def unused_data(self) -> bytes: ...
    def decompress(self, data: bytes, max_length: int, /) -> bytes: ...


@dataclass(frozen=True)
class Compression:
    """A format of compressed files.

    Attributes
    ----------
    name : str
    magic : bytes
        First bytes of a file.
    begin : callable
        Makes a decompressor of the standard library for one member of a file.
    command : str
        Program that unpacks such a file.
    """

    name: str
    magic: bytes
    begin: Callable[[], _Unpacker]
    command: str


COMPRESSIONS = (
    Compression("gzip", b"\x1f\x8b", lambda: zlib.decompressobj(31), "gunzip"),
    Compression("bzip2", b"BZh", bz2.BZ2Decompressor, "bunzip2"),
    Compression("xz", b"\xfd7zXZ\0", lambda: lzma.LZMADecompressor(memlimit=_XZ_BYTES), "unxz"),
)
#: Errors that decompressors raise on damaged data.
_FAULTS = (zlib.error, OSError, EOFError, lzma.LZMAError)


def compression_of(head: bytes) -> Compression | None:
    """Compression of a file by its first bytes, or None."""
    return next((each for each in COMPRESSIONS if head.startswith(each.magic)), None)


class UnpackedContent:
    """Content of a compressed file, of one or more members, with the methods of a file.

    Parameters
    ----------
    file : BinaryIO
    compression : Compression

    Attributes
    ----------
    unreadable : int
        Compressed bytes that could not be unpacked, known at the end.
    cut : bool
        Whether the file ends within a member.
    """

    def __init__(self, file: BinaryIO, compression: Compression) -> None:
        self._file = file
        self._begin_member = compression.begin
        self._member = compression.begin()
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
            self._member = self._begin_member()
            if not self._packed:
                self._packed = self._file.read(PIECE_BYTES)
            while self._packed and not self._packed.strip(b"\0"):
                self._packed = self._file.read(PIECE_BYTES)  # padding after the last member
            if not self._packed:
                self._ended = True
                return b""
        # Those of bzip2 and xz keep what is not unpacked yet, that of gzip gives it back.
        waiting = not getattr(self._member, "needs_input", True)
        piece = b"" if waiting else self._packed or self._file.read(PIECE_BYTES)
        if not piece and not waiting:
            self._ended = self.cut = True
            return b""
        try:
            content = self._member.decompress(piece, MOST_BYTES)
        except _FAULTS:
            here = self._file.tell()
            self.unreadable = len(piece) + self._file.seek(0, 2) - here
            self._ended = True
            return b""
        self._packed = getattr(self._member, "unconsumed_tail", b"")
        return content
