"""Which scanner a calibration fits: its vertical angles tell, since every model has its own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from velocal.arrays import Array
from velocal.errors import CalibrationFileError
from velocal.scanner.models import SCANNERS, Scanner

#: Median of the differences from the nominal vertical angles up to which a calibration fits. Units
#: of an HDL-64E differ from nominal by 0.5 degrees; models of the same number of lasers differ from
#: each other by 2.7 degrees or more (VLP-16 and VLP-16 Hi-Res).
FIT_RAD = float(np.deg2rad(1.5))


def misfit_rad(v: Array, scanner: Scanner) -> float:
    """Compare vertical angles with those of a scanner, laser by laser.

    Parameters
    ----------
    v : ndarray, shape (n,)
        Vertical angles by laser, radians; NaN where unknown.
    scanner : Scanner

    Returns
    -------
    float
        Median of the differences, radians; infinite for another number of lasers, or if no angle
        is known.
    """
    return _median(v, scanner.vertical_rad)


def is_like(v: Array, scanner: Scanner) -> bool:
    """Whether vertical angles, in whatever order and sign, are those of a scanner."""
    return _disordered_rad(v, scanner) < FIT_RAD


def _disordered_rad(v: Array, scanner: Scanner) -> float:
    ordered = np.sort(scanner.vertical_rad)
    return min(_median(np.sort(v), way) for way in (ordered, -ordered[::-1]))


def _median(v: Array, nominal: Array) -> float:
    if len(v) != len(nominal) or np.isnan(v).all():
        return float("inf")
    return float(np.nanmedian(np.abs(v - nominal)))


def fitting(v: Array) -> Iterator[Scanner]:
    """Scanners whose vertical angles these are, the best first.

    Parameters
    ----------
    v : ndarray, shape (n,)
        Vertical angles by laser, radians.

    Yields
    ------
    Scanner
        Several where models have the same angles, as the series of the HDL-64E do.
    """
    misfits = [(misfit_rad(v, scanner), scanner) for scanner in SCANNERS.values()]
    for misfit, scanner in sorted(misfits, key=lambda each: each[0]):
        if misfit <= FIT_RAD:
            yield scanner


def closest(v: Array) -> Scanner | None:
    """Scanner whose vertical angles are the closest, even if none fits.

    Parameters
    ----------
    v : ndarray, shape (n,)
        Vertical angles by laser, radians; NaN where unknown.

    Returns
    -------
    Scanner or None
        None if no scanner has that number of lasers.
    """
    same = [scanner for scanner in SCANNERS.values() if scanner.n_lasers == len(v)]
    disordered = min(same, key=lambda scanner: _disordered_rad(v, scanner), default=None)
    return next(fitting(v), disordered)


def check_fit(v: Array, scanner: Scanner, where: str, stated: str | None = None) -> None:
    """Refuse the calibration of another model.

    A calibration that fits no scanner is accepted: it may be that of an unusual unit.

    Parameters
    ----------
    v : ndarray, shape (n,)
        Its vertical angles, radians.
    scanner : Scanner
        Scanner to which it will be applied.
    where : str
        File, for the error.
    stated : str, optional
        Scanner that the file names.

    Raises
    ------
    CalibrationFileError
        If the file names another model, or its vertical angles are those of another model.
    """
    if stated is not None and stated != scanner.name:
        named = SCANNERS.get(stated)
        if named is None or not np.array_equal(named.vertical_rad, scanner.vertical_rad):
            raise CalibrationFileError(
                f"is the calibration of a {stated}, not of a {scanner.name}",
                where=where,
                hint="Give the file of this scanner, or name the scanner of the recording.",
            )
    if misfit_rad(v, scanner) <= FIT_RAD:
        return
    for other in fitting(v):
        away = np.rad2deg(misfit_rad(v, scanner))
        raise CalibrationFileError(
            f"has the vertical angles of a {other.name}; those of a {scanner.name} differ by "
            f"{away:.1f} deg in the median",
            where=where,
            allowed=f"the calibration of a {scanner.name}",
            hint=f"If the scanner is a {other.name}, name it (--scanner, or the column scanner of "
            "the sample table).",
        )
