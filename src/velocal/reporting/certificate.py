"""Certificates as one page of HTML that needs no network."""

from __future__ import annotations

from collections.abc import Sequence

from velocal.evaluation.certificate import Certificate
from velocal.reporting.templates import environment


def render(certificates: Sequence[Certificate]) -> str:
    """Render certificates.

    Parameters
    ----------
    certificates : sequence of Certificate

    Returns
    -------
    str
        HTML.
    """
    template = environment().get_template("certificate.html.j2")
    return template.render(certificates=certificates)
