"""Files of our own: whole or absent, the same bytes for the same content, never mistaken."""

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typing_extensions import TypeAliasType

from velocal.errors import StorageError
from velocal.io import schemas, storage
from velocal.io.output import new_file
from velocal.io.plain import from_plain, to_plain


def medians(n: int = 1000) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    return {
        "laser_id": rng.integers(0, 64, n).astype(np.uint8),
        "azimuth": rng.uniform(0, 36_000, n).astype(np.float32),
        "distance": rng.uniform(0, 60_000, n).astype(np.float32),
        "spread": rng.uniform(0, 9, n).astype(np.float32),
        "count": rng.integers(1, 100, n).astype(np.uint16),
    }


def write_parquet(path):
    storage.write_table(path, schemas.MEDIANS, medians(), scanner="HDL-64E", rate=9.9)


def write_json(path):
    storage.write_json(path, {"b": np.arange(3), "a": np.float64(0.1), "t": {"x": True}})


def write_csv(path):
    storage.write_csv(path, pd.DataFrame({"laser": [1, 2], "std_cm": [0.1, 1 / 3]}))


WRITERS = [write_parquet, write_json, write_csv]


@pytest.mark.parametrize("write", WRITERS)
def test_same_content_same_bytes(write, tmp_path):
    paths = [tmp_path / "a" / "file", tmp_path / "b" / "file"]
    for path in paths:
        path.parent.mkdir()
        write(path)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    write(paths[0])
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert [p.name for p in paths[0].parent.iterdir()] == ["file"]


def files(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("there_before", [False, True])
def test_a_failed_write_leaves_nothing_behind(there_before, tmp_path):
    path = tmp_path / "file"
    if there_before:
        path.write_text("old")

    def fail() -> None:
        with new_file(path) as file:
            file.write(b"half")
            raise RuntimeError("disk on fire")

    with pytest.raises(RuntimeError, match="disk on fire"):
        fail()
    assert files(tmp_path) == (["file"] if there_before else [])
    if there_before:
        assert path.read_text() == "old"


def test_a_failed_table_leaves_nothing_behind(tmp_path):
    path = tmp_path / "medians.parquet"

    def fail() -> None:
        with storage.table_writer(path, schemas.MEDIANS) as writer:
            writer.write(medians())
            writer.write({"laser_id": np.zeros(3, np.uint8)})  # columns are missing

    with pytest.raises(KeyError):
        fail()
    assert files(tmp_path) == []
    with pytest.raises(TypeError):
        storage.write_json(tmp_path / "x.json", {"a": object()})
    assert files(tmp_path) == []


def test_a_table_comes_back(tmp_path):
    path = tmp_path / "medians.parquet"
    sent = medians()
    with storage.table_writer(path, schemas.MEDIANS, planes=["wall"], n=np.int64(3)) as writer:
        for part in (slice(0, 300), slice(300, 300), slice(300, None)):
            writer.write({name: column[part] for name, column in sent.items()})
    columns, facts = storage.read_table(path, schemas.MEDIANS)
    assert list(columns) == [field.name for field in schemas.MEDIANS]
    for name, column in sent.items():
        assert columns[name].dtype == column.dtype
        np.testing.assert_array_equal(columns[name], column)
    assert facts == {"planes": ["wall"], "n": 3}
    some, _ = storage.read_table(path, schemas.MEDIANS, columns=["count"])
    assert list(some) == ["count"]


def test_numbers_too_large_for_a_column_are_refused(tmp_path):
    with pytest.raises(pa.ArrowInvalid):
        storage.write_table(
            tmp_path / "x", schemas.MEDIANS, {**medians(), "count": np.full(1000, 70_000)}
        )
    assert files(tmp_path) == []


def test_a_table_of_another_kind(tmp_path):
    path = tmp_path / "medians.parquet"
    write_parquet(path)
    with pytest.raises(StorageError, match=r"velocal\.kind is 'medians'") as caught:
        storage.read_table(path, schemas.RETURNS)
    assert "allowed: 'returns'" in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_table_of_another_version(tmp_path):
    path = tmp_path / "medians.parquet"
    old = schemas.MEDIANS.with_metadata({"velocal.kind": "medians", "velocal.version": "0"})
    storage.write_table(path, old, medians())
    with pytest.raises(StorageError, match=r"velocal\.version is '0'") as caught:
        storage.read_table(path, schemas.MEDIANS)
    assert "Hint:" in str(caught.value)


def test_a_table_of_somebody_else(tmp_path):
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table({"laser_id": [1, 2]}), path)
    with pytest.raises(StorageError, match=r"velocal\.kind is 'none'"):
        storage.read_table(path, schemas.MEDIANS)


