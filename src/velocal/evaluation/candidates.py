"""Calibrations that are compared: the part that each plays, and the name of a parameter set."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TypeVar

from velocal.adjustment.observations import Observations
from velocal.arrays import Array
from velocal.calibration.dialects import MANUAL, near_effect
from velocal.errors import VelocalError
from velocal.scanner.beam import Beams
from velocal.scanner.parameters import LaserParameters

_Shots = TypeVar("_Shots", Observations, Beams)
#: Columns by which every table tells calibrations from each other.
IDENTITY = ("role", "parameter_set")


class Role(StrEnum):
    """Part that a calibration plays in a comparison."""

    FACTORY = "factory"  #: what the scanner came with
    FACTORY_SINGLE = "factory_single"  #: the same with one distance correction, as in the paper
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
    near_points : bool
        Whether the near-point corrections that `parameters` carry are applied, as the file is
        meant. The paper leaves them out.

    Raises
    ------
    VelocalError
        If a parameter set or a calibration has no name, or another role has one.
    """

    role: Role
    parameters: LaserParameters
    parameter_set: str = ""
    near_points: bool = False

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

    def observed(self, data: _Shots) -> _Shots:
        """Shots with the distances to which `parameters` belong.

        Parameters
        ----------
        data : Observations or Beams
            With raw distances.

        Returns
        -------
        Observations or Beams
        """
        if not self.near_points:
            return data
        effect = near_effect(data.distance_m, data.phi, data.laser_id, self.parameters)
        return replace(data, distance_m=data.distance_m + effect)

    def misclosure(self, data: Observations) -> Array:
        """Distance s along the beam of every observation, metres, shape (n,)."""
        return self.observed(data).misclosure(self.parameters)

    def shown(self) -> tuple[Candidate, ...]:
        """Give this calibration, and what the paper makes of the same file where that differs."""
        if self.near_points and MANUAL.has_near(self.parameters):
            return self, Candidate(Role.FACTORY_SINGLE, self.parameters)
        return (self,)


def with_sets(
    factory: LaserParameters,
    sets: Mapping[str, LaserParameters],
    units: Collection[str] = (),
    *,
    near_points: bool = False,
) -> list[Candidate]:
    """The factory's calibration, then the parameter sets and calibrations.

    Parameters
    ----------
    factory : LaserParameters
    sets : mapping of str to LaserParameters
        By name.
    units : collection of str
        Names of those that are calibrations of a unit on all stations together.
    near_points : bool
        Whether the near-point corrections of the factory's file are applied.

    Returns
    -------
    list of Candidate
    """
    return [
        Candidate(Role.FACTORY, factory, "", near_points),
        *(
            Candidate(Role.UNIT if name in units else Role.SET, parameters, name)
            for name, parameters in sets.items()
        ),
    ]
