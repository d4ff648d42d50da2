"""Tables of what the checks of a survey found."""

from __future__ import annotations

from collections.abc import Sequence

from velocal.io.markup import markdown_table
from velocal.survey.checks import findings
from velocal.survey.checks.run import Checked, PlaneRow


def plane_columns(rows: Sequence[PlaneRow]) -> dict[str, list[object]]:
    """Columns of ``survey/checks_planes.csv``: what every sample says of every plane.

    Parameters
    ----------
    rows : sequence of PlaneRow

    Returns
    -------
    dict of str to list
        ``sample``, ``position``, ``plane``; ``medians`` that should lie on it by the direction of
        their beams, the shares of them ``within_pct`` the limits and ``behind_pct`` the plane;
        ``mean_s_cm`` of those within; ``nearer_cm`` and its standard deviation: by how much the
        plane lies nearer to the scanner than surveyed, by the medians.
    """
    return {
        "sample": [row.sample for row in rows],
        "position": [row.position for row in rows],
        "plane": [row.seen.plane for row in rows],
        "medians": [row.seen.beams for row in rows],
        "within_pct": [round(row.seen.within * 100, 2) for row in rows],
        "behind_pct": [round(row.seen.behind * 100, 2) for row in rows],
        "mean_s_cm": [round(row.seen.mean_s_m * 100, 3) for row in rows],
        "nearer_cm": [round(row.shift_m * 100, 2) for row in rows],
        "nearer_std_cm": [round(row.shift_std_m * 100, 2) for row in rows],
    }


def markdown(checked: Checked) -> str:
    """Both tables as a page of Markdown.

    Parameters
    ----------
    checked : Checked
    """
    lines = ["# Checks of the survey", ""]
    of_findings = findings.columns(checked.findings)
    for title, table in (("Findings", of_findings), ("Planes", plane_columns(checked.planes))):
        rows = [[str(cell) for cell in row] for row in zip(*table.values(), strict=True)]
        numeric = [title == "Planes" and name[-3:] in ("pct", "_cm", "ans") for name in table]
        body = markdown_table([*table], rows, numeric) if rows else ["None."]
        lines += [f"## {title}", "", *body, ""]
    return "\n".join(lines)
