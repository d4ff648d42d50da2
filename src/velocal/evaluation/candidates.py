"""Calibrations that are compared: the part that each plays, and the name of a parameter set."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum

from velocal.errors import VelocalError
from velocal.scanner.parameters import LaserParameters

#: Columns by which every table tells calibrations from each other.
IDENTITY = ("role", "parameter_set")


class Role(StrEnum):
    """Part that a calibration plays in a comparison."""

    FACTORY = "factory"  #: what the scanner came with
    WINDOW = "window"  #: adjusted on the window whose residuals are looked at
    SET = "set"  #: a parameter set, which has a name
    UNIT = "unit"  #: a calibration of a unit on all stations together, which has a name


@dataclass(frozen=True)
class Candidate:
    """A calibration whose residuals are looked at.

    Attributes
    ----------
    role : Role
    parameters : LaserParameters
    parameter_set : str
        Name of the parameter set or calibration; empty for the other roles. Any name is possible,
        because names and roles are in two columns.

    Raises
    ------
    VelocalError
        If a parameter set or a calibration has no name, or another role has one.
    """

    role: Role
    parameters: LaserParameters
    parameter_set: str = ""

    def __post_init__(self) -> None:
        if (self.role in (Role.SET, Role.UNIT)) != bool(self.parameter_set):
            raise VelocalError(
                f"role {self.role.value!r} with the name {self.parameter_set!r}",
                where="candidates",
                allowed="a name for the roles 'set' and 'unit', none for the others",
            )

    @property
    def identity(self) -> dict[str, str]:
        """Columns `IDENTITY`."""
        return {"role": self.role.value, "parameter_set": self.parameter_set}


def with_sets(
    factory: LaserParameters,
    sets: Mapping[str, LaserParameters],
    units: Collection[str] = (),
) -> list[Candidate]:
    """The factory's calibration, then the parameter sets and calibrations.

    Parameters
    ----------
    factory : LaserParameters
    sets : mapping of str to LaserParameters
        By name.
    units : collection of str
        Names of those that are calibrations of a unit on all stations together.

    Returns
    -------
    list of Candidate
    """
    return [
        Candidate(Role.FACTORY, factory),
        *(
            Candidate(Role.UNIT if name in units else Role.SET, parameters, name)
            for name, parameters in sets.items()
        ),
    ]
