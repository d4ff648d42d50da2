"""Where results come from: digests of the library files that a script uses, versions."""

from __future__ import annotations

import ast
import hashlib
import platform
from functools import cache
from importlib import metadata
from pathlib import Path

PACKAGE = Path(__file__).parents[1]

#: Distributions whose version can change a number or a picture.
NUMERICAL = ("velocal", "numpy", "scipy", "pandas", "pyarrow", "matplotlib", "snakemake")


@cache
def _imported(path: Path) -> frozenset[Path]:
    """Modules that a file imports anywhere in its text, and data files beside it that it names."""
    if path.suffix != ".py":
        return frozenset()
    text = path.read_text(encoding="utf-8")
    beside = (path.parent, path.parent / "data") if path.is_relative_to(PACKAGE) else ()
    found = {
        data
        for folder in beside
        for data in folder.glob("*")
        if data.is_file() and data.suffix != ".py" and f'"{data.name}"' in text
    }
    for node in ast.walk(ast.parse(text)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            # `from a import b`: b may be a module of its own.
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            head, *rest = name.split(".")
            if head != PACKAGE.name:
                continue
            for depth in range(len(rest) + 1):
                place = PACKAGE.joinpath(*rest[:depth])
                module = place.with_suffix(".py") if depth else place / "__init__.py"
                found.update(file for file in (module, place / "__init__.py") if file.is_file())
    return frozenset(found)


def library_files(script: Path) -> list[Path]:
    """Files of the package that a script imports, directly or through others, sorted."""
    done: set[Path] = set()
    open_: set[Path] = set(_imported(script))
    while open_:
        file = open_.pop()
        done.add(file)
        open_ |= _imported(file) - done
    return sorted(done)


def library_digest(script: Path) -> str:
    """Digest of the content of `library_files`: it changes when any of them does.

    Snakemake sees when a script changes, but not when a module that it imports does; as a
    parameter of the rule this digest tells it.
    """
    digest = hashlib.sha256()
    for file in library_files(script):
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0")
        digest.update(file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Versions of Python and of the distributions that can change a result."""
    return {"python": platform.python_version()} | {
        name: metadata.version(name) for name in NUMERICAL
    }
