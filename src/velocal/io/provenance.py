"""Where results come from: digests of the library files that a script uses, versions."""

from __future__ import annotations

import ast
import hashlib
import platform
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

PACKAGE = Path(__file__).parents[1]

#: Distributions whose version can change a number or a picture.
NUMERICAL = ("velocal", "numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pillow", "snakemake")


#: Distributions whose version is in the digest of every script that imports them, by the name of
#: the package that is imported.
IMPORTED = {
    **{name: name for name in ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "jinja2")},
    "PIL": "pillow",
}


@dataclass(frozen=True)
class Source:
    """What one file contributes to the digest of a script.

    Attributes
    ----------
    digest : bytes
        Of the syntax tree of a module without comments and docstrings, or of the bytes of a data
        file.
    files : frozenset of Path
        Modules of the package that it imports anywhere in its text, and data files beside it that
        it names.
    distributions : frozenset of str
        Distributions of `IMPORTED` that it imports.
    """

    digest: bytes
    files: frozenset[Path] = frozenset()
    distributions: frozenset[str] = frozenset()


def _without_docstrings(tree: ast.Module) -> ast.Module:
    """Remove texts that stand alone: docstrings, which change no result."""
    open_: list[ast.AST] = [tree]
    while open_:
        node = open_.pop()
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            # Statements only: a lambda and a conditional expression have such fields too.
            inner = getattr(node, name, None)
            if isinstance(inner, list):
                inner[:] = [each for each in inner if not _is_text(each)]
                open_ += inner
    return tree


def _is_text(node: ast.AST) -> bool:
    """Whether a statement is a text and nothing else."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


@cache
def _source(path: Path) -> Source:
    if path.suffix != ".py":
        return Source(hashlib.sha256(path.read_bytes()).digest())
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    beside = (path.parent, path.parent / "data") if path.is_relative_to(PACKAGE) else ()
    files = {
        data
        for folder in beside
        for data in folder.glob("*")
        if data.is_file() and data.suffix != ".py" and f'"{data.name}"' in text
    }
    distributions = set()
    for name in _imports(tree):
        head, *rest = name.split(".")
        if head in IMPORTED:
            distributions.add(IMPORTED[head])
        if head != PACKAGE.name:
            continue
        for depth in range(len(rest) + 1):
            files.update(_module_files(tuple(rest[:depth])))
    content = ast.dump(_without_docstrings(tree)).encode()
    return Source(hashlib.sha256(content).digest(), frozenset(files), frozenset(distributions))


# These caches matter: every run of Snakemake begins with the digests of all scripts.


@cache
def _module_files(parts: tuple[str, ...]) -> tuple[Path, ...]:
    """Files of a module of the package, if there is one of this name."""
    place = PACKAGE.joinpath(*parts)
    module = place.with_suffix(".py") if parts else place / "__init__.py"
    return tuple(file for file in {module, place / "__init__.py"} if file.is_file())


@cache
def _imported_version(distribution: str) -> str:
    """Version of a distribution that is there."""
    return metadata.version(distribution)


def _imports(tree: ast.AST) -> Iterator[str]:
    """Full names that a module imports; those that `from a import b` takes may be modules too.

    Imports for type checkers alone are left out: nothing of them is there when a script runs.
    """
    open_ = [tree]
    while open_:
        node = open_.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif not isinstance(node, ast.expr):  # an import is a statement
            open_ += ast.iter_child_nodes(node)


def library_files(script: Path) -> list[Path]:
    """Files of the package that a script imports, directly or through others, sorted.

    Parameters
    ----------
    script : Path

    Returns
    -------
    list of Path
    """
    done: set[Path] = set()
    open_: set[Path] = set(_source(script).files)
    while open_:
        file = open_.pop()
        done.add(file)
        open_ |= _source(file).files - done
    return sorted(done, key=str)


def library_digest(script: Path) -> str:
    """Digest of what can change the results of a script but is not in its own text.

    These are the content of `library_files`, without comments and docstrings, and the versions of
    the distributions that the script or one of these files imports. Snakemake sees when a script
    changes, but not when a module that it imports does; as a parameter of the rule this digest
    tells it.

    Parameters
    ----------
    script : Path

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    digest = hashlib.sha256()
    used = set(_source(script).distributions)
    for file in library_files(script):
        source = _source(file)
        used |= source.distributions
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0")
        digest.update(source.digest)
    for name in sorted(used):
        digest.update(f"{name} {_imported_version(name)}\0".encode())
    return digest.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Versions of Python and of the distributions that can change a result."""
    return {"python": platform.python_version()} | {name: _version(name) for name in NUMERICAL}


def _version(distribution: str) -> str:
    """Version of a distribution, without importing it."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"
