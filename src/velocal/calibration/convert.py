"""Conversion of calibrations between dialects: exact, or refused with what it would cost."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from velocal.arrays import Array
from velocal.calibration.dialects import PAPER, Dialect, dialect_named
from velocal.errors import DialectError
from velocal.scanner.models import Scanner
from velocal.scanner.parameters import NEAR_POINT, TWO_POINT, LaserParameters

#: Ranges at which differences are stated unless others are asked for, metres.
RANGES_M = (3.0, 10.0, 25.0, 80.0)
#: Rotation rate at which differences are stated unless another is known.
RATE_HZ: Final = 10.0


def max_point_distance(
    first: tuple[Dialect, LaserParameters],
    second: tuple[Dialect, LaserParameters],
    ranges_m: tuple[float, ...] = RANGES_M,
    *,
    scanner: Scanner | None = None,
    rate_hz: float = RATE_HZ,
) -> Array:
    """Largest distance between the points of two calibrations, over all azimuths.

    Parameters
    ----------
    first, second : (Dialect, LaserParameters)
        A calibration and the program that reads it.
    ranges_m : tuple of float
        Ranges corrected by the first's dl; both get the same raw distance.
    scanner : Scanner, optional
        If given, azimuths are interpolated as each program does for it, at `rate_hz`, and numbers
        that a program ignores for it count as zero.
    rate_hz : float
        Rotation rate.

    Returns
    -------
    ndarray, shape (ranges, lasers)
        Metres.

    Raises
    ------
    DialectError
        If the numbers of lasers differ.

    Examples
    --------
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> programs = [velocal.DIALECTS[name] for name in ("veloview", "ros")]
    >>> apart_m = velocal.max_point_distance(*[(each, factory) for each in programs], (10.0,))
    >>> apart_m.shape
    (1, 32)
    """
    n_lasers = len(first[1])
    if len(second[1]) != n_lasers:
        raise DialectError(
            f"{n_lasers} and {len(second[1])} lasers cannot be compared",
            hint="These are calibrations of different scanners.",
        )
    step = np.deg2rad(np.arange(360.0))
    laser, azimuth = np.repeat(np.arange(n_lasers), len(step)), np.tile(step, n_lasers)
    result = []
    for range_m in ranges_m:
        raw = np.maximum(range_m - first[1].dl, 0.0)[laser]
        xyz = []
        for dialect, parameters in (first, second):
            phi, numbers = azimuth, parameters
            if scanner is not None:
                phi = dialect.azimuths(azimuth, laser, scanner, rate_hz)
                numbers = dialect.effective(parameters, scanner)
            xyz.append(dialect.points(raw, phi, laser, numbers))
        between = np.linalg.norm(xyz[0] - xyz[1], axis=1)
        result.append(between.reshape(n_lasers, -1).max(axis=1))
    return np.array(result)


def incompatibilities(
    parameters: LaserParameters,
    source: Dialect,
    target: Dialect,
    scanner: Scanner | None = None,
    rate_hz: float | None = None,
) -> list[str]:
    """What keeps a conversion from being exact.

    Some programs round interpolated azimuths to 0.01 deg (`Dialect.rounds`, up to 7 mm at 80 m).
    No conversion of the numbers can change that, so it is disregarded.

    Parameters
    ----------
    parameters : LaserParameters
        Numbers of the dialect `source`.
    source, target : Dialect
    scanner : Scanner, optional
        If given, the interpolation of its azimuths is compared as well.
    rate_hz : float, optional
        If given, the rotation rate at which a difference in interpolation can go into alpha.

    Returns
    -------
    list of str
        A clause for every reason; empty if the conversion is exact.
    """
    found = []
    if scanner is not None:
        parameters = source.effective(parameters, scanner)
    if source.has_near(parameters) and source.two_point != target.two_point:
        one, other = source.two_point, target.two_point
        if other is None:
            found.append(f"{target.name} does not read near-point corrections")
        elif one is not None and replace(one, where=other.where) != other:
            found.append(f"{target.name} interpolates near-point corrections in another way")
    if source.alpha and not target.alpha and parameters.alpha.any():
        found.append(f"{target.name} ignores rotational corrections")
    if scanner is None:
        return found
    if target.effective(parameters, scanner) is not parameters and any(
        getattr(parameters, name).any() for name in ("dl", "voff", "hoff")
    ):
        found.append(f"{target.name} ignores distance corrections and offsets of a {scanner.name}")
    later = _delays_between(source, target, scanner)
    differently = f"{source.name} and {target.name} interpolate azimuths differently"
    if later is None:
        found.append(f"{differently}, and the firing times of the {scanner.name} are not known")
    elif later.any() and (rate_hz is None or not target.alpha):
        found.append(differently)
    return found


def near_points_differ(
    parameters: LaserParameters,
    source: Dialect,
    target: Dialect,
    scanner: Scanner | None = None,
    rate_hz: float | None = None,
) -> list[str]:
    """What two programs do differently with near-point corrections, if that is all that differs.

    Parameters
    ----------
    parameters, source, target, scanner, rate_hz
        As for `incompatibilities`.

    Returns
    -------
    list of str
        Clauses that say where; empty if the conversion is exact, or if something else differs.
    """
    one, other = source.two_point, target.two_point
    alike = replace(source, two_point=other)
    if (
        one is None
        or other is None
        or not incompatibilities(parameters, source, target, scanner, rate_hz)
        or incompatibilities(parameters, alike, target, scanner, rate_hz)
    ):
        return []
    found = []
    nearer, farther = sorted((one.limit_m, other.limit_m))
    if farther > 2.0 * nearer:
        longer = target if other.limit_m > one.limit_m else source
        found.append(f"beyond {nearer:.0f} m {longer.name} extrapolates near-point corrections")
    elif farther != nearer:
        found.append(f"near-point corrections end at {nearer:.2f} or {farther:.2f} m")
    if one.with_offsets != other.with_offsets:
        found.append("within it the offsets are part of the X and Y at which is interpolated")
    if one.z != other.z:
        found.append("Z gets another correction")
    return found


def _delays_between(source: Dialect, target: Dialect, scanner: Scanner) -> Array | None:
    """Time by which the target takes azimuths later, (n_lasers,); None if it is not known."""
    if scanner.firing_time_s is None and source.policy(scanner) is not target.policy(scanner):
        return None
    return np.asarray(target.delays_s(scanner) - source.delays_s(scanner))


def _lever(dialect: Dialect, v: Array) -> Array:
    """Vertical distance of the beam's line from the origin, times cos v, per unit of voff."""
    flat = np.cos(v) ** (2 if dialect.orthogonal else 1)
    return np.asarray(flat - dialect.reach * np.sin(v) ** 2)


