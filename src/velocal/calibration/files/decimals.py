"""Exact passage between the decimal numbers of files and floats in metres and radians.

Converting with floats (`degrees * pi / 180`) rounds twice, and some floats then have no decimal
text that leads back to them. So the conversion is done in decimals of 50 digits and rounded once;
17 digits are then enough to write any float so that it is read back bit for bit.
"""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from typing import Final

import numpy as np

from velocal.errors import CalibrationFileError

#: Size of a file's unit in our units.
UNCHANGED: Final = Decimal(1)
METRES_PER_CENTIMETRE: Final = Decimal("0.01")
RADIANS_PER_DEGREE: Final = Decimal(
    "0.01745329251994329576923690768488612713442871888541725456"
)  # pi / 180

_PRECISION = 50
_DIGITS_OF_A_FLOAT = 17


def _scaled(number: Decimal, unit: Decimal) -> float:
    with localcontext(prec=_PRECISION):
        return float(number * unit)


def number(value: object, key: str, where: str, unit: Decimal = UNCHANGED) -> float:
    """Convert what a file holds under a key.

    Parameters
    ----------
    value : object
        Text or number, in the file's unit; None if the file has no such key.
    key, where : str
        Named in errors.
    unit : Decimal
        Size of the file's unit in metres or radians.

    Returns
    -------
    float
        Metres, radians, or a plain number.

    Raises
    ------
    CalibrationFileError
        If the value is missing, not a number or not finite.
    """
    if value is None:
        raise CalibrationFileError(f"{key} is missing", where=where)
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise CalibrationFileError(
            f"{key} is of type {type(value).__name__}", where=where, allowed="a number"
        )
    try:
        result = _scaled(Decimal(str(value)), unit)
    except (ArithmeticError, ValueError):  # ValueError: an integer of thousands of digits
        shown = repr(value[:40]) if isinstance(value, str) else "too large"
        raise CalibrationFileError(f"{key} is {shown}", where=where, allowed="a number") from None
    if not np.isfinite(result):
        raise CalibrationFileError(f"{key} is {result}", where=where, allowed="a finite number")
    return result


def text(value: float, unit: Decimal = UNCHANGED) -> str:
    """Write a number in the file's unit: the shortest text that `number` reads back bit for bit.

    Parameters
    ----------
    value : float
        Metres, radians, or a plain number.
    unit : Decimal
        Size of the file's unit in metres or radians.

    Returns
    -------
    str
        Without an exponent.
    """
    with localcontext(prec=_PRECISION):
        exact = Decimal(value) / unit
    for digits in range(1, _DIGITS_OF_A_FLOAT + 1):
        rounded = Context(prec=digits).create_decimal(exact)
        if _scaled(rounded, unit) == value:
            break
    # Never an exponent: not every reader knows it, and these numbers are of ordinary size.
    return f"{rounded.normalize():f}"
