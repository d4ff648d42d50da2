"""Tables as Markdown and LaTeX: the one writer of both."""

from __future__ import annotations

from collections.abc import Sequence

_LATEX_SPECIAL = {
    "\\": r"\textbackslash{}",
    **{character: f"\\{character}" for character in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
}


def latex_text(text: str) -> str:
    """Plain text for LaTeX, with its special characters escaped."""
    return "".join(_LATEX_SPECIAL.get(character, character) for character in text)


def markdown_table(
    headings: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[bool]
) -> list[str]:
    """Lines of a Markdown table.

    Parameters
    ----------
    headings : sequence of str
        One per column.
    rows : sequence of sequence of str
        Cells; a vertical bar in one is escaped.
    numeric : sequence of bool
        Columns that are aligned to the right.

    Returns
    -------
    list of str
    """
    rule = "|".join("---:" if right else "---" for right in numeric)
    cells = [[cell.replace("|", r"\|") for cell in row] for row in rows]
    return [
        f"| {' | '.join(headings)} |",
        f"|{rule}|",
        *(f"| {' | '.join(row)} |" for row in cells),
    ]


def latex_tabular(
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    numeric: Sequence[bool],
    *,
    block: int | None = None,
) -> list[str]:
    r"""Lines of a LaTeX ``tabular`` for the package booktabs.

    Parameters
    ----------
    headings : sequence of str
        One per column, as LaTeX.
    rows : sequence of sequence of str
        Cells as plain text.
    numeric : sequence of bool
        Columns that are aligned to the right.
    block : int, optional
        Number of rows between two horizontal rules; no rule between rows if None.

    Returns
    -------
    list of str
    """
    lines = [
        rf"\begin{{tabular}}{{{''.join('r' if right else 'l' for right in numeric)}}}",
        r"\toprule",
        " & ".join(headings) + r" \\",
        r"\midrule",
    ]
    for number, row in enumerate(rows):
        if block and number and number % block == 0:
            lines.append(r"\midrule")
        lines.append(" & ".join(map(latex_text, row)) + r" \\")
    return [*lines, r"\bottomrule", r"\end{tabular}"]
