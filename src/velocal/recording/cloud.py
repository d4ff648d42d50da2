"""Returns out of a cloud of points: raw ticks, as they would have been decoded from packets.

The program that made the points is known, and so are the numbers that it used: its formula is
inverted, and distances and azimuths are whole ticks again. Ticks are coarser than the rounding of
most files, so that they are those of the packets.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array, joined_rows
from velocal.calibration import rings
from velocal.calibration.applied import AppliedCalibration
from velocal.calibration.dialects import PAPER
from velocal.calibration.files.document import CalibrationFile
from velocal.capture.ledger import Ledger
from velocal.clouds.block import PointBlock
from velocal.clouds.reading import open_cloud
from velocal.errors import RecordingError
from velocal.recording.cloud_made import (
    USUAL_RATE_HZ,
    Made,
    check_lasers,
    how_made,
    scanner_of_cloud,
    with_lasers,
)
from velocal.recording.gathering import whole_firings
from velocal.recording.returns import Returns
from velocal.scanner.models import AZIMUTH_TICK_DEG, AZIMUTH_TICKS, Scanner
from velocal.scanner.parameters import LaserParameters, nominal

#: A point belongs to its laser if it lies this near to the cone of the laser: rounding of files,
#: and a share of the range (0.03 deg) for numbers that are written with few digits.
_NEAR_M, _NEAR_RAD = 0.005, 0.0005
_TICK_RAD = np.deg2rad(AZIMUTH_TICK_DEG)
_HOUR_US = 3_600_000_000


@dataclass(frozen=True)
class CloudReturns:
    """What a cloud of points holds, as returns; see `read_cloud`.

    Attributes
    ----------
    returns : Returns
        Raw ticks; a scan of a bag or of a folder counts as one rotation.
    kind : str
        Format of the file.
    bytes : int
        Of the file, or of all files of a folder.
    dialect, frame : str
        Program that made the points, and axes of the file.
    points : int
        Points of the file.
    left_out : mapping of str to int
        Points that are not used, by reason.
    lasers : str
        How the file says which laser a point is of.
    rate : str
        Where the rotation rate comes from.
    residual_m : float
        Median distance of the points that are used from the cones of their lasers.
    lost : mapping of str to int
        Messages and stretches of a bag that cannot be used, by reason.
    """

    returns: Returns
    kind: str
    bytes: int
    dialect: str
    frame: str
    points: int
    left_out: Mapping[str, int]
    lasers: str
    rate: str
    residual_m: float
    lost: Mapping[str, int]

    @property
    def used(self) -> int:
        """Points that are used."""
        return self.points - sum(self.left_out.values())

    @property
    def rotations(self) -> int:
        """Scans with points that are used."""
        return len(np.unique(self.returns.rotation))

    @property
    def facts(self) -> dict[str, str]:
        """What is told of the cloud, by heading."""
        told = {
            "cloud": f"{self.kind}, points of {self.dialect}, axes of {self.frame}",
            "points": f"{self.used} of {self.points} used, of {self.rotations} scans",
            "lasers": self.lasers,
            "rotation rate": self.rate,
            "from the cones": f"{1e3 * self.residual_m:.2f} mm (median distance of a point from "
            "the cone of its laser)",
        }
        return told | ({"left out": "; ".join(self.remarks)} if self.remarks else {})

    @property
    def remarks(self) -> list[str]:
        """What was not used, and why."""
        found = [f"{number} points {reason}" for reason, number in self.left_out.items()]
        return found + [f"{number} times: {reason}" for reason, number in self.lost.items()]

    def as_dict(self) -> dict[str, Any]:
        """Facts for JSON, in the words of `Inspection.as_dict`; every byte is one of the points."""
        framing = f"{self.kind}, points of {self.dialect}"
        ledger = Ledger(self.bytes, framing, framing_bytes=self.bytes)
        return {
            "ledger": ledger.as_dict(),
            "gaps": 0,
            "packets_missing": 0,
            "duration_s": float("nan"),
            "rotations_complete": self.rotations,
            "rotation_rate_hz": self.returns.rotation_rate_hz,
            "dialect": self.dialect,
            "frame": self.frame,
            "points": self.points,
            "points_used": self.used,
            "points_left_out": dict(self.left_out),
            "remarks": self.remarks,
        }


def read_cloud(
    path: str | Path,
    scanner: str | Scanner | None = None,
    calibration: CalibrationFile | LaserParameters | None = None,
    *,
    dialect: str | None = None,
    frame: str | None = None,
    topic: str | None = None,
    rotation_rate_hz: float | None = None,
) -> CloudReturns:
    """Read a cloud of points, and compute the raw values that its points were made of.

    Parameters
    ----------
    path : str or Path
        PCD, PLY, LAS, LAZ, Parquet of `velocal points`, `.bin` of KITTI, `.pcd.bin` of nuScenes, a
        ROS bag with PointCloud2, or a folder with a scan in every file.
    scanner : str or Scanner, optional
        The scanner that measured the points. May be left out for files of `velocal points`.
    calibration : CalibrationFile or LaserParameters, optional
        Numbers that the program used; the nominal ones of the scanner if left out.
    dialect : str, optional
        The program, as `DIALECTS` names it. May be left out for files of `velocal points`.
    frame : {"velocal", "ros"}, optional
        Axes of the file: Y forward and X right, or X forward and Y left. If left out, those that
        the file states, else those of its format, else those of the program.
    topic : str, optional
        Topic of the clouds in a bag, where it has several.
    rotation_rate_hz : float, optional
        Rotation rate. If left out, what the file states, else that of the times of points or
        messages, else 10 Hz; it matters only for programs that interpolate azimuths within a firing
        in another way than the manufacturer.

    Returns
    -------
    CloudReturns
        Returns, and what was left out.

    Raises
    ------
    RecordingError
        If the file cannot be read, or most of its points cannot come from this scanner, program and
        calibration.
    ConfigError
        If the scanner or the program is not stated, or contradicts what the file says.

    Examples
    --------
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> found = velocal.read_cloud("points.pcd", "HDL-32E", factory, dialect="paper")
    >>> found.kind, found.used == found.points
    ('PCD', True)
    >>> medians = found.returns.medians(min_count=3)
    """
    file = open_cloud(Path(path), topic)
    known = scanner_of_cloud(file, scanner)
    numbers = nominal(known) if calibration is None else calibration
    made, rate = how_made(file, known, numbers, dialect, frame, rotation_rate_hz)
    parts: list[Returns] = []
    left_out: Counter[str] = Counter()
    residuals: list[Array] = []
    points = 0
    for block in file.blocks():
        points += len(block)
        finite = np.asarray(np.isfinite(block.xyz).all(axis=1), dtype=np.bool_)
        block = _kept(block, finite, "have no finite coordinates", left_out)
        far: NDArray[Any] = np.linalg.norm(block.xyz, axis=1) > max(known.min_range_m, 1e-6)
        block = _kept(block, far, "are nearer than the scanner measures", left_out)
        if not len(block):
            continue
        if not made.lasers:
            made = with_lasers(made, block, str(path))
        part, residual = _returns(made, block, left_out, str(path))
        parts.append(part)
        residuals.append(residual)
    used = sum(map(len, residuals))
    no_laser = left_out[_OFF_CONE] + left_out[_NO_TICK]
    if not parts or used < no_laser or not used:
        raise _no_such_points(made, points, used, str(path))
    return CloudReturns(
        joined_rows(parts),
        file.kind,
        file.bytes,
        made.applied.dialect.name,
        made.frame,
        points,
        {reason: number for reason, number in left_out.items() if number},
        made.lasers,
        rate,
        float(np.median(np.concatenate(residuals))),
        dict(file.lost),
    )


def parameters_of_cloud(
    path: str | Path, scanner: Scanner, *, frame: str | None = None, topic: str | None = None
) -> LaserParameters:
    """Vertical angles and offsets with which the points of a cloud were computed, by laser.

    For clouds whose calibration file is not public, as that of KITTI. The lasers are those that the
    file numbers, else its turns from the lowest up, else the nominal lasers that are nearest.

    Parameters
    ----------
    path : str or Path
        As of `read_cloud`.
    scanner : Scanner
        Its nominal vertical angles tell which ring is which laser.
    frame, topic
        As of `read_cloud`.

    Returns
    -------
    LaserParameters
        Of equations (1) to (3): with them, `read_cloud` takes the cloud as one of `paper`.

    Raises
    ------
    RecordingError
        If the cloud cannot be read, or has more lasers than the scanner.
    """
    file = open_cloud(Path(path), topic)
    design = nominal(scanner)
    axes = frame or (file.origin.frame if file.origin else file.frame) or "ros"
    made = Made(AppliedCalibration(PAPER, design, scanner, USUAL_RATE_HZ), axes, False)
    xyz: list[Array] = []
    lasers: list[NDArray[np.int64]] = []
    for block in file.blocks():
        kept = np.isfinite(block.xyz).all(axis=1) & block.xyz.any(axis=1)
        points = made.turned(block.xyz[kept])
        laser: NDArray[np.int64] | None
        if block.laser is not None:
            check_lasers(made, block, str(path))
            laser = rings.lasers_of_numbers(block.laser[kept], points, design)
        else:
            laser = rings.lasers_of_rings(rings.rings_by_turns(points), points, design)
            if laser is None:
                laser = rings.nearest_lasers(points, design)
        xyz.append(points)
        lasers.append(laser)
    if not xyz:
        raise RecordingError("holds no points", where=str(path))
    return rings.geometry_of(np.concatenate(xyz), np.concatenate(lasers), design)


_OFF_CONE = "lie on the cone of no laser"
_NO_TICK = "have a distance that the scanner cannot measure"


def _kept(
    block: PointBlock, kept: NDArray[np.bool_], reason: str, left_out: Counter[str]
) -> PointBlock:
    """Rows of a block; the others are counted."""
    left_out[reason] += int(np.count_nonzero(~kept))
    return block if kept.all() else block[kept]


def _returns(
    made: Made, block: PointBlock, left_out: Counter[str], where: str
) -> tuple[Returns, Array]:
    """Returns of a block, and how far its points are from the cones of their lasers."""
    scanner, xyz = made.applied.scanner, made.turned(block.xyz)
    if block.laser is None or made.laser_of is None:
        by_turn = rings.lasers_of_rings(rings.rings_by_turns(xyz), xyz, made.applied.parameters)
        laser = rings.nearest_lasers(xyz, made.applied.model) if by_turn is None else by_turn
    else:
        check_lasers(made, block, where)
        laser = made.laser_of[block.laser]
    raw = made.applied.raw(xyz, laser, rounded=made.rounded)
    range_m = np.sqrt((xyz**2).sum(axis=1))
    on_cone = raw.residual_m <= _NEAR_M + _NEAR_RAD * range_m
    ticks = np.rint(np.where(on_cone, raw.distance_m, 0.0) / scanner.distance_tick_m)
    possible = (ticks >= 1) & (ticks <= np.iinfo(np.uint16).max)
    left_out[_OFF_CONE] += int(np.count_nonzero(~on_cone))
    left_out[_NO_TICK] += int(np.count_nonzero(on_cone & ~possible))
    kept = on_cone & possible
    azimuth = np.rint(raw.azimuth[kept] / _TICK_RAD).astype(np.int64) % AZIMUTH_TICKS
    time = np.zeros(len(block)) if block.time_s is None else np.nan_to_num(block.time_s)
    columns = {
        "rotation": block.rotation[kept],
        "timestamp": np.mod(np.rint(time[kept] * 1e6), _HOUR_US).astype(np.int64),
        "azimuth": azimuth,
        "laser_id": laser[kept],
        "distance": ticks[kept].astype(np.int64),
        "intensity": block.intensity[kept].astype(np.int64),
    }
    return whole_firings(columns, scanner, made.applied.rate_hz), raw.residual_m[kept]


def _no_such_points(made: Made, points: int, used: int, where: str) -> RecordingError:
    """Error for a cloud whose points cannot have been made as it is said."""
    applied = made.applied
    return RecordingError(
        f"{used} of {points} points lie on the cones of the lasers of an {applied.scanner.name} as "
        f"{applied.dialect.name} computes them with this calibration and the axes of {made.frame}",
        where=where,
        allowed="more than half of them",
        hint="Give the program, the calibration and the axes with which the points were made. "
        "Points that were moved into another frame, or corrected for motion, cannot be used.",
    )
