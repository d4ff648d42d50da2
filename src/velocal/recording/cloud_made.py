"""How the points of a cloud were made: scanner, program, axes, rotation rate, numbers of lasers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.calibration import rings
from velocal.calibration.applied import AppliedCalibration
from velocal.calibration.dialects import DIALECTS, dialect_named
from velocal.calibration.files.document import CalibrationFile
from velocal.clouds.block import PointBlock
from velocal.clouds.origin import digest
from velocal.clouds.reading import CloudFile
from velocal.errors import ConfigError, RecordingError
from velocal.scanner.models import Scanner, scanner_named
from velocal.scanner.parameters import LaserParameters

#: Rates of real scanners; what is outside was not measured.
_RATES_HZ = (1.0, 60.0)
USUAL_RATE_HZ = 10.0
#: Points that decide how a file numbers its lasers, and that a rate is derived from.
_SOME = 20_000
FRAMES = ("velocal", "ros")


@dataclass(frozen=True)
class Made:
    """How the points were made: what turns them into raw values.

    Attributes
    ----------
    applied : AppliedCalibration
    frame : str
    rounded : bool
        Whether the program has rounded azimuths that it interpolates.
    laser_of : ndarray of int64 or None
        Laser by the number of the file; None where the file has none.
    lasers : str
        The same, for people.
    """

    applied: AppliedCalibration
    frame: str
    rounded: bool
    laser_of: NDArray[np.int64] | None = None
    lasers: str = ""

    def turned(self, xyz: Array) -> Array:
        """Points in the scanner frame of this project."""
        if self.frame == "velocal":
            return xyz
        return np.stack([-xyz[:, 1], xyz[:, 0], xyz[:, 2]], axis=-1)


def scanner_of_cloud(file: CloudFile, stated: str | Scanner | None) -> Scanner:
    """Scanner that is stated, or that the file names.

    Parameters
    ----------
    file : CloudFile
    stated : str or Scanner or None

    Returns
    -------
    Scanner

    Raises
    ------
    ConfigError
        If nobody says which scanner it was, or the call and the file say different ones.
    """
    said = file.origin.scanner if file.origin else None
    if stated is None:
        if said is None:
            raise ConfigError(
                "does not say which scanner measured it",
                where=str(file.path),
                hint="Name the scanner.",
            )
        return scanner_named(said, where=str(file.path))
    known = scanner_named(stated, where="scanner") if isinstance(stated, str) else stated
    if said is not None and said != known.name:
        raise ConfigError(
            f"was made of a recording of {said}, not of {known.name}",
            where=str(file.path),
            allowed=said,
        )
    return known


def how_made(
    file: CloudFile,
    scanner: Scanner,
    numbers: CalibrationFile | LaserParameters,
    dialect: str | None,
    frame: str | None,
    rate_hz: float | None,
) -> tuple[Made, str]:
    """Tell how the points of a file were made.

    Parameters
    ----------
    file : CloudFile
    scanner : Scanner
    numbers : CalibrationFile or LaserParameters
    dialect, frame, rate_hz
        As stated; see `velocal.recording.cloud.read_cloud`.

    Returns
    -------
    made : Made
        Without the numbers of the lasers, which the points tell.
    rate : str
        Rotation rate, and where it comes from.

    Raises
    ------
    ConfigError
        If the program or the axes are unknown, or the file says something else.
    """
    where, origin = str(file.path), file.origin
    parameters = numbers if isinstance(numbers, LaserParameters) else numbers.parameters
    name = dialect or (origin.dialect if origin else None)
    if name is None:
        raise ConfigError(
            "does not say which program computed its points",
            where=where,
            allowed=", ".join(DIALECTS),
            hint="Name the program (`dialect`); docs/dialects.md describes them.",
        )
    program = dialect_named(name, where="dialect")
    if len(parameters) != scanner.n_lasers:
        raise ConfigError(
            f"the calibration has {len(parameters)} lasers, {scanner.name} has {scanner.n_lasers}",
            where=where,
        )
    if origin is not None:
        for what, stated, said in (
            ("dialect", name, origin.dialect),
            ("frame", frame or origin.frame, origin.frame),
            ("calibration", digest(parameters), origin.parameters),
        ):
            if stated != said:
                raise ConfigError(
                    f"its points were made with another {what}: {said}, not {stated}",
                    where=where,
                    hint="Give what `velocal points` was given when it wrote the file.",
                )
    axes = frame or (origin.frame if origin else file.frame) or program.frame
    if axes not in FRAMES:
        raise ConfigError(f"unknown frame {axes!r}", where="frame", allowed=", ".join(FRAMES))
    rate, source = _rate(file, axes, rate_hz)
    # `velocal points` leaves the rounding out.
    made = Made(AppliedCalibration(program, parameters, scanner, rate), axes, origin is None)
    return made, f"{rate:.3f} Hz ({source})"


def _rate(file: CloudFile, frame: str, stated: float | None) -> tuple[float, str]:
    """Rotation rate, and where it comes from."""
    if stated is not None:
        return stated, "as stated"
    if file.origin is not None:
        return file.origin.rotation_rate_hz, "as the file says"
    found = [_rate_of(block, frame) for block in file.blocks()]
    intervals = np.diff(file.stamps_s)
    file.stamps_s.clear()
    file.lost.clear()  # the blocks are read again
    measured = [rate for rate in found if _RATES_HZ[0] < rate < _RATES_HZ[1]]
    if measured:
        return float(np.median(measured)), "of the times of points"
    if len(intervals) and intervals.min() > 0:
        by_stamps = float(1.0 / np.median(intervals))
        if _RATES_HZ[0] < by_stamps < _RATES_HZ[1]:
            return by_stamps, "of the times of messages"
    return USUAL_RATE_HZ, "taken as usual, as the file has no times"


def _rate_of(block: PointBlock, frame: str) -> float:
    """Rotations per second by azimuth against time; NaN if it is not seen."""
    if block.time_s is None:
        return float("nan")
    chosen = np.isfinite(block.xyz).all(axis=1) & np.isfinite(block.time_s)
    if block.laser is not None and chosen.any():
        number = np.bincount(block.laser[chosen]).argmax()
        chosen &= block.laser == number
    rows = np.flatnonzero(chosen)[:_SOME]
    time = block.time_s[rows]
    order = np.argsort(time, kind="stable")
    time = time[order] - time.min(initial=np.inf) if len(time) else time
    if len(rows) < 10 or np.ptp(time) <= 0:
        return float("nan")
    x, y = block.xyz[rows[order], :2].T
    azimuth = np.unwrap(np.arctan2(x, y) if frame == "velocal" else np.arctan2(-y, x))
    return float(np.polyfit(time, azimuth, 1)[0] / (2.0 * np.pi))


def check_lasers(made: Made, block: PointBlock, where: str) -> None:
    """Check that the scanner has all lasers of a block; parameters and errors of `with_lasers`."""
    known = made.applied.scanner
    if block.laser is not None and block.laser.max() >= known.n_lasers:
        raise RecordingError(
            f"field {block.laser_field!r}: laser {block.laser.max()}",
            where=where,
            allowed=f"0 to {known.n_lasers - 1} of an {known.name}",
            hint="Is this the cloud of another scanner?",
        )


def with_lasers(made: Made, block: PointBlock, where: str) -> Made:
    """Find out how a file numbers its lasers: the way in which points lie on their cones.

    Parameters
    ----------
    made : Made
    block : PointBlock
        First points of the file.
    where : str
        For errors.

    Returns
    -------
    Made

    Raises
    ------
    RecordingError
        If the file has more lasers than the scanner.
    """
    applied = made.applied
    if block.laser is None:
        return replace(made, lasers="found by the order or the elevation of the points")
    check_lasers(made, block, where)
    rows = np.linspace(0, len(block) - 1, min(len(block), _SOME)).astype(np.int64)
    xyz, number = made.turned(block.xyz[rows]), block.laser[rows]
    found = {
        name: float(np.median(_off(applied, xyz, laser_of[number], made.rounded)))
        for name, laser_of in rings.orders(applied.parameters.v).items()
    }
    best = min(found, key=lambda name: found[name])
    return replace(
        made,
        laser_of=rings.orders(applied.parameters.v)[best],
        lasers=f"by the field {block.laser_field!r}, numbered {best}",
    )


def _off(applied: AppliedCalibration, xyz: Array, laser: NDArray[np.int64], rounded: bool) -> Array:
    """Distance of points from the cone of a laser; infinite where there is no raw value."""
    return np.nan_to_num(applied.raw(xyz, laser, rounded=rounded).residual_m, nan=np.inf)
