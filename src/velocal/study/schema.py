"""JSON schemas and tables of keys for people and editors, made from the models.

``python -m velocal.study.schema`` writes them into the folder ``config``; a test compares them with
what the models say.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from velocal.io import storage
from velocal.io.markup import inserted
from velocal.study.config import StudyConfig
from velocal.study.model import Placeholder
from velocal.study.samples import OutdoorSample, SurveyedSample, UnsurveyedSample
from velocal.study.world import WorldFile

#: Models of whole files, by the name of their schema.
FILES: dict[str, type[BaseModel]] = {"config": StudyConfig, "world": WorldFile}
#: Tables of keys or columns, by the name that their marks in the text have.
TABLES: dict[str, type[BaseModel]] = {
    "config": StudyConfig,
    "samples": SurveyedSample,
    "unsurveyed_samples": UnsurveyedSample,
    "outdoor_samples": OutdoorSample,
}
#: Units by the ending of a field's name, the longest first.
UNITS = {
    "_cm_per_m": "cm/m",
    "_arcsec": "arcsec",
    "_deg": "deg",
    "_cm": "cm",
    "_mm": "mm",
    "_um": "um",
    "_m": "m",
}


def schema(model: type[BaseModel]) -> dict[str, Any]:
    """JSON schema of a model, which editors use to complete and to check a file."""
    found = model.model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def key_table(model: type[BaseModel]) -> str:
    """Markdown table of all keys of a model: key, unit, default and meaning."""
    meanings: dict[str, list[str]] = {}
    cells: dict[str, tuple[str, str]] = {}
    for key, field in keys(model):
        cells.setdefault(key, (unit_of(key), default_of(field)))
        choices = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
        values = ", ".join(f"`{value}`" for value in choices)
        text = field.description or ""
        meanings.setdefault(key, []).append(text if not values else f"{values}: {text}")
    rows = ["| key | unit | default | what |", "|---|---|---|---|"]
    for key, (unit, default) in cells.items():
        what = "; ".join(dict.fromkeys(meanings[key]))
        rows.append(f"| `{key}` | {unit} | {default} | {what} |")
    return "\n".join(rows) + "\n"


def keys(model: type[BaseModel], place: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Every key of a model and of the models in it, with its field.

    Parameters
    ----------
    model : type of BaseModel
    place : str
        Key of the model itself.

    Yields
    ------
    str, FieldInfo
        Keys that the user chooses are written as ``{sample}``. Where a key holds one of several
        models, keys that some of them share come several times, with the field of each.
    """
    for name, field in model.model_fields.items():
        key = f"{place}.{field.alias or name}".lstrip(".")
        inside = list(_inside(field.annotation, key))
        below = {inner for inner, found in inside if found is None}
        yield (below.pop() if len(below) == 1 else key), field
        for inner, found in inside:
            if found is not None:
                yield from keys(found, inner)


def _inside(annotation: Any, key: str) -> Iterator[tuple[str, type[BaseModel] | None]]:
    """Keys below a key of some type, with the model there; None for anything else."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield key, annotation
    elif origin is Annotated:
        yield from _inside(parts[0], key)
    elif origin in (Union, UnionType):
        for part in parts:
            if part is not type(None):
                yield from _inside(part, key)
    elif origin is dict:
        mark = next(mark for mark in get_args(parts[0]) if isinstance(mark, Placeholder))
        yield from _inside(parts[1], f"{key}.{mark.text}")
    else:
        yield key, None


def unit_of(key: str) -> str:
    """Unit that the name of a key ends in; nothing if it names none."""
    name = re.sub(r"\.\{\w+\}$", "", key)
    return next((unit for ending, unit in UNITS.items() if name.endswith(ending)), "")


def default_of(field: FieldInfo) -> str:
    """Default of a field as the table shows it: nothing if the key must be given."""
    if field.is_required():
        return ""
    value = field.get_default()
    if isinstance(value, BaseModel) or value in (None, {}, ()):
        return "–"
    return f"`{json.dumps(value)}`".replace('"', "")


def outputs(folder: Path) -> dict[Path, str]:
    """Files that are made from the models, with their text.

    Parameters
    ----------
    folder : Path
        The folder ``config``.

    Returns
    -------
    dict of Path to str
    """
    made = {
        folder / f"schema/{name}.json": json.dumps(schema(model), indent=2, ensure_ascii=False)
        + "\n"
        for name, model in FILES.items()
    }
    readme = folder / "README.md"
    text = readme.read_text(encoding="utf-8")
    for name, model in TABLES.items():
        text = inserted(text, name, key_table(model))
    return made | {readme: text}


if __name__ == "__main__":
    for path, text in outputs(Path("config")).items():
        storage.write_text(path, text)
