"""The page `docs/reliability.md`: ``python tests/catalogue/page.py`` writes it again."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

if __name__ == "__main__":  # as pytest sets it
    sys.path.insert(0, str(Path(__file__).parents[1]))

from catalogue import calibrations, clouds, configuration, machine, recordings, tables
from catalogue.case import Case, Result, run
from velocal.io import storage
from velocal.io.markup import inserted, markdown_table

PAGE = Path(__file__).parents[2] / "docs/reliability.md"
KINDS: dict[str, tuple[Case, ...]] = {
    "recordings": recordings.CASES,
    "clouds": clouds.CASES,
    "calibrations": calibrations.CASES,
    "tables": tables.CASES,
    "configuration": configuration.CASES,
    "machine": machine.CASES,
}
HEADINGS = ("what is wrong", "what happens", "message")


#: Python words some of the messages; those of another version are not compared.
PYTHON = "Python {}.{}".format(*sys.version_info)


def count() -> str:
    """Number of all cases, and what made the messages."""
    return f"{sum(map(len, KINDS.values()))} cases; messages as with {PYTHON}."


def row(case: Case, result: Result) -> str:
    """Line of the page for a case."""
    said = [code(result.message)] if result.message else []
    said += [f"Hint: {code(result.hint)}"] if result.hint else []
    cells = (case.wrong, result.outcome.value, "<br>".join(said))
    return markdown_table(HEADINGS, [cells], [False] * 3)[-1]


def code(text: str) -> str:
    """Text that Markdown shows letter by letter."""
    fence = "``" if "`" in text else "`"
    space = " " if "`" in text else ""
    return f"{fence}{space}{text}{space}{fence}"


def results(cases: tuple[Case, ...], folder: Path) -> list[Result]:
    """What happens in each case."""
    found = []
    for number, case in enumerate(cases):
        place = folder / str(number)
        place.mkdir()
        found.append(run(case, place))
    return found


def write() -> None:
    """Write all rows again."""
    text = PAGE.read_text(encoding="utf-8")
    for kind, cases in KINDS.items():
        with tempfile.TemporaryDirectory() as folder:
            found = results(cases, Path(folder))
        head = markdown_table(HEADINGS, [], [False] * 3)
        lines = [*head, *(row(case, one) for case, one in zip(cases, found, strict=True))]
        text = inserted(text, kind, "\n".join(lines))
        for case, one in zip(cases, found, strict=True):
            if one.outcome != case.outcome:
                print(
                    f"{kind}: {case.wrong}: {one.outcome}, has to be {case.outcome}: {one.message}"
                )
    text = inserted(text, "count", count())
    storage.write_text(PAGE, text)


if __name__ == "__main__":
    write()
