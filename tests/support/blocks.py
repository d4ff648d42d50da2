"""Fenced blocks of the pages, and what a program that is not run would have been asked for."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass

from snakemake.cli import get_argument_parser

from support.running import ROOT

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGES += [ROOT / "config/README.md", ROOT / "results/README.md"]
#: Language of a block, which says what a test does with it.
RUN, READ, SHOWN = ("sh", "python"), ("yaml",), ("text", "mermaid", "{toctree}")
#: A block of a shell that no test can run says why in its first line.
_BLOCK = re.compile(
    r"^```(?P<language>\S*)(?: not run: (?P<reason>[^\n]+))?\n(?P<text>.*?)^```$", re.M | re.S
)


@dataclass(frozen=True)
class Block:
    """A block, by its page and its place among the blocks of this page, from 1."""

    page: str
    number: int
    language: str
    text: str
    reason: str

    def __str__(self) -> str:
        return f"{self.page}, block {self.number}"


def blocks() -> list[Block]:
    """All blocks of all pages."""
    return [
        Block(
            page.relative_to(ROOT).as_posix(), number, found["language"], found["text"],
            found["reason"] or "",
        )
        for page in PAGES
        for number, found in enumerate(_BLOCK.finditer(page.read_text(encoding="utf-8")), 1)
    ]  # fmt: skip


def check_command(line: str) -> None:
    """Check that a command, its options and the files that it names exist, without running it.

    Raises
    ------
    AssertionError
        If one of them does not exist.
    """
    program, *arguments = shlex.split(line, comments=True)
    if program == "make":
        targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.M)
        assert set(arguments) <= set(targets), line
    elif program == "python":
        assert (ROOT / arguments[0]).is_file(), line
    elif program == "snakemake":
        try:
            asked = get_argument_parser().parse_args(arguments)
        except SystemExit:
            raise AssertionError(line) from None
        for path in asked.configfile or ():
            assert (ROOT / path).is_file(), line
    else:
        assert program in ("pipx", "podman"), line
