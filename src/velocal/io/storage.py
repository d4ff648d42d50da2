"""Files of our own: schema-checked, the same bytes for the same content, never half there."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from velocal.errors import StorageError
from velocal.io.output import new_file

if TYPE_CHECKING:
    import pandas as pd

#: Metadata key under which facts about a table are kept, as JSON.
FACTS = b"velocal.facts"
#: Texts that pandas reads as a truth value or as a missing number; few of our files have them.
_READ_OTHERWISE = frozenset(
    (
        *("True", "TRUE", "true", "False", "FALSE", "false", "nan", "NaN", "-nan", "-NaN"),
        *("None", "#N/A", "#NA", "<NA>", "N/A", "NA", "n/a", "NULL", "null"),
    )
)
#: Types of columns of which the first, second, ... bytes of all numbers are stored together.
_SPLIT = (pa.uint8(), pa.uint16(), pa.uint32(), pa.float32())
_DAMAGED = "If the file is there, it is damaged: delete it, and make it again."


def write_blocks(path: Path, blocks: Iterable[bytes]) -> None:
    """Write a binary file block by block, as they come."""
    with new_file(path) as file:
        file.writelines(blocks)


def write_text(path: Path, text: str) -> None:
    """Write a text file, in UTF-8 and with line ends of one byte."""
    write_blocks(path, [text.encode()])


def _plain(value: Any) -> Any:
    """Numbers of an array, for facts, in which NaN is kept."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON; arrays become lists, numbers keep all their digits, NaN becomes null."""
    write_text(path, json.dumps(finite(content), indent=1, allow_nan=False) + "\n")


def finite(value: Any) -> Any:
    """Turn a value into what JSON can hold.

    Parameters
    ----------
    value : mapping, sequence, array, number, str, bool or None
        May hold others of these.

    Returns
    -------
    dict, list, str, int, float, bool or None
        Arrays and tuples become lists. JSON has no NaN and no infinity: they become None.

    Raises
    ------
    TypeError
        If something else is among the values.
    """
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return finite(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object.

    Raises
    ------
    StorageError
        If the file is missing or not a JSON object.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise StorageError(f"cannot be read: {error}", where=str(path), hint=_DAMAGED) from None
    if not isinstance(content, dict):
        raise StorageError("is not a JSON object", where=str(path), hint=_DAMAGED)
    return content


def write_csv(
    path: Path, table: pd.DataFrame | Mapping[str, Any], digits: int | None = None
) -> None:
    """Write a CSV; floats with `digits` decimals, or shortest exact form if None."""
    write_text(path, _plain_csv(table, digits) or _csv_of_pandas(table, digits))


# The import of pandas takes longer than many jobs. It is needed only for tables of pandas, and for
# columns in which numbers, names and gaps are mixed.


def _csv_of_pandas(table: pd.DataFrame | Mapping[str, Any], digits: int | None) -> str:
    """Text of a CSV of any columns."""
    import pandas as pd

    return pd.DataFrame(table).to_csv(
        index=False,
        lineterminator="\n",
        float_format=None if digits is None else f"%.{digits}f",
    )


def _plain_csv(table: pd.DataFrame | Mapping[str, Any], digits: int | None) -> str | None:
    """Text of a CSV of plain columns, as pandas writes it; None if there are others."""
    if not isinstance(table, Mapping) or not table:
        return None
    columns = [_plain_column(values, digits) for values in table.values()]
    rows = [column for column in columns if column is not None]
    if len(rows) < len(columns) or len({len(column) for column in rows}) > 1:
        return None
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(table)
    lines.writerows(zip(*rows, strict=True))
    return text.getvalue()


def _plain_column(values: Any, digits: int | None) -> list[Any] | None:
    """What a CSV holds of an array or a list of numbers or of names; else None."""
    if isinstance(values, list):
        types = set(map(type, values))
        if types <= {str}:
            return values
        if not (types <= {int, float} or types <= {bool}):
            return None
        values = np.array(values)
    if not isinstance(values, np.ndarray) or values.ndim != 1:
        return None
    if values.dtype.kind in "biuU":
        return list(values.tolist())
    if values.dtype != np.float64:
        return None
    form = repr if digits is None else f"{{:.{digits}f}}".format
    return ["" if math.isnan(value) else form(value) for value in values.tolist()]


class TableWriter:
    """Stream of record batches into one Parquet file of a given schema."""

    def __init__(self, writer: pq.ParquetWriter, schema: pa.Schema) -> None:
        self._writer, self._schema = writer, schema

    def write(self, columns: Mapping[str, Any]) -> None:
        """Append rows, given as one array per column."""
        arrays = [_to_arrow(columns[field.name], field.type) for field in self._schema]
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))


