"""Survey files: coordinates of targets with their standard deviations, as CSV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from velocal.errors import SurveyError
from velocal.io import storage

Array = NDArray[np.float64]

COORDINATES = ("x_m", "y_m", "z_m")
DEVIATIONS = ("std_x_mm", "std_y_mm", "std_z_mm")


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

        Raises
        ------
        SurveyError
            If there are none.
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
        """Some of the targets, in that order."""
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

    def covariance(self) -> Array:
        """Covariance of all coordinates, shape (3n, 3n), square metres."""
        return np.diag(self.std.ravel() ** 2) if self.joint is None else self.joint

    def blocks(self) -> Array:
        """Covariance of every point, shape (n, 3, 3), square metres."""
        n = np.arange(len(self.name))
        return self.covariance().reshape(len(n), 3, len(n), 3)[n, :, n]


def read_targets(path: Path, group: str) -> Targets:
    """Read a survey file.

    Parameters
    ----------
    path : Path
        CSV with the columns ``target``, `group`, ``x_m y_m z_m`` and
        ``std_x_mm std_y_mm std_z_mm``.
    group : str
        Name of the grouping column: ``plane``, ``position`` or ``scanner``.

    Raises
    ------
    SurveyError
        If the file is missing, a column is missing or unknown, a value is no number, a standard
        deviation is not positive, or a target is named twice in a group.
    """
    where = str(path)
    columns = ["target", group, *COORDINATES, *DEVIATIONS]
    try:
        table = pd.read_csv(path, comment="#", dtype={"target": str, group: str})
    except (OSError, ValueError) as error:
        raise SurveyError(f"cannot be read: {error}", where=where) from None
    if set(table.columns) != set(columns):
        odd = sorted(set(table.columns) ^ set(columns))
        raise SurveyError(
            f"missing or unknown column {odd[0]!r}", where=where, allowed=", ".join(columns)
        )
    numbers = table[[*COORDINATES, *DEVIATIONS]].apply(pd.to_numeric, errors="coerce")
    bad = np.flatnonzero(~np.isfinite(numbers.to_numpy(dtype=float)).all(axis=1))
    if len(bad):
        raise SurveyError(
            "a coordinate is missing or no number", where=f"{where}, row {bad[0] + 2}"
        )
    if (numbers[list(DEVIATIONS)] <= 0).any().any():
        raise SurveyError(
            "a standard deviation is not positive",
            where=where,
            hint="State how good each coordinate is, in millimetres.",
        )
    twice = table.duplicated(["target", group])
    if twice.any():
        row = int(np.flatnonzero(twice)[0])
        raise SurveyError(
            f"target {table['target'][row]!r} occurs twice", where=f"{where}, row {row + 2}"
        )
    return Targets(
        tuple(table["target"]),
        tuple(table[group]),
        numbers[list(COORDINATES)].to_numpy(dtype=float),
        numbers[list(DEVIATIONS)].to_numpy(dtype=float) * 1e-3,
    )


def with_covariance(targets: Targets, content: Mapping[str, Any], *, where: str) -> Targets:
    """Targets of a position with the covariance of all their coordinates.

    Parameters
    ----------
    targets : Targets
    content : mapping
        ``targets`` and ``covariance_m2``, as the adjustment of the network writes them.
    where : str
        File, for errors.

    Raises
    ------
    SurveyError
        If it is of other targets.
    """
    if tuple(content["targets"]) != targets.name:
        raise SurveyError(
            "holds the covariance of other targets than the survey file",
            where=where,
            hint="Adjust the network again.",
        )
    return replace(targets, joint=np.array(content["covariance_m2"]))


def write_targets(path: Path, group: str, parts: Sequence[Targets]) -> None:
    """Write a survey file; coordinates to a hundredth of a millimetre."""
    frames = [
        pd.DataFrame(
            {
                "target": part.name,
                group: part.group,
                **{c: np.round(part.xyz[:, i], 5) for i, c in enumerate(COORDINATES)},
                **{c: np.round(part.std[:, i] * 1e3, 3) for i, c in enumerate(DEVIATIONS)},
            }
        )
        for part in parts
    ]
    storage.write_csv(path, pd.concat(frames, ignore_index=True))


def common(first: Targets, second: Targets, *, where: str) -> tuple[Targets, Targets]:
    """Targets that occur in both systems, in the same order.

    Raises
    ------
    SurveyError
        If there are fewer than three.
    """
    names = [name for name in first.name if name in second.name]
    if len(names) < 3:
        raise SurveyError(
            f"{len(names)} targets in common",
            where=where,
            allowed="3 or more",
            hint="The same names must stand in both files.",
        )

    def pick(targets: Targets) -> Targets:
        return targets.take([targets.name.index(name) for name in names])

    return pick(first), pick(second)
