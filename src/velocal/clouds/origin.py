"""What `velocal points` writes into its files about the points: how they were made."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from velocal.scanner.parameters import LaserParameters

_FRAMES = ("velocal", "ros")


@dataclass(frozen=True)
class Origin:
    """How the points of a file of our own were made.

    Attributes
    ----------
    scanner : str
        Name of the scanner.
    frame : {"velocal", "ros"}
        Y forward and X right, or X forward and Y left.
    dialect : str
        Point formula by which the calibration was applied.
    rotation_rate_hz : float
        Rate at which azimuths within a firing were interpolated.
    parameters : str
        Digest of the numbers of the calibration (`digest`).
    """

    scanner: str
    frame: str
    dialect: str
    rotation_rate_hz: float
    parameters: str

    def facts(self) -> dict[str, Any]:
        """The same as plain values, for the file."""
        return asdict(self)

    @classmethod
    def from_facts(cls, facts: Mapping[str, Any]) -> Origin | None:
        """Read what `facts` gave.

        Parameters
        ----------
        facts : mapping

        Returns
        -------
        Origin or None
            None for files of other programs, and of versions of velocal that did not write it.
        """
        texts = [facts.get(name) for name in ("scanner", "frame", "dialect", "parameters")]
        rate = facts.get("rotation_rate_hz")
        if not all(isinstance(each, str) for each in texts) or texts[1] not in _FRAMES:
            return None
        if isinstance(rate, bool) or not isinstance(rate, int | float) or not np.isfinite(rate):
            return None
        scanner, frame, dialect, parameters = map(str, texts)
        return cls(scanner, frame, dialect, float(rate), parameters)


def digest(parameters: LaserParameters) -> str:
    """Tell numbers of a calibration from others: the first digits of their SHA-256.

    Parameters
    ----------
    parameters : LaserParameters

    Returns
    -------
    str
        Of all numbers, the carried ones too.
    """
    columns = [parameters.dl, parameters.alpha, parameters.v, parameters.voff, parameters.hoff]
    columns += [parameters.carried[name] for name in sorted(parameters.carried)]
    content = b"".join(np.ascontiguousarray(each, dtype="<f8").tobytes() for each in columns)
    return hashlib.sha256(content).hexdigest()[:16]


def facts_of(text: str) -> dict[str, Any]:
    """Facts out of a text that may hold them as JSON in braces; empty if it does not."""
    begin, end = text.find("{"), text.rfind("}")
    try:
        found = json.loads(text[begin : end + 1])
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
