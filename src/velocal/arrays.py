"""The one array type that all numeric functions take and give, and rows of several arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

#: Double precision numbers of any shape; docstrings say which shape and unit.
Array = NDArray[np.float64]

#: Rows of a block: its temporary arrays fit into the cache of a processor. Those of a whole window
#: take longer to be allocated than to be computed.
BLOCK = 16384

_Table = TypeVar("_Table", bound="DataclassInstance")


def blocks(n: int) -> Iterator[slice]:
    """Divide n rows into blocks of `BLOCK` rows.

    Parameters
    ----------
    n : int

    Yields
    ------
    slice
        Of consecutive rows.
    """
    for start in range(0, n, BLOCK):
        yield slice(start, start + BLOCK)


def columns_of(table: DataclassInstance) -> dict[str, NDArray[Any]]:
    """Arrays of a dataclass by the name of their field; its other fields are left out."""
    return {name: value for name, value in vars(table).items() if isinstance(value, np.ndarray)}


def rows_of(table: _Table, rows: NDArray[Any] | slice) -> _Table:
    """Take some rows of every array of a dataclass.

    Parameters
    ----------
    table : dataclass
        Its arrays have one length; other fields are kept.
    rows : ndarray or slice
        Mask, numbers or slice.

    Returns
    -------
    dataclass
        Of the same class.
    """
    return replace(table, **{name: values[rows] for name, values in columns_of(table).items()})


def joined_rows(tables: Sequence[_Table]) -> _Table:
    """Join the arrays of dataclasses of one class, one after the other.

    Parameters
    ----------
    tables : sequence of dataclass
        One at least; all have arrays in the same fields.

    Returns
    -------
    dataclass
        Its other fields are those of the first.
    """
    parts = [columns_of(table) for table in tables]
    names = parts[0]
    return replace(tables[0], **{n: np.concatenate([part[n] for part in parts]) for n in names})