def convert(
    parameters: LaserParameters,
    source: Dialect,
    target: Dialect,
    *,
    scanner: Scanner | None = None,
    rate_hz: float | None = None,
    inexact: bool = False,
) -> LaserParameters:
    """Numbers with which another program computes the same points.

    Offset and distance correction describe the same line in space: with b = 1 or cos v,
    ``voff' (b' cos v - reach' sin^2 v) = voff (b cos v - reach sin^2 v)`` and
    ``dl' = dl + (reach voff - reach' voff') tan v``. Near-point corrections move with dl; those
    that have no effect are left out.

    Parameters
    ----------
    parameters : LaserParameters
        Numbers of the dialect `source`.
    source, target : Dialect
    scanner : Scanner, optional
        If given, the interpolation of its azimuths is compared as well.
    rate_hz : float, optional
        Rotation rate at which a difference in interpolation goes into alpha.
    inexact : bool
        Convert what can be converted, and leave what cannot.

    Returns
    -------
    LaserParameters
        Numbers of the dialect `target`.

    Raises
    ------
    DialectError
        If the points would differ and `inexact` is not set; it says by how much. Also if the
        target cannot express the vertical offset of a laser at all.

    Examples
    --------
    >>> factory = velocal.read_parameters("factory.xml", "HDL-32E")
    >>> manual, veloview = velocal.DIALECTS["manual"], velocal.DIALECTS["veloview"]
    >>> len(velocal.convert(factory, manual, veloview))
    32
    """
    if source == target:
        return parameters
    if scanner is not None:
        parameters = source.effective(parameters, scanner)
    v, voff, near = parameters.v, parameters.voff, source.near(parameters)
    alpha = parameters.alpha if source.alpha else np.zeros_like(v)
    later = None if scanner is None else _delays_between(source, target, scanner)
    if later is not None and rate_hz is not None and target.alpha:
        alpha = alpha + 2.0 * np.pi * rate_hz * later
    dl = parameters.dl
    if (source.reach, source.orthogonal) != (target.reach, target.orthogonal):
        lever = _lever(target, v)
        if (singular := (np.abs(lever) < 1e-6) & (voff != 0)).any():
            raise DialectError(
                f"{target.name} cannot express the offset of laser {np.flatnonzero(singular)[0]}"
            )
        voff = np.divide(voff * _lever(source, v), lever, out=np.zeros_like(v), where=voff != 0)
        dl = dl + (source.reach * parameters.voff - target.reach * voff) * np.tan(v)
    carried = {k: a for k, a in parameters.carried.items() if k not in (*NEAR_POINT, TWO_POINT)}
    acts = (near[0] != parameters.dl) | (near[1] != parameters.dl)
    if target.two_point is not None and acts.any():
        moved = (np.where(acts, each + (dl - parameters.dl), dl) for each in near)
        carried |= dict(zip(NEAR_POINT, moved, strict=True)) | {TWO_POINT: acts.astype(float)}
    result = replace(parameters, dl=dl, alpha=alpha, voff=voff, carried=carried)
    reasons = incompatibilities(parameters, source, target, scanner, rate_hz)
    if reasons and not inexact:
        sizes = differences(parameters, source, result, target, scanner, rate_hz or RATE_HZ)
        rate_helps = incompatibilities(parameters, source, target, scanner, RATE_HZ) != reasons
        raise DialectError(
            f"{'; '.join(reasons)}: {sizes}",
            hint="Accept the differences (--inexact)"
            + (", or state the rotation rate (--rate-hz)." if rate_helps else "."),
        )
    return result


