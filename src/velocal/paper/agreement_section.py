"""Agreement with the paper as the report shows it: per table, and statement by statement."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from velocal.paper import statements
from velocal.paper.printed import TOLERANCES, printed_rows


def cells(table: pd.DataFrame | None) -> dict[str, dict[str, Any]]:
    """Rows of the agreement by item."""
    if table is None:
        return {}
    rows = table.to_dict(orient="records")
    return {
        str(row["item"]): {
            **{str(name): value for name, value in row.items()},
            "within": str(row["within"]).lower() == "true",
        }
        for row in rows
    }


def counts(judged_cells: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """How many cells are within their tolerance: per quantity for every table, and in all."""
    if not judged_cells:
        return []
    rows = printed_rows()
    numbers = list(dict.fromkeys(row.table for row in rows))
    found = []
    for quantity in TOLERANCES:
        judged = {
            number: [
                judged_cells[row.item(quantity)]["within"] for row in rows if row.table == number
            ]
            for number in numbers
        }
        judged["all"] = [verdict for verdicts in judged.values() for verdict in verdicts]
        found.append(
            {
                "quantity": quantity,
                "of": {name: (sum(verdicts), len(verdicts)) for name, verdicts in judged.items()},
            }
        )
    return found


def statements_of(judged_cells: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Statements of the text with what they say, where, and the reproduced number."""
    return [
        {**judged_cells[item], "what": row["what"], "where": row["where"], "unit": row["unit"]}
        for row in statements.printed().to_dict(orient="records")
        if (item := statements.PREFIX + str(row["item"])) in judged_cells
    ]
