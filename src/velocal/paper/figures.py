"""What became of every figure of the paper, and which figures of the study are not in it.

``data/figures.csv`` holds one row per figure. ``python -m velocal.paper.figures`` writes the table
into ``docs/figures.md``; tests compare it with that page and with the configuration.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from velocal.io import storage
from velocal.io.markup import inserted, markdown_table

FIGURES = Path(__file__).parent / "data/figures.csv"
#: Number of the paper's last figure.
LAST = 28
PAGE = Path("docs/figures.md")


@dataclass(frozen=True)
class PaperFigure:
    """A row of the table.

    Attributes
    ----------
    number : str
        Two digits, as in the names of files and in the configuration.
    paper : str
        What it shows in the paper, as far as that is known.
    drawn : bool
        Whether the study draws it.
    kind : str
        Its kind in the configuration, ``panels`` for those of ``outdoor.figures``; empty if it is
        not drawn.
    note : str
        What is drawn, or why nothing is.
    """

    number: str
    paper: str
    drawn: bool
    kind: str
    note: str


def figures() -> tuple[PaperFigure, ...]:
    """All figures of the paper, then those of the study that are not in it."""
    table = pd.read_csv(FIGURES, dtype=str, keep_default_na=False)
    return tuple(
        PaperFigure(
            number=str(row["figure"]).zfill(2),
            paper=row["paper"],
            drawn=row["here"] == "drawn",
            kind=row["kind"],
            note=row["note"],
        )
        for row in table.to_dict(orient="records")
    )


def with_table(text: str) -> str:
    """Return a page with the table between its marks made anew."""
    rows = [
        [
            str(int(each.number)),
            each.paper,
            f"`figure_{each.number}`" if each.drawn else "not drawn",
            f"`{each.kind}`" if each.kind else "",
            each.note,
        ]
        for each in figures()
    ]
    headings = ["figure", "in the paper", "here", "kind", "note"]
    table = "\n".join(markdown_table(headings, rows, [True, False, False, False, False]))
    return inserted(text, "figures", table)


if __name__ == "__main__":
    storage.write_text(PAGE, with_table(PAGE.read_text(encoding="utf-8")))
