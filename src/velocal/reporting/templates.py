"""Environment of the templates of pages, with the filters that they use."""

from __future__ import annotations

import base64
from pathlib import Path

import jinja2
import numpy as np

DATA = Path(__file__).parent


def environment() -> jinja2.Environment:
    """Make the environment of all templates, with the filters that they use."""
    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(DATA),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters["fixed"] = fixed
    made.filters["base64"] = lambda png: base64.b64encode(png).decode("ascii")
    made.filters["number"] = lambda value: f"{value:.7g}"
    made.filters["grouped"] = lambda value: f"{value:,}".replace(",", "\u202f")
    return made


def fixed(value: float | None, decimals: int, factor: float = 1.0) -> str:
    """Number with fixed decimals and a true minus sign; a dash where there is none.

    Parameters
    ----------
    value : float or None
    decimals : int
    factor : float
        To the unit that is shown.

    Returns
    -------
    str
    """
    if value is None or not np.isfinite(value):
        return "–"
    text = f"{value * factor:.{decimals}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")
