"""Tables as Markdown and LaTeX: the one writer of both, and text between the marks of a page."""

from __future__ import annotations

import re
from collections.abc import Sequence

from velocal.errors import VelocalError

#: What a command writes stands in a page between these two lines, with an empty line after the
#: first and before the second one: a kind, a name, and who made it.
_MARKED = re.compile(
    r"^<!-- (?P<kind>\w+): (?P<name>\w+) \(made by (?P<maker>[^()\n]+)\) -->\n\n"
    r"(?P<content>.*?)\n\n<!-- end -->$",
    re.DOTALL | re.MULTILINE,
)

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


def marked(text: str) -> dict[str, tuple[str, str]]:
    """What stands between the marks of a page.

    Parameters
    ----------
    text : str
        A page. Its marks are ``<!-- numbers: NAME (made by COMMAND) -->`` and ``<!-- end -->``, or
        the same with another kind than numbers.

    Returns
    -------
    dict of str to (str, str)
        The command and the content, by name.

    Raises
    ------
    VelocalError
        If a mark has another form, a name comes twice, or an end is missing.
    """
    found = list(_MARKED.finditer(text))
    names = [match["name"] for match in found]
    lines = [line for line in text.splitlines() if line.startswith("<!--")]
    if not 2 * len(found) == len(lines) == 2 * lines.count("<!-- end -->"):
        raise VelocalError(
            f"{len(lines)} comments, but {len(found)} complete pairs of marks",
            where="a page",
            allowed="<!-- numbers: NAME (made by COMMAND) -->, an empty line, the numbers, an "
            "empty line, <!-- end -->",
        )
    if len(set(names)) < len(names):
        raise VelocalError(f"two marks with one name: {', '.join(names)}", where="a page")
    return {match["name"]: (match["maker"], match["content"]) for match in found}


def inserted(text: str, name: str, content: str, *, maker: str | None = None) -> str:
    """Put something else between two marks of a page.

    Parameters
    ----------
    text : str
        A page, see `marked`.
    name : str
    content : str
        Markdown.
    maker : str, optional
        The command that the first mark names from now on; as before if None.

    Returns
    -------
    str

    Raises
    ------
    VelocalError
        If the page has no marks with this name, or its marks are wrong.
    """
    known = marked(text)
    if name not in known:
        raise VelocalError(
            f"no marks with the name {name!r}",
            where="a page",
            allowed=", ".join(known) or "no name, as the page has no marks",
            hint=f"Add <!-- numbers: {name} (made by COMMAND) --> and <!-- end --> to the page.",
        )

    def again(match: re.Match[str]) -> str:
        if match["name"] != name:
            return match[0]
        head = f"{match['kind']}: {name} (made by {maker or match['maker']})"
        return f"<!-- {head} -->\n\n{content.strip()}\n\n<!-- end -->"

    return _MARKED.sub(again, text)
