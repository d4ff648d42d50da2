"""Files that are often given as recordings, but are none: what they are, and what to do."""

from __future__ import annotations

import shlex
from pathlib import PurePath

_CAPTURE = "Capture with tcpdump or Wireshark, which write pcap or pcapng."
_POINTS = (
    "Points were computed with a calibration already. To calibrate on them, name the program that "
    "computed them: `dialect` in the sample table, or --dialect of `velocal inspect`."
)
_PAGE = "The page that shows the file was saved. Download the file itself."
_LFS = "Get the recording with `git lfs pull`."

#: First bytes of a file, what it is, and the command that unpacks it.
_ARCHIVES = (
    (b"\x28\xb5\x2f\xfd", "is compressed with zstd", "zstd -d"),
    (b"\x04\x22\x4d\x18", "is compressed with lz4", "lz4 -d"),
    (b"PK\x03\x04", "is a zip archive", "unzip"),
    (b"7z\xbc\xaf\x27\x1c", "is a 7z archive", "7z x"),
    (b"Rar!\x1a\x07", "is a rar archive", "unrar x"),
)
#: First bytes of a file, what it is, and what to do.
_KINDS = (
    (b"version https://git-lfs", "is a pointer of Git LFS, not the recording itself", _LFS),
    (b"LASF", "is a LAS file of points", _POINTS),
    (b"ply", "is a PLY file of points", _POINTS),
    (b"# .PCD", "is a PCD file of points", _POINTS),
    (b"VERSION", "is a PCD file of points", _POINTS),
)
_PAGES = (b"<!doctype html", b"<html")
#: Where the name of the format stands in a tar archive.
_TAR_AT = 257


def other_kind(head: bytes, where: str) -> tuple[str, str]:
    """Name a file that is no recording.

    Parameters
    ----------
    head : bytes
        First bytes of the content.
    where : str
        The file.

    Returns
    -------
    what : str
        What it is, after the name of the file.
    hint : str
        What to do.
    """
    name = shlex.quote(PurePath(where).name)
    for magic, what, command in _ARCHIVES:
        if head.startswith(magic):
            return what, f"Unpack it with `{command} {name}`."
    if head[_TAR_AT:].startswith(b"ustar"):
        return "is a tar archive", f"Unpack it with `tar -xf {name}`."
    for magic, what, hint in _KINDS:
        if head.startswith(magic):
            return what, hint
    if head[:1024].lstrip(b"\xef\xbb\xbf \t\r\n").lower().startswith(_PAGES):
        return "is a web page", _PAGE
    if not head.strip(b"\0"):
        return "holds zeros only", "The file was never written to its end. Copy it again."
    return "is no recording", _CAPTURE