@contextmanager
def table_writer(
    path: Path, schema: pa.Schema, settings: Mapping[str, Any] | None = None, /, **facts: Any
) -> Iterator[TableWriter]:
    """Open a Parquet file for streaming; it appears under its name when the block succeeds.

    Parameters
    ----------
    path : Path
    schema : pyarrow.Schema
    settings : mapping, optional
        Settings of `pyarrow.parquet.ParquetWriter` that differ from the usual ones.
    **facts
        What is kept about the table.

    Yields
    ------
    TableWriter
    """
    metadata = {**(schema.metadata or {}), FACTS: json.dumps(facts, default=_plain).encode()}
    described = schema.with_metadata(metadata)
    split = [field.name for field in schema if field.type in _SPLIT]
    options: dict[str, Any] = {
        "compression": "zstd",
        "compression_level": 1,
        # Measured on 13 million returns: less than half the time and three quarters of the size of
        # dictionaries.
        "use_dictionary": False,
        "column_encoding": dict.fromkeys(split, "BYTE_STREAM_SPLIT"),
        # Without them most damaged bytes would be read as other numbers.
        "write_page_checksum": True,
        **(settings or {}),
    }
    with new_file(path) as file, pq.ParquetWriter(file, described, **options) as writer:
        yield TableWriter(writer, described)


# To convert a column pyarrow imports pandas, which takes longer than many jobs: the memory of plain
# numbers is handed over as it is.


def _to_arrow(values: Any, kind: pa.DataType) -> pa.Array:
    """Column of a table, of a type that it has or can be converted to without loss."""
    given = np.ascontiguousarray(values)
    if given.dtype == bool and pa.types.is_boolean(kind):
        given = np.packbits(given, bitorder="little")
    elif pa.types.is_floating(kind) and given.dtype.kind == "f":
        given = given.astype(kind.to_pandas_dtype(), copy=False)
    elif not pa.types.is_primitive(kind) or given.dtype != kind.to_pandas_dtype():
        return pa.array(values, type=kind)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(given)])


def _to_numpy(column: pa.ChunkedArray) -> np.ndarray[Any, Any]:
    """Values of a column."""
    kind = column.type
    if column.null_count or not pa.types.is_primitive(kind):
        return np.asarray(column.to_numpy())
    values = _bits if pa.types.is_boolean(kind) else np.from_dlpack
    parts = [values(chunk) for chunk in column.chunks if len(chunk)]
    if not parts:
        return np.empty(0, dtype=kind.to_pandas_dtype())
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _bits(chunk: pa.Array) -> np.ndarray[Any, Any]:
    """Truth values, of which eight are kept in a byte."""
    packed = np.frombuffer(chunk.buffers()[1], np.uint8)
    places = np.unpackbits(packed, count=chunk.offset + len(chunk), bitorder="little")
    return places[chunk.offset :].view(bool)


def write_table(path: Path, schema: pa.Schema, columns: Mapping[str, Any], **facts: Any) -> None:
    """Write one Parquet table at once."""
    with table_writer(path, schema, **facts) as writer:
        writer.write(columns)


def read_table(
    path: Path, schema: pa.Schema, columns: list[str] | None = None
) -> tuple[dict[str, np.ndarray[Any, Any]], dict[str, Any]]:
    """Read a Parquet table that was written with `schema`.

    Returns
    -------
    columns : dict of str to ndarray
    facts : dict
        What was stored about the table.

    Raises
    ------
    StorageError
        If the file is damaged, or of another kind or version.
    """
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            facts = _facts(file.schema_arrow, schema, path)
            _check_columns(file.schema_arrow, schema, path)
            table = file.read(columns=columns)
        # A damaged page may be read as something that is no number of the column's type.
        table.validate(full=True)
        return {name: _to_numpy(table[name]) for name in table.column_names}, facts
    except (OSError, ValueError, MemoryError, pa.ArrowException) as error:
        reason = str(error).splitlines()[0] if str(error) else "no memory for what it states"
        raise StorageError(
            f"cannot be read: {reason}",
            where=str(path),
            hint=_DAMAGED,
        ) from None


