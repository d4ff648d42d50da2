"""Survey files: coordinates of targets with their standard deviations, as CSV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from velocal.arrays import Array
from velocal.errors import StorageError, SurveyError
from velocal.geometry.covariance import covariance_fault
from velocal.geometry.planes import fit_plane
from velocal.io import storage
from velocal.survey.tables import check_unique, read_table

COORDINATES = ("x_m", "y_m", "z_m")
DEVIATIONS = ("std_x_mm", "std_y_mm", "std_z_mm")
#: Size from which coordinates of a site are reduced, and unit of what is subtracted, metres.
LARGE_M, REDUCTION_M = 1e4, 1e2


@dataclass(frozen=True)
class Targets:
    """Named points with coordinates and standard deviations.

    Attributes
    ----------
    name : tuple of str
        Target names, unique.
    group : tuple of str
        What each target belongs to: a plane, a position or a scanner.
    xyz : ndarray, shape (n, 3)
        Metres.
    std : ndarray, shape (n, 3)
        Metres.
    joint : ndarray, shape (3n, 3n), or None
        Covariance of all coordinates, square metres, where it is known; None if the coordinates
        are independent.
    """

    name: tuple[str, ...]
    group: tuple[str, ...]
    xyz: Array
    std: Array
    joint: Array | None = None

    def of(self, group: str, *, where: str) -> Targets:
        """Targets of one group.

        Parameters
        ----------
        group : str
            Name of the plane, position or scanner.
        where : str
            Survey file, for errors.

        Raises
        ------
        SurveyError
            If no target belongs to the group.
        """
        rows = [row for row, value in enumerate(self.group) if value == group]
        if not rows:
            raise SurveyError(
                f"has no targets of {group!r}",
                where=where,
                allowed=", ".join(sorted(set(self.group))),
            )
        return self.take(rows)

    def take(self, rows: Sequence[int]) -> Targets:
        """Targets of the given rows, in that order, with their part of the covariance."""
        joint = self.joint
        if joint is not None:
            of_rows = (3 * np.asarray(rows)[:, None] + np.arange(3)).ravel()
            joint = joint[np.ix_(of_rows, of_rows)]
        return Targets(
            tuple(self.name[row] for row in rows),
            tuple(self.group[row] for row in rows),
            self.xyz[list(rows)],
            self.std[list(rows)],
            joint,
        )

    def reduction(self) -> Array:
        """Coordinates to subtract where those of a site are large, shape (3,), metres.

        National and UTM coordinates have millions of metres. The rotation of a pose about so far an
        origin would be inseparable from its translation in double precision. The mean, rounded to
        `REDUCTION_M`, is subtracted; zero where all coordinates are below `LARGE_M`.
        """
        if np.abs(self.xyz).max(initial=0.0) < LARGE_M:
            return np.zeros(3)
        return np.asarray(np.round(self.xyz.mean(axis=0) / REDUCTION_M) * REDUCTION_M)

    def reduced(self, origin: Array) -> Targets:
        """The same targets with reduced coordinates.

        Parameters
        ----------
        origin : ndarray, shape (3,)
            Is subtracted from all coordinates, metres.
        """
        return replace(self, xyz=self.xyz - origin) if origin.any() else self

    def covariance(self) -> Array:
        """Covariance of all coordinates, shape (3n, 3n), square metres."""
        return np.diag(self.std.ravel() ** 2) if self.joint is None else self.joint

    def blocks(self) -> Array:
        """Covariance of every point, shape (n, 3, 3), square metres."""
        n = np.arange(len(self.name))
        return self.covariance().reshape(len(n), 3, len(n), 3)[n, :, n]

    def isotropic_std(self) -> Array:
        """Root of the mean variance of the three coordinates, shape (n,), metres."""
        return np.asarray(np.sqrt(np.mean(self.std**2, axis=1)))

    def plane_covariances(self) -> dict[str, Array]:
        """Covariance (4, 4) of normal and offset of every plane, in the frame of the targets.

        It contains the errors that the targets have in common: errors of the control points and of
        the cameras shift and turn a plane, and do not average out over its targets. A plane that
        its targets do not determine is left out; `Station.adjust` raises the error if it is used.
        """
        found = {}
        for name in dict.fromkeys(self.group):
            part = self.of(name, where=name)
            with suppress(SurveyError):
                fit = fit_plane(part.xyz, part.isotropic_std(), part.covariance())
                found[name] = fit.plane.covariance
        return found


@dataclass(frozen=True)
class SurveyCovariances:
    """Covariances that the adjustment of a survey hands over beside the coordinates.

    Attributes
    ----------
    bases : dict of str to tuple
        By position: the names of the targets of the scanner's base, and the covariance of all
        their coordinates in the site frame, shape (3n, 3n), square metres.
    planes : dict of str to ndarray, shape (4, 4)
        By plane: covariance of normal and offset in the site frame.
    """

    bases: dict[str, tuple[tuple[str, ...], Array]]
    planes: dict[str, Array]

    def of_base(self, targets: Targets, position: str, *, where: str) -> Targets:
        """Targets of a base with the covariance of all their coordinates.

        Parameters
        ----------
        targets : Targets
            Coordinates of the base at the position.
        position : str
        where : str
            File of the covariances, for errors.

        Raises
        ------
        SurveyError
            If the covariance belongs to other targets, or the position has none.
        """
        names, covariance = self.bases.get(position, ((), None))
        if names != targets.name:
            raise SurveyError(
                f"holds the covariance of other targets than the survey file at {position!r}",
                where=where,
                hint="Adjust the network again.",
            )
        return replace(targets, joint=covariance)

    def to_json(self) -> dict[str, Any]:
        """Content of the file ``survey/covariance.json``."""
        bases = {
            position: {"targets": names, "covariance_m2": covariance}
            for position, (names, covariance) in self.bases.items()
        }
        return {"base_field": bases, "planes": self.planes}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> SurveyCovariances:
        """Covariances out of the content that `to_json` gave."""
        bases = {
            position: (tuple(base["targets"]), np.array(base["covariance_m2"]))
            for position, base in content["base_field"].items()
        }
        planes = {name: np.array(covariance) for name, covariance in content["planes"].items()}
        return cls(bases, planes)


def read_covariances(path: str | Path) -> SurveyCovariances:
    """Read the file ``survey/covariance.json``.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    SurveyCovariances

    Raises
    ------
    StorageError
        If the file is missing or damaged.
    SurveyError
        If a matrix in it is no covariance.
    """
    content = storage.read_json(Path(path))
    try:
        found = SurveyCovariances.from_json(content)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StorageError(
            f"does not hold the covariances of a survey: {error}",
            where=str(path),
            hint="Delete the file, and run the rule adjust_network again.",
        ) from None
    matrices = {
        f"position {name!r}": (matrix, 3 * len(targets))
        for name, (targets, matrix) in found.bases.items()
    } | {f"plane {name!r}": (matrix, 4) for name, matrix in found.planes.items()}
    for what, (matrix, size) in matrices.items():
        check_covariance(matrix, size, f"{path}, {what}")
    return found


def check_covariance(matrix: Array, size: int, where: str) -> None:
    """Check that a matrix can be a covariance, see `covariance_fault`.

    Parameters
    ----------
    matrix : ndarray, shape (size, size)
    size : int
    where : str
        File and part of it, for errors.

    Raises
    ------
    SurveyError
    """
    if fault := covariance_fault(matrix, size):
        raise SurveyError(
            f"the covariance is impossible: {fault}",
            where=where,
            allowed=f"a symmetric, positive semidefinite matrix of {size} rows",
            hint="Delete the file, and adjust the survey again.",
        )


def read_targets(path: str | Path, group: str, *, repeated: bool = False) -> Targets:
    """Read a survey file.

    Parameters
    ----------
    path : str or Path
        CSV with the columns ``target``, `group`, ``x_m y_m z_m`` and
        ``std_x_mm std_y_mm std_z_mm``.
    group : str
        Name of the grouping column: ``plane``, ``position`` or ``scanner``.
    repeated : bool
        Whether a target may have several rows, one per measurement.

    Returns
    -------
    Targets
        Coordinates in metres, with their standard deviations.

    Raises
    ------
    SurveyError
        If the file is missing, a column is missing or unknown, a value is no number, a standard
        deviation is not positive, or a target is named twice in a group.

    Examples
    --------
    >>> targets = velocal.read_targets("planes.csv", "plane")
    >>> sorted(set(targets.group))
    ['floor', 'long_wall', 'short_wall']
    """
    path = Path(path)
    positive = dict(zip(COORDINATES, DEVIATIONS, strict=True))
    table = read_table(path, ("target", group), (*COORDINATES, *DEVIATIONS), positive)
    if not repeated:
        check_unique(table, ("target", group), "target", str(path))
    return Targets(
        table.text("target"),
        table.text(group),
        table.numbers(COORDINATES),
        table.numbers(DEVIATIONS) * 1e-3,
    )


def write_targets(path: Path, group: str, parts: Sequence[Targets]) -> None:
    """Write a survey file; see `target_table`."""
    storage.write_csv(path, target_table(group, parts))


def target_table(group: str, parts: Sequence[Targets]) -> dict[str, Any]:
    """Table of a survey file, with coordinates rounded to a hundredth of a millimetre.

    Parameters
    ----------
    group : str
        Name of the grouping column; see `read_targets`.
    parts : sequence of Targets
        They follow one another in the table.

    Returns
    -------
    dict of str to list or ndarray
        Columns by name.
    """
    xyz = np.round(np.concatenate([part.xyz for part in parts]), 5)
    std_mm = np.round(np.concatenate([part.std for part in parts]) * 1e3, 3)
    return {
        "target": [name for part in parts for name in part.name],
        group: [name for part in parts for name in part.group],
        **dict(zip(COORDINATES, xyz.T, strict=True)),
        **dict(zip(DEVIATIONS, std_mm.T, strict=True)),
    }


def shifted_plane(origin: Array) -> Array:
    """Matrix that takes normal and offset of a plane to reduced coordinates, shape (4, 4).

    Parameters
    ----------
    origin : ndarray, shape (3,)
        Is subtracted from the coordinates, metres.
    """
    matrix = np.eye(4)
    matrix[3, :3] = origin
    return matrix


def common(first: Targets, second: Targets, *, where: str) -> tuple[Targets, Targets]:
    """Targets that occur in both frames, in the same order.

    Parameters
    ----------
    first, second : Targets
        The same points in two frames, in any order.
    where : str
        Survey file, for errors.

    Raises
    ------
    SurveyError
        If fewer than three names occur in both.
    """
    names = [name for name in first.name if name in second.name]
    if len(names) < 3:
        raise SurveyError(
            f"{len(names)} targets in common",
            where=where,
            allowed="3 or more",
            hint="Both files must contain the same names.",
        )

    def pick(targets: Targets) -> Targets:
        return targets.take([targets.name.index(name) for name in names])

    return pick(first), pick(second)
