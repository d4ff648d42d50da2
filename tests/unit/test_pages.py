"""Pages and texts: what they name exists, and their words are plain."""

import re
from importlib import import_module
from pathlib import Path

import pytest
from support.blocks import PAGES

from velocal.errors import VelocalError
from velocal.io import markup

ROOT = Path(__file__).parents[2]
TEXTS = [
    path
    for pattern in ("src/**/*", "scripts/*.py", "workflow/**/*", "config/*.yaml", "Makefile")
    for path in sorted(ROOT.glob(pattern))
    if path.suffix in (".py", ".smk", ".yaml", ".tsv", ".j2", "") and path.is_file()
]
SOURCES = [path for name in ("src", "tests", "benchmarks") for path in (ROOT / name).rglob("*.py")]
#: Idioms, and words that had several meanings, with the word to use instead in the comments.
UNCLEAR = re.compile(
    r"so many-th|turned on by|comes? to rest|hangs? together|for ever\b|\bmend(?:s|ed)?\b|"
    r"\barms?\b|"  # methods
    r"\bgates\b|"  # limits of the assignment
    r"\bsights\b|"  # polar observations
    r"open combination|"  # combination that is not estimable
    r"sample sheet|"  # sample table
    r"field frame|frame of the field|"  # site frame
    r"angle cells?\b|"  # azimuth bin
    r"printed cells?\b|"  # entry
    r"\brow_std\b",  # sigma_misclosure
    re.IGNORECASE,
)


def named(page, pattern):
    """What a page names in backticks that looks like a pattern."""
    return re.findall(rf"`({pattern})`", page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_files_that_a_page_names_exist(page):
    folders = "src/velocal|scripts|workflow|config|docs|tests|benchmarks"
    for name in named(page, rf"(?:{folders})/[\w./-]+"):
        assert (ROOT / name).exists(), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_modules_that_a_page_names_exist(page):
    """Also those that are named within their folder, such as `adjustment/core.py`."""
    for name in named(page, r"[\w/]+\.py"):
        assert any(path.as_posix().endswith(f"/{name}") for path in [*SOURCES, *TEXTS]), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_names_of_the_library_that_a_page_uses_exist(page):
    for name in named(page, r"velocal(?:\.\w+)+"):
        parts = name.split(".")
        if parts[1] in ("kind", "version", "facts"):  # keys in the metadata of Parquet files
            continue
        found = import_module(parts[0])
        for depth, part in enumerate(parts[1:], start=2):
            if not hasattr(found, part):
                import_module(".".join(parts[:depth]))
            found = getattr(found, part)


@pytest.mark.parametrize("path", [*PAGES, *TEXTS], ids=lambda p: p.relative_to(ROOT).as_posix())
def test_words_are_plain(path):
    text = path.read_text(encoding="utf-8")
    # The names of random numbers stay: another name would give other numbers.
    lines = [line for line in text.splitlines() if UNCLEAR.search(line) and "rng(" not in line]
    assert not lines


def test_unclear_words_are_found():
    assert UNCLEAR.search("Only every so many-th of them.")
    assert not UNCLEAR.search("Recommended limits of the parameters.")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_marks_of_a_page_are_complete_and_name_a_command(page):
    for name, (maker, content) in markup.marked(page.read_text(encoding="utf-8")).items():
        assert content, name
        scripts = re.findall(r"[\w/]+\.py", maker)
        assert maker.startswith(("make ", "python ")), name
        assert all((ROOT / script).is_file() for script in scripts), name


def test_text_between_marks_is_replaced_and_nothing_else():
    page = "a\n<!-- numbers: x (made by make y) -->\n\nold\n\n<!-- end -->\nb\n"
    assert markup.inserted(page, "x", "new\n") == page.replace("old", "new")
    assert "(made by make z)" in markup.inserted(page, "x", "new", maker="make z")


@pytest.mark.parametrize(
    ("page", "what"),
    [
        ("<!-- numbers: x (made by make y) -->\n\nold\n", "0 complete pairs"),
        ("<!-- numbers: x -->\n\nold\n\n<!-- end -->\n", "0 complete pairs"),
        ("<!-- numbers: z (made by make y) -->\n\nold\n\n<!-- end -->\n", "no marks with the name"),
        (2 * "<!-- numbers: x (made by make y) -->\n\nold\n\n<!-- end -->\n", "two marks"),
    ],
)
def test_wrong_marks_are_an_error(page, what):
    with pytest.raises(VelocalError, match=what):
        markup.inserted(page, "x", "new")