def column_names(path: Path) -> list[str]:
    """Names of the columns of a Parquet table.

    Raises
    ------
    StorageError
        If the file is damaged.
    """
    try:
        with pq.ParquetFile(path) as file:
            return list(file.schema_arrow.names)
    except (OSError, ValueError, MemoryError, pa.ArrowException) as error:
        reason = (str(error).splitlines() or ["no memory for what it states"])[0]
        raise StorageError(f"cannot be read: {reason}", where=str(path), hint=_DAMAGED) from None


def _check_columns(found: pa.Schema, schema: pa.Schema, path: Path) -> None:
    """Check that a table has the columns of a schema, of the same types and in the same order."""
    if found.names == schema.names and found.types == schema.types:
        return
    raise StorageError(
        f"has the columns {', '.join(found.names)}",
        where=str(path),
        allowed=", ".join(schema.names),
        hint="Make the file again with this version of velocal.",
    )


class Facts(dict[str, Any]):
    """Facts of a table by name; one that is not there is an error of the file."""

    def __init__(self, facts: Mapping[str, Any], path: Path) -> None:
        super().__init__(facts)
        self.path = path

    def __missing__(self, name: str) -> Any:
        """Say which fact the file does not state."""
        raise StorageError(f"does not state {name!r}", where=str(self.path), hint=_DAMAGED)


def _facts(found: pa.Schema, schema: pa.Schema, path: Path) -> dict[str, Any]:
    """Facts of a table, which has to be of the kind and version of a schema."""
    metadata = found.metadata or {}
    for key in (b"velocal.kind", b"velocal.version"):
        expected, value = schema.metadata[key], metadata.get(key, b"none")
        if value != expected:
            raise StorageError(
                f"{key.decode()} is {value.decode(errors='replace')!r}",
                where=str(path),
                allowed=repr(expected.decode()),
                hint="Make the file again with this version of velocal.",
            )
    return Facts(json.loads(metadata.get(FACTS, b"{}")), path)


def read_csv(path: Path, text: Sequence[str] = ()) -> dict[str, np.ndarray[Any, Any]]:
    """Read a CSV of our own into one array per column.

    Parameters
    ----------
    path : Path
    text : sequence of str
        Columns, as far as there are such, that hold names: they are read as they stand, also where
        a name looks like a number or like a missing value.

    Returns
    -------
    dict of str to ndarray

    Raises
    ------
    StorageError
        If the file is missing or damaged.
    """
    found = _read_plain_csv(path, text)
    return _read_by_pandas(path, text) if found is None else found


def _read_by_pandas(path: Path, text: Sequence[str]) -> dict[str, np.ndarray[Any, Any]]:
    """Read any CSV, or say what is wrong with it."""
    import pandas as pd

    try:
        table = pd.read_csv(path)
        names = [name for name in table.columns if name in text]
        if names:
            table[names] = pd.read_csv(path, usecols=names, dtype=str, na_filter=False)[names]
    except (OSError, ValueError) as error:
        raise StorageError(f"cannot be read: {error}", where=str(path), hint=_DAMAGED) from None
    return {str(name): table[name].to_numpy() for name in table.columns}


def _read_plain_csv(path: Path, text: Sequence[str]) -> dict[str, np.ndarray[Any, Any]] | None:
    """Read a CSV of numbers and names as pandas does; None if it is another one."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            names, *rows = csv.reader(file)
    except (OSError, ValueError, csv.Error):
        return None
    if not rows or len(set(names)) < len(names) or {len(row) for row in rows} != {len(names)}:
        return None
    columns = {
        name: np.array(values, dtype=object) if name in text else _values(values)
        for name, values in zip(names, zip(*rows, strict=True), strict=True)
    }
    found = {name: values for name, values in columns.items() if values is not None}
    return found if len(found) == len(columns) else None


def _values(texts: Sequence[str]) -> np.ndarray[Any, Any] | None:
    """Numbers, or names if one of the texts is none; None if pandas may read something else."""
    if _READ_OTHERWISE.intersection(texts):
        return None
    # Python takes 1_000 and digits of other scripts for numbers.
    together = "".join(texts)
    if together.isascii() and "_" not in together:
        try:
            if "" not in texts:
                return np.array([int(text) for text in texts], dtype=np.int64)
        except OverflowError:
            return None
        except ValueError:
            pass
        try:
            return np.array([float(text or "nan") for text in texts])
        except ValueError:
            pass
    return np.array([text or math.nan for text in texts], dtype=object)
