"""Which file something was made from: its size, and a digest of its bytes or of its two ends."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

#: Files up to this size are digested as a whole. Tables and calibrations are smaller.
WHOLE_BYTES = 8 << 20
#: Bytes of the beginning and of the end that are digested of a larger file.
END_BYTES = 1 << 19


@dataclass(frozen=True)
class FileIdentity:
    """Size and digest of a file, or of all files of a folder.

    Attributes
    ----------
    bytes : int
        Size.
    digest : str
        16 hexadecimal digits: of all bytes of a file up to `WHOLE_BYTES`, else of the first and
        the last `END_BYTES`.
    """

    bytes: int
    digest: str


def identify(path: Path) -> FileIdentity:
    """Identify a file by its content, which takes milliseconds for a file of any size.

    A change in the middle of a file of more than `WHOLE_BYTES` that keeps its size is not seen.

    Parameters
    ----------
    path : Path
        File, or folder of files (a ROS 2 bag).

    Returns
    -------
    FileIdentity

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    if path.is_dir():
        parts = {file.name: identify(file) for file in sorted(path.iterdir()) if file.is_file()}
        digest = hashlib.sha256(repr(parts).encode())
        return FileIdentity(sum(part.bytes for part in parts.values()), digest.hexdigest()[:16])
    with path.open("rb") as file:
        size = path.stat().st_size
        digest = hashlib.sha256(file.read(END_BYTES if size > WHOLE_BYTES else size))
        if size > WHOLE_BYTES:
            file.seek(size - END_BYTES)
            digest.update(file.read(END_BYTES))
    return FileIdentity(size, digest.hexdigest()[:16])
