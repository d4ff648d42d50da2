"""The family of errors that users see: what is wrong, where, what is allowed, and a hint."""

from __future__ import annotations

import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: Categories of Unicode that show nothing, or change how a terminal or a reader shows the rest:
#: controls, formats (bidirectional controls among them), lone surrogates, separators of lines.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})


def hidden(text: str) -> str | None:
    """Find the first character of a text that would not be seen.

    Parameters
    ----------
    text : str

    Returns
    -------
    str or None
        Its code, as ``U+001B``; None if all characters are seen.
    """
    found = next((one for one in text if unicodedata.category(one) in _HIDDEN), None)
    return None if found is None else f"U+{ord(found):04X}"


def visible(text: str, *, newlines: bool = False) -> str:
    r"""Text of a file or of a device as it may be shown: nothing in it acts on a terminal.

    Everything that goes to a terminal, a log or a message passes here: control characters (the
    escape sequences of terminals begin with one), bidirectional controls, invisible characters and
    bytes of file names that are no UTF-8 are replaced by their codes.

    Parameters
    ----------
    text : str
    newlines : bool
        Whether ends of lines remain: in texts that velocal itself puts together.

    Returns
    -------
    str

    Examples
    --------
    >>> visible("wall\x1b[31m 1")
    'wall\\x1b[31m 1'
    """
    if text.isprintable():  # most texts
        return text
    return "".join(
        ascii(one)[1:-1]
        if unicodedata.category(one) in _HIDDEN and not (newlines and one == "\n")
        else one
        for one in text
    )


class VelocalError(Exception):
    """A fault in what was handed over; shown to users without a traceback.

    Parameters
    ----------
    what : str
        What is wrong, with the offending value.
    where : str, optional
        File, packet, row or key.
    allowed : str, optional
        What would have been right.
    hint : str, optional
        What to do about it.
    """

    def __init__(
        self,
        what: str,
        *,
        where: str | None = None,
        allowed: str | None = None,
        hint: str | None = None,
    ) -> None:
        self.what, self.where, self.allowed, self.hint = what, where, allowed, hint
        super().__init__(str(self))

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        if self.allowed:
            text += f" (allowed: {self.allowed})"
        if self.hint:
            text += f"\nHint: {self.hint}"
        return visible(text, newlines=True)

    def __reduce__(self) -> tuple[object, ...]:
        # Errors cross process borders; the default would call __init__ with the finished text.
        return (_rebuild, (type(self), self.what, self.where, self.allowed, self.hint))


def _rebuild(
    kind: type[VelocalError],
    what: str,
    where: str | None,
    allowed: str | None,
    hint: str | None,
) -> VelocalError:
    return kind(what, where=where, allowed=allowed, hint=hint)


class ConfigError(VelocalError):
    """The configuration or one of its sample tables is wrong."""


class RecordingError(VelocalError):
    """A recording cannot be read, or is not what it is said to be."""


class CalibrationFileError(VelocalError):
    """A calibration file cannot be read or written."""


class DialectError(VelocalError):
    """A calibration cannot be converted to another point formula exactly."""


class SurveyError(VelocalError):
    """Survey data are missing, doubled or geometrically insufficient."""


class StorageError(VelocalError):
    """A file of our own is damaged or of another kind or version."""


class OutputError(VelocalError):
    """A file cannot be written, or must not be: it is an input, exists, or is no regular file."""


class RunError(VelocalError):
    """A run of the workflow cannot begin, or has ended before one of its jobs."""


class ScriptError(VelocalError):
    """A rule of the workflow and its script do not agree on names or types."""


@contextmanager
def reported(log: str | Path | None = None) -> Iterator[None]:
    """Turn a `VelocalError` inside the block into its message and exit code 1.

    Parameters
    ----------
    log : str or Path, optional
        File that gets the message as well.
    """
    try:
        yield
    except VelocalError as error:
        message = f"Error: {error}"
        if log:
            with suppress(OSError):  # the disk that is full may be that of the log
                Path(log).write_text(message + "\n", encoding="utf-8")
        print(message, file=sys.stderr)
        sys.exit(1)
