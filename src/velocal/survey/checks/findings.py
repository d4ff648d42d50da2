"""What the checks of a survey find: errors stop the run, warnings stand on top of the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

from velocal.errors import SurveyError
from velocal.io import storage

Severity = Literal["error", "warning"]

#: Probability of a finding in a correct survey, of every check, over all its tests together.
SIGNIFICANCE = 1e-3
#: An effect on distances that exceeds this many standard deviations of the datasheet cannot be an
#: error of a scanner that meets its datasheet: it is an error, a smaller one is a warning.
SEVERE = 3.0


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or may be, with a survey, a recording or a calibration file.

    Attributes
    ----------
    severity : str
        ``error`` where the result would be wrong, ``warning`` where it may be.
    check : str
        Name of the check.
    where : str
        File, position, sample, plane or target.
    message : str
        What was found, with numbers.
    allowed : str
        What would have been right.
    hint : str
        What to do.
    """

    severity: Severity
    check: str
    where: str
    message: str
    allowed: str = ""
    hint: str = ""

    def __str__(self) -> str:
        text = f"{self.where}: {self.message}"
        text += f" (allowed: {self.allowed})" if self.allowed else ""
        return text + (f" Hint: {self.hint}" if self.hint else "")


def severity(effect_m: float, sigma_m: float) -> Severity:
    """Severity of a significant effect on distances; see `SEVERE`.

    Parameters
    ----------
    effect_m : float
        Change of distances to the planes, metres.
    sigma_m : float
        Standard deviation of a distance in the datasheet, metres.
    """
    return "error" if effect_m > SEVERE * sigma_m else "warning"


def columns(findings: Sequence[Finding]) -> dict[str, list[str]]:
    """Columns of the table of findings, one row each, errors first.

    Parameters
    ----------
    findings : sequence of Finding
    """
    rows = sorted(findings, key=lambda each: each.severity)
    return {name.name: [getattr(row, name.name) for row in rows] for name in fields(Finding)}


def read_findings(path: Path) -> list[Finding]:
    """Read the table of findings, ``survey/checks.csv``.

    Parameters
    ----------
    path : Path
    """
    names = [each.name for each in fields(Finding)]
    table = storage.read_csv(path, text=names)
    return [Finding(*row) for row in zip(*(table[name] for name in names), strict=True)]


def raise_errors(findings: Sequence[Finding]) -> None:
    """Stop if a finding is an error.

    Parameters
    ----------
    findings : sequence of Finding

    Raises
    ------
    SurveyError
        With all errors, those of one kind together.
    """
    errors: dict[tuple[str, str], list[Finding]] = {}
    for each in findings:
        if each.severity == "error":
            errors.setdefault((each.check, each.hint), []).append(each)
    if errors:
        lines = ""
        for alike in errors.values():
            lines += f"\n- {alike[0]}"
            if len(alike) > 1:
                lines += f"\n  The same at {'; '.join(each.where for each in alike[1:])}."
        raise SurveyError(
            f"the survey and the recordings contradict each other, nothing is exported:{lines}"
        )
