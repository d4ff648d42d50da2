"""The one way in which files are written: complete or not at all, and never onto an input."""

from __future__ import annotations

import errno
import io
import os
import secrets
import signal
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, NoReturn

from velocal.errors import OutputError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

#: End of the name of a file that is not complete yet.
PART = ".part"
#: Bytes that are collected before they are written.
_BUFFER_BYTES = 1 << 18
_HINTS = {
    errno.ENOSPC: "Make room on the disk, or write to another one.",
    errno.EDQUOT: "Your quota is used up: make room, or write to another disk.",
    errno.EFBIG: "The limit of the size of a file is reached (`ulimit -f`).",
    errno.EROFS: "The disk is read-only: write to another folder.",
    errno.EACCES: "Check the permissions of the folder and of the file (`ls -ld`).",
    errno.EPERM: "Check the permissions of the folder and of the file (`ls -ld`).",
    errno.ENOENT: "Make the folder first (`mkdir -p`), or check the path.",
    errno.ENOTDIR: "Check the path: a part of it that should be a folder is a file.",
    errno.EISDIR: "Name a file, not a folder.",
    errno.ENAMETOOLONG: "Choose a shorter name.",
}


class _Descriptor(io.FileIO):
    """The open file, which keeps its first fault: writers of others may hide it behind theirs."""

    def __init__(self, descriptor: int, path: Path) -> None:
        super().__init__(descriptor, "wb")
        self._path = path
        self.fault: OutputError | None = None
        self.abandoned = False

    def write(self, data: ReadableBuffer, /) -> int:
        if self.abandoned:
            return memoryview(data).nbytes  # what a buffer still holds is of no use any more
        try:
            return super().write(data)
        except OSError as error:
            self.fault = _fault(error, self._path)
            raise self.fault from None


@contextmanager
def new_file(path: Path) -> Iterator[IO[bytes]]:
    """Open a file that takes its name when the block succeeds.

    Until then the bytes are in a file of a random name in the same folder. When the block fails,
    that file is removed, and what had the name before is still there. A link of this name is
    replaced; the file behind it is not changed.

    Parameters
    ----------
    path : Path
        File to write, in a folder that exists. A regular file of this name is replaced, and its
        permissions are kept.

    Yields
    ------
    file : binary file
        All bytes must go through it: then a fault while writing (such as a full disk) is an
        error with the name of the file.

    Raises
    ------
    OutputError
        If `path` cannot be written, or is anything but a regular file.
    """
    mode = _check(path)
    name = f".{path.name:.40}.{secrets.token_hex(8)}{PART}"
    temporary = path.with_name(name)
    with writing(path):
        # With O_EXCL a link that somebody has put there is an error, and is not followed.
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0)
        descriptor = os.open(temporary, flags, 0o666 if mode is None else mode)
    raw = _Descriptor(descriptor, path)
    file = io.BufferedWriter(raw, _BUFFER_BYTES)
    try:
        try:
            yield file
            file.flush()
            with writing(path):
                os.fsync(descriptor)
        except BaseException:
            raw.abandoned = True
            raise
        finally:
            file.close()
        _check(path)
        with writing(path):
            if mode is not None:
                temporary.chmod(mode)
            temporary.replace(path)
        _sync_folder(path.parent)
    except Exception:
        if raw.fault is not None:
            raise raw.fault from None
        raise
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def check_outputs(
    outputs: Iterable[Path], inputs: Iterable[Path] = (), *, overwrite: bool = True
) -> None:
    """Check files to be written before the work begins.

    Parameters
    ----------
    outputs : iterable of Path
        Files to be written.
    inputs : iterable of Path
        Files, or folders of files, that are read. Names that do not exist are passed over.
    overwrite : bool
        Whether files that exist may be replaced.

    Raises
    ------
    OutputError
        If an output is an input (the same file, also by a link), two outputs are the same file,
        an output exists and must not be replaced, or cannot be written.
    """
    taken: dict[tuple[int, int], tuple[str, Path]] = {}
    for path in inputs:
        for file in (path, *path.rglob("*")) if path.is_dir() else (path,):
            with suppress(OSError):
                taken[_identity(file)] = ("the input", path)
    named: set[Path] = set()
    for path in outputs:
        with suppress(OSError):
            what, other = taken.get(_identity(path), ("", path))
            if what:
                raise OutputError(
                    f"is the same file as {what} {str(other)!r}",
                    where=str(path),
                    hint="Choose another name for the output: the input would be lost.",
                )
        with writing(path):
            resolved = path.parent.resolve() / path.name
        if resolved in named:
            raise OutputError(
                "is named for two outputs", where=str(path), hint="Choose another name for one."
            )
        named.add(resolved)
        _check(path)
        if not overwrite and os.path.lexists(path):
            raise OutputError(
                "exists already",
                where=str(path),
                hint="Choose another name, or overwrite it with --force.",
            )


@contextmanager
def stopped_cleanly() -> Iterator[None]:
    """End Python at SIGTERM and SIGHUP as at its regular end, so that no unfinished file is left.

    The exit code is 128 and the number of the signal, as in a shell. Only the main thread may
    call this.
    """

    def stop(number: int, _: object) -> NoReturn:
        raise SystemExit(128 + number)

    names = ("SIGTERM", "SIGHUP")  # Windows has no SIGHUP
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _identity(path: Path) -> tuple[int, int]:
    """Device and number of a file, which all names and links of it share."""
    found = path.stat()
    return found.st_dev, found.st_ino


def _check(path: Path) -> int | None:
    """Check that a file can be written; permissions of the one that is there, if any.

    Raises
    ------
    OutputError
        If its folder is missing or write-protected, or something is there that is no regular
        file or is write-protected.
    """
    folder = path.parent
    if not folder.is_dir():
        number = errno.ENOTDIR if folder.exists() else errno.ENOENT
        raise OutputError(
            f"there is no folder {str(folder)!r}", where=str(path), hint=_HINTS[number]
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(
            f"the folder {str(folder)!r} is write-protected",
            where=str(path),
            hint=_HINTS[errno.EACCES],
        )
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return None
    except OSError as error:
        raise _fault(error, path) from None
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "no regular file (a device, pipe or socket)"
        raise OutputError(
            f"is {kind}",
            where=str(path),
            allowed="a new file, or a regular file",
            hint=_HINTS[errno.EISDIR] if stat.S_ISDIR(mode) else "Choose another name.",
        )
    if not os.access(path, os.W_OK):
        raise OutputError("is write-protected", where=str(path), hint=_HINTS[errno.EACCES])
    return stat.S_IMODE(mode)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an `OSError` inside the block into an `OutputError` about a file to be written."""
    try:
        yield
    except OSError as error:
        raise _fault(error, path) from None


def _fault(error: OSError, path: Path) -> OutputError:
    reason = error.strerror or str(error)
    hint = _HINTS.get(error.errno or 0, "Look whether the disk is all right, or use another one.")
    return OutputError(f"cannot be written: {reason}", where=str(path), hint=hint)


def _sync_folder(folder: Path) -> None:
    """Have the new name of a file survive a loss of power, where the file system can do that."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