def depends_on_rate(source: Dialect, target: Dialect, scanner: Scanner) -> bool:
    """Whether a conversion needs the rotation rate, since azimuths within firings differ.

    Parameters
    ----------
    source, target : Dialect
    scanner : Scanner
    """
    later = _delays_between(source, target, scanner)
    return target.alpha and later is not None and bool(later.any())


def for_program(
    parameters: LaserParameters,
    dialect: str,
    scanner: Scanner | None = None,
    rate_hz: float | None = None,
) -> LaserParameters:
    """Numbers of a refined set for the program that computes by the dialect of that name.

    The set has one distance correction per laser, found at the ranges of its walls; so readers
    with a two-point correction get it for the near points too. Two differences remain: rotational
    corrections that a program ignores, and, without a rate, azimuths that it interpolates in
    another way.

    Parameters
    ----------
    parameters : LaserParameters
        Numbers of the dialect ``paper``.
    dialect : str
    scanner : Scanner, optional
    rate_hz : float, optional
        Rotation rate of the recordings, at which a difference of the azimuths within a firing goes
        into alpha.

    Returns
    -------
    LaserParameters
        Numbers of that dialect.

    Raises
    ------
    ConfigError
        If no dialect has that name.
    DialectError
        If the dialect cannot express the vertical offset of a laser.
    """
    target = dialect_named(dialect)
    return convert(parameters, PAPER, target, scanner=scanner, rate_hz=rate_hz, inexact=True)


def differences(
    parameters: LaserParameters,
    source: Dialect,
    result: LaserParameters,
    target: Dialect,
    scanner: Scanner | None = None,
    rate_hz: float = RATE_HZ,
) -> str:
    """Say how far the points of two calibrations are apart, at each of `RANGES_M`.

    Parameters
    ----------
    parameters, result : LaserParameters
        Numbers of `source` and of `target`.
    source, target : Dialect
    scanner : Scanner, optional
        If given, azimuths are interpolated as each program does for it, at `rate_hz`.
    rate_hz : float
        Rotation rate.

    Returns
    -------
    str
        A clause with the largest distance at every range, centimetres, and the laser.

    Raises
    ------
    DialectError
        If the numbers of lasers differ.
    """
    pair = (source, parameters), (target, result)
    apart = max_point_distance(*pair, scanner=scanner, rate_hz=rate_hz)
    text = ", ".join(
        f"{100 * each.max():.1f} cm at {range_m:g} m"
        + (f" (laser {each.argmax()})" if each.max() > 5e-4 else "")
        for range_m, each in zip(RANGES_M, apart, strict=True)
    )
    return f"points differ by up to {text}" + (f" (at {rate_hz:g} Hz)" if scanner else "")
