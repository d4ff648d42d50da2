"""The point formulas ("dialects") of the programs that read calibration files.

The same file gives different points in different programs. All of them are one formula with
settings; with theta = azimuth - alpha and L = distance + distance correction:

    R = L cos v + reach voff sin v
    X = R sin theta - hoff cos theta      Y = R cos theta + hoff sin theta
    Z = L sin v + voff                    or  + voff cos v, where the offset is orthogonal

Points are in the scanner frame of this project (Y forward, X right, Z up); programs that write
them as X forward, Y left mean the same points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from velocal.arrays import Array
from velocal.errors import ConfigError
from velocal.scanner.models import AZIMUTH_TICK_DEG, Family, Scanner
from velocal.scanner.parameters import FAR_POINT_M, NEAR_POINT, TWO_POINT, LaserParameters

#: Near points of the two-point correction along X and along Y, metres.
NEAR_X_M, NEAR_Y_M = 2.4, 1.93


class Interpolation(Enum):
    """How a program finds the azimuth of a laser from that of its firing."""

    NONE = "all lasers of a firing have its azimuth"
    ALL_LASERS = "each laser has the azimuth at which it fires"
    AS_HDL32 = "one laser after the other, each a fortieth of the cycle later, as an HDL-32E fires"

    def delays_s(self, scanner: Scanner) -> Array:
        """Time from the azimuth of the firing to the azimuth of each laser.

        Parameters
        ----------
        scanner : Scanner

        Returns
        -------
        ndarray, shape (n_lasers,)
            Seconds; zeros also where the firing times of the scanner are not known.
        """
        if self is Interpolation.ALL_LASERS and scanner.firing_time_s is not None:
            return scanner.firing_time_s
        if self is Interpolation.AS_HDL32:
            return np.asarray(np.arange(float(scanner.n_lasers)) * scanner.firing_cycle_s / 40.0)
        return np.zeros(scanner.n_lasers)


@dataclass(frozen=True)
class TwoPoint:
    """Distance correction interpolated between a far and a near point, for X and Y separately.

    Attributes
    ----------
    where : {"given", "flag", "nonzero"}
        Which lasers: all whose near-point corrections are given (zeros count unless a flag says
        otherwise), those with the flag of ROS YAML, or those whose corrections are both not zero.
    limit_m : float
        Raw distance up to which it acts. Between two ticks of 2 mm, so that it does not matter
        whether the limit itself is included.
    with_offsets : bool
        Whether the offsets enter the X and Y at which is interpolated.
    z : {"y", "mean"}
        Whether Z gets the correction of Y, or the mean of both.
    """

    where: Literal["given", "flag", "nonzero"]
    limit_m: float
    with_offsets: bool
    z: Literal["y", "mean"] = "y"


@dataclass(frozen=True)
class Dialect:
    """Point formula of one program.

    Attributes
    ----------
    name, source : str
        What it is called here, and the file or manual that it was read from.
    reach : {-1, 0, 1}
        Share of ``voff sin v`` in the horizontal distance.
    orthogonal : bool
        Whether the vertical offset is orthogonal to the beam, ``voff cos v``, or vertical.
    two_point : TwoPoint or None
        None where near-point corrections are not read.
    alpha : bool
        Whether the rotational correction is applied.
    interpolation : mapping of Family to Interpolation
        How azimuths within a firing are found, by family of scanners; `Interpolation.NONE` for
        families that are left out.
    rounds : bool
        Whether interpolated azimuths are rounded to 0.01 degrees.
    angles_only : tuple of Family
        Families of which the program reads the angles, and no distance correction or offset.
    frame : {"velocal", "ros"}
        Axes in which the program writes points: Y forward and X right, or X forward and Y left.
    """

    name: str
    source: str
    reach: int = 0
    orthogonal: bool = False
    two_point: TwoPoint | None = None
    alpha: bool = True
    interpolation: Mapping[Family, Interpolation] = field(default_factory=dict, hash=False)
    rounds: bool = True
    angles_only: tuple[Family, ...] = ()
    frame: Literal["velocal", "ros"] = "velocal"

    def effective(self, parameters: LaserParameters, scanner: Scanner) -> LaserParameters:
        """Numbers that take effect for a scanner.

        Parameters
        ----------
        parameters : LaserParameters
            Numbers of this dialect.
        scanner : Scanner

        Returns
        -------
        LaserParameters
            Zeros for what the program ignores.
        """
        if scanner.family not in self.angles_only:
            return parameters
        zero = np.zeros(len(parameters))
        return replace(parameters, dl=zero, voff=zero, hoff=zero, carried={})

    def near(self, parameters: LaserParameters) -> tuple[Array, Array]:
        """Near-point corrections that take effect; `dl` for lasers for which none do.

        Parameters
        ----------
        parameters : LaserParameters
            Numbers of this dialect.

        Returns
        -------
        x, y : ndarray, shape (n,)
            Corrections along X and along Y, by laser, metres.
        """
        x, y = (parameters.carried.get(name) for name in NEAR_POINT)
        if self.two_point is None or x is None or y is None:
            return parameters.dl, parameters.dl
        flag = parameters.carried.get(TWO_POINT)
        nonzero = (x != 0) & (y != 0)  # without flags, ROS files are made by this rule
        match self.two_point.where, flag:
            case "given", None:
                acts = np.ones_like(nonzero)
            case "given", _:
                acts = nonzero | (flag != 0)
            case "flag", flags if flags is not None:
                acts = flags != 0
            case _:
                acts = nonzero
        return np.where(acts, x, parameters.dl), np.where(acts, y, parameters.dl)

    def has_near(self, parameters: LaserParameters) -> bool:
        """Whether near-point corrections of any laser take effect."""
        return any(bool((each != parameters.dl).any()) for each in self.near(parameters))

    def policy(self, scanner: Scanner) -> Interpolation:
        """Look up how the program finds the azimuths of a scanner's lasers.

        Parameters
        ----------
        scanner : Scanner

        Returns
        -------
        Interpolation
        """
        return self.interpolation.get(scanner.family, Interpolation.NONE)

    def delays_s(self, scanner: Scanner) -> Array:
        """Time after the start of the firing at which azimuths are taken.

        Parameters
        ----------
        scanner : Scanner

        Returns
        -------
        ndarray, shape (n_lasers,)
            Seconds.
        """
        return self.policy(scanner).delays_s(scanner)

    def azimuths(
        self, raw: Array, laser_id: NDArray[np.integer], scanner: Scanner, rate_hz: float
    ) -> Array:
        """Azimuths at which points are computed.

        Parameters
        ----------
        raw : ndarray, shape (n,)
            Azimuths of the firings, radians.
        laser_id : ndarray of int, shape (n,)
        scanner : Scanner
        rate_hz : float
            Rotation rate.

        Returns
        -------
        ndarray, shape (n,)
            Radians.
        """
        fired = raw + 2.0 * np.pi * rate_hz * self.delays_s(scanner)[laser_id]
        if not self.rounds:
            return np.asarray(fired)
        tick = np.deg2rad(AZIMUTH_TICK_DEG)
        return np.asarray(np.round(fired / tick) * tick)

    def points(
        self,
        distance_m: Array,
        azimuth: Array,
        laser_id: NDArray[np.integer],
        parameters: LaserParameters,
    ) -> Array:
        """Compute points as the program does.

        Parameters
        ----------
        distance_m : ndarray, shape (n,)
            Raw distance, before any correction.
        azimuth : ndarray, shape (n,)
            Radians; of the firing, or what `azimuths` gives.
        laser_id : ndarray of int, shape (n,)
        parameters : LaserParameters
            Numbers of this dialect.

        Returns
        -------
        ndarray, shape (n, 3)
            Scanner frame of this project, metres.
        """
        voff, hoff = parameters.voff[laser_id], parameters.hoff[laser_id]
        theta = azimuth - parameters.alpha[laser_id] if self.alpha else azimuth
        sine, cosine = np.sin(theta), np.cos(theta)
        # Every laser has one vertical angle: its cosine and sine are needed once.
        flat, steep = np.cos(parameters.v)[laser_id], np.sin(parameters.v)[laser_id]
        shift = self.reach * voff * steep
        dl = parameters.dl[laser_id]
        along_x = along_y = along_z = dl
        if self.two_point is not None:
            near_x, near_y = (near[laser_id] for near in self.near(parameters))
            reach = (distance_m + dl) * flat
            x, y = reach * sine, reach * cosine
            if self.two_point.with_offsets:
                x += shift * sine - hoff * cosine
                y += shift * cosine + hoff * sine
            near = distance_m <= self.two_point.limit_m
            along_x = np.where(near, _between(np.abs(x), NEAR_X_M, near_x, dl), dl)
            along_y = np.where(near, _between(np.abs(y), NEAR_Y_M, near_y, dl), dl)
            along_z = along_y if self.two_point.z == "y" else (along_x + along_y) / 2.0
        x = ((distance_m + along_x) * flat + shift) * sine - hoff * cosine
        y = ((distance_m + along_y) * flat + shift) * cosine + hoff * sine
        z = (distance_m + along_z) * steep + voff * (flat if self.orthogonal else 1.0)
        return np.stack([x, y, z], axis=-1)


def near_effect(
    distance_m: Array, phi: Array, laser_id: NDArray[np.integer], parameters: LaserParameters
) -> Array:
    """What the near-point corrections of a file add to distances, metres, shape (n,).

    They are applied as the manual of the HDL-64E says, up to the far point.

    Parameters
    ----------
    distance_m, phi : ndarray, shape (n,)
        Raw distance, metres, and rotational angle, radians.
    laser_id : ndarray of int, shape (n,)
    parameters : LaserParameters
        Zeros where they hold no near-point corrections.
    """
    if NEAR_POINT[0] not in parameters.carried:
        return np.zeros(len(distance_m))
    moved = MANUAL.points(distance_m, phi, laser_id, parameters)
    moved -= PAPER.points(distance_m, phi, laser_id, parameters)
    theta = phi - parameters.alpha[laser_id]
    flat, steep = np.cos(parameters.v)[laser_id], np.sin(parameters.v)[laser_id]
    beam = np.stack([flat * np.sin(theta), flat * np.cos(theta), steep])
    return np.asarray(np.einsum("in,ni->n", beam, moved))


def _between(at: Array, near_m: float, near: Array, far: Array) -> Array:
    return np.asarray(near + (far - near) * (at - near_m) / (FAR_POINT_M - near_m))


_ALL = dict.fromkeys(Family, Interpolation.ALL_LASERS)
_AS_MANUFACTURER = {family: policy for family, policy in _ALL.items() if family.interpolated}
_SAMPLE_CODE = TwoPoint("given", np.inf, with_offsets=True)

#: Every dialect by name.
DIALECTS: dict[str, Dialect] = {
    dialect.name: dialect
    for dialect in (
        Dialect(
            "paper",
            "equations (1)-(3): one distance correction; the model of this project",
            interpolation=_AS_MANUFACTURER,
            rounds=False,
        ),
        Dialect(
            "manual",
            "HDL-64E S3 user's manual, appendix F, sample code (two-point up to 25 m)",
            two_point=TwoPoint("given", 25.001, with_offsets=False),
            interpolation=_AS_MANUFACTURER,
            rounds=False,
        ),
        Dialect(
            "manual_s2",
            "HDL-64E S2 user's manual, appendix F, sample code (two-point at all ranges)",
            two_point=_SAMPLE_CODE,
            interpolation=_AS_MANUFACTURER,
            rounds=False,
        ),
        Dialect(
            "ros",
            "ros-drivers/velodyne, velodyne_pointcloud/src/lib/rawdata.cc",
            reach=-1,
            orthogonal=True,
            two_point=replace(_SAMPLE_CODE, where="flag"),
            interpolation=dict.fromkeys((Family.VLP16, Family.VLS128), Interpolation.ALL_LASERS),
            angles_only=(Family.VLS128,),  # RawData::unpack_vls128
            frame="ros",
        ),
        Dialect(
            "libvelodyne",
            "jmaye/libvelodyne, src/lib/sensor/Converter.cpp",
            reach=-1,
            orthogonal=True,
        ),
        Dialect(
            "veloview",
            "Kitware VeloView, vtkVelodyneLegacyPacketInterpreter.cxx "
            "and VelodynePacketInterpreterCommon.cxx",
            reach=-1,
            interpolation=_ALL,
        ),
        Dialect("pcl", "PointCloudLibrary/pcl, io/src/hdl_grabber.cpp"),
        Dialect(
            "mrpt",
            "MRPT/mrpt, libs/obs/src/CObservationVelodyneScan.cpp",
            reach=1,
            alpha=False,
            # It knows scanners of 16, 32 and 64 lasers by that number alone.
            interpolation={
                Family.HDL32: Interpolation.ALL_LASERS,
                Family.VLP16: Interpolation.ALL_LASERS,
                Family.VLP32: Interpolation.AS_HDL32,
            },
            frame="ros",
        ),
        Dialect(
            "velodyne_decoder",
            "valgur/velodyne_decoder, src/packet_decoder.cpp",
            two_point=TwoPoint("nonzero", 25.039, with_offsets=False, z="mean"),
            interpolation=_ALL,
            frame="ros",
        ),
    )
}
PAPER, MANUAL = DIALECTS["paper"], DIALECTS["manual"]


def dialect_named(name: str, *, where: str | None = None) -> Dialect:
    """Look up a dialect.

    Parameters
    ----------
    name : str
    where : str, optional
        Where the name stands, for the error.

    Returns
    -------
    Dialect

    Raises
    ------
    ConfigError
        If no dialect has that name.
    """
    try:
        return DIALECTS[name]
    except KeyError:
        raise ConfigError(
            f"unknown dialect {name!r}",
            where=where,
            allowed=", ".join(DIALECTS),
            hint="Name the program that reads the file; docs/dialects.md describes them.",
        ) from None
