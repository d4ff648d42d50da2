"""Dataclasses as plain values for JSON, and back."""

from __future__ import annotations

import typing
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from velocal.errors import StorageError

_T = TypeVar("_T")


def to_plain(value: Any) -> Any:
    """Turn a dataclass with all that it holds into mappings, lists and numbers.

    Parameters
    ----------
    value : dataclass, array, mapping, sequence, number, str, bool or None

    Returns
    -------
    dict, list, str, int, float, bool or None
        NaN stays as it is; `storage.write_json` writes it as null.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {each.name: to_plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    return value


def from_plain(kind: type[_T], content: Any, where: str) -> _T:
    """Build a dataclass from what `to_plain` gave, by the types of its fields.

    Parameters
    ----------
    kind : type
        The dataclass.
    content : object
        Content of a JSON file, in which null stands for NaN in arrays and numbers.
    where : str
        File, for errors.

    Returns
    -------
    object of type `kind`

    Raises
    ------
    StorageError
        If a field is missing or has content of another type.
    """
    try:
        return typing.cast(_T, _built(kind, content))
    except (KeyError, TypeError, ValueError) as error:
        raise StorageError(
            f"is no {kind.__name__}: {error}",
            where=where,
            hint="Delete the file, and run the workflow again.",
        ) from None


def _built(kind: Any, content: Any) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if hasattr(origin, "__value__"):  # NDArray of numpy 2.5 is an alias by a `type` statement
        return _built(origin.__value__[parts], content)
    if origin in (Union, UnionType):
        if content is None:
            return None
        return _built(next(part for part in parts if part is not NoneType), content)
    if isinstance(kind, type) and is_dataclass(kind):
        types = get_type_hints(kind)
        return kind(**{each.name: _built(types[each.name], content[each.name])
                       for each in fields(kind)})  # fmt: skip
    if origin is np.ndarray:
        # NDArray[scalar] is ndarray[shape, dtype[scalar]]. Several kinds of integers are int64.
        scalar = get_args(parts[1])[0] if get_args(parts[1]) else np.float64
        dtype = scalar if scalar in (np.float64, np.bool_) else np.int64
        return np.array(content, dtype=dtype)
    if origin is tuple:
        kinds = parts[:1] * len(content) if parts[-1] is Ellipsis else parts
        return tuple(_built(one, item) for one, item in zip(kinds, content, strict=True))
    if origin is not None and issubclass(origin, Mapping):
        return {key: _built(parts[1], item) for key, item in content.items()}
    if kind is float:
        return float("nan") if content is None else float(content)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(content)
    if not isinstance(content, kind):
        raise TypeError(f"{content!r} is no {kind.__name__}")
    return content