def test_damaged_tables(tmp_path):
    path = tmp_path / "medians.parquet"
    with pytest.raises(StorageError, match="cannot be read"):
        storage.read_table(path, schemas.MEDIANS)
    write_parquet(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(StorageError, match="cannot be read"):
        storage.read_table(path, schemas.MEDIANS)


def test_json_keeps_all_digits_and_knows_no_nan(tmp_path):
    path = tmp_path / "x.json"
    numbers = np.random.default_rng(1).normal(size=20)
    storage.write_json(
        path,
        {"v": numbers, "bad": [np.nan, {"deep": np.inf}], "n": np.int64(7), "none": None},
    )
    assert "NaN" not in path.read_text()
    found = storage.read_json(path)
    np.testing.assert_array_equal(found["v"], numbers)
    assert found["bad"] == [None, {"deep": None}]
    assert found["n"] == 7
    assert path.read_bytes().endswith(b"}\n")
    assert b"\r" not in path.read_bytes()


@pytest.mark.parametrize("content", ["", "{", "[1, 2]", "nonsense"])
def test_bad_json(content, tmp_path):
    path = tmp_path / "x.json"
    path.write_text(content)
    with pytest.raises(StorageError, match=str(path)):
        storage.read_json(path)


def test_csv(tmp_path):
    path = tmp_path / "x.csv"
    table = pd.DataFrame({"laser": [1, 2], "std_cm": [0.1, 1 / 3]})
    storage.write_csv(path, table)
    assert path.read_bytes() == b"laser,std_cm\n1,0.1\n2,0.3333333333333333\n"
    storage.write_csv(path, table, digits=2)
    assert path.read_bytes() == b"laser,std_cm\n1,0.10\n2,0.33\n"


@given(st.lists(st.text("0123456789+-.eE_ inaf٣,", max_size=6), min_size=1, max_size=4))
def test_texts_are_numbers_where_they_are_for_pandas(tmp_path_factory, texts):
    path = tmp_path_factory.getbasetemp() / "texts.csv"
    pd.DataFrame({"row": range(len(texts)), "text": texts}).to_csv(path, index=False)
    found = pd.DataFrame(storage.read_csv(path))
    expected = pd.read_csv(path)
    pd.testing.assert_frame_equal(found, expected, rtol=1e-15)


@pytest.mark.parametrize(
    "columns",
    [
        {"laser_id": [0, 1], "mean": [1 / 3, 1e-7], "used": [True, False], "name": ["a,b", 'c"d']},
        {"mean": np.array([np.nan, -0.0]), "count": np.array([1, 2], np.uint16), "name": ["", "1"]},
        {"far": np.array([1e16, np.inf]), "used": np.array([True, False]), "name": ["1", "02"]},
        {"none": [], "name": []},
        {"single": np.array([0.1, 2.5], np.float32)},
        {"mixed": [1, "a", None, np.nan], "gap": [1, None, 2, 3], "name": ["NA", "nan", "x", "y"]},
        {"name": np.array(["a", "b"]), "kind": np.array(["a", None], dtype=object)},
    ],
)
@pytest.mark.parametrize("digits", [None, 2])
def test_columns_are_written_and_read_as_by_pandas(columns, digits, tmp_path):
    """Plain columns do without pandas, whose import takes longer than many jobs."""
    path = tmp_path / "x.csv"
    storage.write_csv(path, pd.DataFrame(columns), digits)
    expected = path.read_bytes()
    storage.write_csv(path, columns, digits)
    assert path.read_bytes() == expected
    frame = pd.read_csv(path)
    found = storage.read_csv(path, text=["name"])
    assert list(found) == list(frame.columns)
    if "name" in found:
        frame["name"] = pd.read_csv(path, dtype=str, na_filter=False)["name"]
    pd.testing.assert_frame_equal(pd.DataFrame(found), frame, check_dtype=len(frame) > 0)


@pytest.mark.parametrize(
    "schema",
    [value for value in vars(schemas).values() if isinstance(value, pa.Schema)],
    ids=lambda schema: schema.metadata[b"velocal.kind"].decode(),
)
def test_every_column_has_a_unit_and_a_description(schema):
    assert schema.metadata[b"velocal.version"].decode() == schemas.VERSION
    for field in schema:
        assert field.metadata[b"unit"]
        assert field.metadata[b"description"]
        assert not field.nullable


def test_damage_is_found_everywhere(tmp_path):
    """A changed bit gives the same numbers (it lies where nothing is read), or our error."""
    path, rng = tmp_path / "medians.parquet", np.random.default_rng(0)
    write_parquet(path)
    good, expected = path.read_bytes(), medians()
    refused = 0
    for at in [*rng.integers(0, len(good), 150), *range(len(good) - 100, len(good))]:
        damaged = bytearray(good)
        damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            columns, _ = storage.read_table(path, schemas.MEDIANS)
        except StorageError:
            refused += 1
            continue
        for name, values in expected.items():
            np.testing.assert_array_equal(columns[name], values)
    assert refused > 150  # the pages are most of the file


def test_missing_columns_of_the_right_kind(tmp_path):
    path = tmp_path / "medians.parquet"
    write_parquet(path)
    table = pq.read_table(path)
    pq.write_table(table.drop_columns(["count"]), path)
    with pytest.raises(StorageError, match=r"has the columns .*allowed: .*count"):
        storage.read_table(path, schemas.MEDIANS)


_Number = TypeVar("_Number")
#: As numpy 2.5 defines NDArray on Python 3.12 and newer.
_Alias = TypeAliasType(
    "_Alias", np.ndarray[tuple[Any, ...], np.dtype[_Number]], type_params=(_Number,)
)


@dataclass(frozen=True)
class Held:
    """An array whose type is an alias."""

    values: _Alias[np.float64]
    counts: _Alias[np.int64] | None


@pytest.mark.parametrize("counts", [None, np.array([1, 2])])
def test_arrays_of_an_alias_come_back(counts):
    content = to_plain(Held(np.array([1.5, np.nan]), counts))
    again = from_plain(Held, content, "x.json")
    np.testing.assert_array_equal(again.values, [1.5, np.nan])
    assert counts is None or again.counts.dtype == np.int64
