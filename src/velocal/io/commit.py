"""Commit of git that the library was made from.

`hatch_build.py` runs this file when it builds a package, so that it may import only what Python
brings.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

#: Where no commit is known.
UNKNOWN = "unknown"
#: In an installed package, and in the top folder of a source distribution.
NAME = "COMMIT"
_PACKAGE = Path(__file__).parents[1]


def commit() -> str:
    """Commit of the library that runs.

    Returns
    -------
    str
        40 hexadecimal digits, followed by ``-dirty`` where files differ from the commit; `UNKNOWN`
        outside a checkout of git if the package does not say it.
    """
    built = _PACKAGE / "shipped" / NAME
    if built.is_file():
        return built.read_text("ascii").strip()
    return commit_of(_PACKAGE.parents[1])


def commit_of(checkout: Path) -> str:
    """Commit of a checkout, as of `commit`; of an unpacked source distribution, what it says."""
    told = checkout / NAME
    if told.is_file():
        return told.read_text("ascii").strip()
    top = _git(checkout, "rev-parse", "--show-toplevel")
    # The folder may be ignored by the checkout of another project.
    if not top or Path(top) != checkout.resolve():
        return UNKNOWN
    answer = _git(checkout, "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty")
    return answer or UNKNOWN


def _git(folder: Path, *arguments: str) -> str:
    """What git answers; nothing if it is not there or does not answer."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()
