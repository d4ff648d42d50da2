"""What all models of the configuration share: strict types, units in names, errors that help.

A model is a pydantic model that is frozen and knows no keys but its own. Every fault that pydantic
finds becomes one `ConfigError` with the file, the key, the value, what is allowed, and a hint.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from velocal.errors import ConfigError, hidden
from velocal.scanner.models import SCANNERS

#: Type of the errors that `fault` makes.
_FAULT = "velocal"
#: What stands for the folder of the results in paths of survey files and of sample tables.
RESULTS_FOLDER = "{results}"
#: No quantity of a study is larger than this, and none but zero is smaller than its inverse.
LARGEST = 1e12
#: Longest text; number of values with the content of YAML aliases, and depth of keys.
LONGEST, MOST_VALUES, DEEPEST = 1000, 100_000, 50
_Model = TypeVar("_Model", bound=BaseModel)


class Section(BaseModel):
    """A part of a configuration: frozen, strict about types, without unknown keys.

    Numbers must be finite. A truth value is not a number, and a number is not text.
    """

    # A job of the workflow imports many models and uses one or two of them.
    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True
    )

    @model_validator(mode="before")
    @classmethod
    def _only_known_keys(cls, content: Any) -> Any:
        """Refuse an unknown key, and name the one that was probably meant."""
        if isinstance(content, Mapping):
            known = [field.alias or name for name, field in cls.model_fields.items()]
            for key in content:
                if key not in known:
                    raise fault("unknown key", key=str(key), allowed=known, hint=near(key, known))
        return content

    def plain(self) -> dict[str, Any]:
        """Content as plain dictionaries, lists, numbers and texts, in the order of the model."""
        return self.model_dump(mode="json", by_alias=True)


def fault(
    what: str,
    *,
    key: str = "",
    allowed: Iterable[object] = (),
    hint: str | None = None,
) -> PydanticCustomError:
    """Make an error for a validator to raise.

    Parameters
    ----------
    what : str
        What is wrong, with the offending value.
    key : str
        Key below the validated part, if one is to blame.
    allowed : iterable
        What would have been right.
    hint : str, optional
        What to do about it.

    Returns
    -------
    PydanticCustomError
    """
    facts = {"what": what, "key": key, "allowed": ", ".join(map(str, allowed)), "hint": hint}
    return PydanticCustomError(_FAULT, "{what}", facts)


def near(name: object, known: Iterable[str]) -> str | None:
    """Ask whether the known name that is most like a name was meant; None if none is like it."""
    found = difflib.get_close_matches(str(name), list(known), n=1)
    return f"Did you mean {found[0]!r}?" if found else None


def known_as(what: str, names: Iterable[str]) -> AfterValidator:
    """Validator of a text that must be one of some names, which errors call `what`."""
    allowed = list(names)

    def check(value: str) -> str:
        if value not in allowed:
            raise fault(f"unknown {what} {value!r}", allowed=allowed, hint=near(value, allowed))
        return value

    return AfterValidator(check)


def enum(names: Iterable[str]) -> Any:
    """Names that the JSON schema offers for a text."""
    return Field(json_schema_extra={"enum": list(names)})


@dataclass(frozen=True)
class Placeholder:
    """How the table of keys writes a key that the user chooses, as ``{sample}``."""

    text: str


#: Pattern of names that become parts of paths.
NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"
Name = Annotated[str, Field(pattern=NAME)]
Text = Annotated[str, Field(min_length=1)]
Names = Annotated[tuple[Name, ...], Field(min_length=1, strict=False)]
Texts = Annotated[tuple[Text, ...], Field(min_length=1, strict=False)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]
AcuteAngle = Annotated[float, Field(gt=0, lt=90)]
ScannerName = Annotated[
    str, known_as("scanner", SCANNERS), enum(SCANNERS), Placeholder("{scanner}")
]


def _rising(span: tuple[float, float]) -> tuple[float, float]:
    """Put the smaller number first."""
    if span[0] == span[1]:
        raise fault(
            f"the interval from {span[0]:g} to {span[1]:g} is empty", hint="Give two numbers."
        )
    return min(span), max(span)


Pair = Annotated[tuple[float, float], Field(strict=False)]
#: From and to.
Span = Annotated[tuple[float, float], Field(strict=False), AfterValidator(_rising)]


def validated(model: type[_Model], content: object, where: str) -> _Model:
    """Build a model from the content of a file.

    Parameters
    ----------
    model : type of BaseModel
    content : object
        Plain dictionaries, lists, numbers and texts.
    where : str
        How to call the file in errors.

    Returns
    -------
    BaseModel
        An instance of `model`.

    Raises
    ------
    ConfigError
        For the first fault, with its key and what is allowed; unknown keys come first.
    """
    _Walk(where).check(content)
    try:
        return model.model_validate(content)
    except ValidationError as error:
        faults = error.errors(include_url=False)
        first = min(faults, key=lambda each: each.get("ctx", {}).get("what") != "unknown key")
        raise _translated(first, model, where) from None


@dataclass
class _Walk:
    """Walk through the content of a file, which may contain itself through YAML aliases."""

    where: str
    values: int = 0

    def check(self, value: object, place: str = "") -> None:
        """Refuse what no part of a study can mean; JSON and pydantic would convert or miss it.

        Raises
        ------
        ConfigError
        """
        self.values += 1
        if self.values > MOST_VALUES or place.count(".") > DEEPEST:
            raise ConfigError(
                "holds too many values",
                where=self.where,
                allowed=f"up to {MOST_VALUES}, with the content of aliases",
                hint="Write the values out instead of YAML aliases (*name).",
            )
        if isinstance(value, Mapping):
            for key, inner in value.items():
                if not isinstance(key, str):
                    raise ConfigError(
                        f"{place or 'the file'}: the key {key!r} is not text",
                        where=self.where,
                        allowed="keys that are texts",
                        hint='Write it in quotes, with all its digits: "2", "05".',
                    )
                self._text(key, place or "the file", "the key ")
                self.check(inner, f"{place}.{key}".lstrip("."))
        elif isinstance(value, list | tuple):
            for number, inner in enumerate(value):
                self.check(inner, f"{place}.{number}".lstrip("."))
        elif isinstance(value, str):
            self._text(value, place)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            self._number(value, place)

    def _number(self, value: float, place: str) -> None:
        finite = isinstance(value, int) or math.isfinite(value)
        if finite and (value == 0 or 1 / LARGEST <= abs(value) <= LARGEST):
            return
        if isinstance(value, int) and abs(value) > LARGEST:  # Python writes no huge numbers
            said = f"a whole number of {math.floor(math.log10(abs(value))) + 1} digits"
        else:
            said = f"{value!r}" if finite else f"{value!r} is not finite"
        raise ConfigError(
            f"{place}: {said}" if place else said,
            where=self.where,
            allowed="a finite number"
            if not finite
            else f"0, or a size from {1 / LARGEST:g} to {LARGEST:g}",
        )

    def _text(self, value: str, place: str, what: str = "") -> None:
        told, allowed, hint = "", "", None
        of_survey = place.startswith("survey.")
        if len(value) > LONGEST:
            told, allowed = f"a text of {len(value)} characters", f"up to {LONGEST}"
        elif code := hidden(value):
            told = f"{value!r} holds {code}, a character that cannot be seen"
            allowed = "text in one line"
        elif re.search("[{}]", value.replace(RESULTS_FOLDER, "") if of_survey else value):
            told = f"{value!r} holds a brace"
            allowed = f"no braces, except {RESULTS_FOLDER} in paths of survey files and of sample "
            allowed += "tables"
            hint = "Snakemake takes a name in braces as a wildcard. Choose another name."
        if told:
            place = f"{place}: " if place else ""
            raise ConfigError(f"{place}{what}{told}", where=self.where, allowed=allowed, hint=hint)


def _translated(error: ErrorDetails, model: type[BaseModel], where: str) -> ConfigError:
    """Say what pydantic found in the words of the configuration."""
    facts = error.get("ctx", {})
    keys, field = _walk(model, error["loc"])
    of_key = error["loc"][-1:] == ("[key]",)
    place, value = ".".join(keys), error["input"]
    hint = field.description if field else None
    kind, allowed = error["type"], error["msg"].removeprefix("Input should be ")
    if kind == _FAULT:
        what, allowed = facts["what"], facts["allowed"]
        parts = [*(keys[:-1] if of_key else keys), *filter(None, [facts["key"]])]
        place = ".".join(parts)
        if what == "unknown key":
            return ConfigError(
                f"unknown key {place!r}", where=where, allowed=allowed, hint=facts["hint"]
            )
        what = f"{place}: {what}" if place else what
        return ConfigError(what, where=where, allowed=allowed or None, hint=facts["hint"] or hint)
    if kind == "missing":
        return ConfigError(f"key {place!r} is missing", where=where, hint=hint)
    if "discriminator" in facts:
        place = f"{place}.{facts['discriminator'].strip(chr(39))}"
        if kind == "union_tag_not_found":
            return ConfigError(f"key {place!r} is missing", where=where, hint=hint)
        value, allowed = facts["tag"], facts["expected_tags"]
    if kind in ("literal_error", "union_tag_invalid"):
        allowed = ", ".join(re.findall(r"'([^']*)'", facts.get("expected", allowed)))
    if kind == "string_pattern_mismatch":
        of_name = facts["pattern"] == NAME
        allowed = "letters, digits, _ and -" if of_name else f"names like {facts['pattern']}"
    if of_key:
        return ConfigError(f"unknown key {place!r}", where=where, allowed=allowed, hint=hint)
    if kind == "string_type" and isinstance(value, int | float):
        hint = "Write it in quotes."
    if kind in ("float_type", "float_parsing") and re.fullmatch(r"-?[0-9]+,[0-9]+", str(value)):
        hint = "Write a point before the decimals."
    elif kind in ("float_type", "int_type") and re.fullmatch(r"-?[0-9.]+", str(value)):
        hint = "Write it without quotes."
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        allowed = "keys with values"
    if kind in ("string_too_short", "too_short"):
        allowed = "one or more" if kind == "too_short" else "a text"
    if kind == "int_parsing":
        allowed = "a whole number"
    said = f"{value!r} is not a name" if kind == "string_pattern_mismatch" else repr(value)
    if kind == "finite_number" or (isinstance(value, float) and not math.isfinite(value)):
        said, allowed = f"{value!r} is not finite", "a finite number"
    return ConfigError(
        f"{place}: {said}" if place else said, where=where, allowed=allowed, hint=hint
    )


def _walk(model: type[BaseModel], loc: tuple[int | str, ...]) -> tuple[list[str], FieldInfo | None]:
    """Keys of the file at an error's place, and the field there.

    The place that pydantic states also holds the tags of unions, which are no keys.
    """
    keys: list[str] = []
    field: FieldInfo | None = None
    types: list[Any] = [model]
    for item in loc:
        if item == "[key]":
            break
        inside = list(_inside(types, item))
        if inside:
            keys.append(str(item))
            types = [kind for kind, _ in inside]
            field = inside[0][1] or field
    return keys, field


def _inside(types: Iterable[Any], item: int | str) -> Iterator[tuple[Any, FieldInfo | None]]:
    """Type and field of what lies at a key or an index within any of some types."""
    for kind in types:
        origin, parts = get_origin(kind), get_args(kind)
        if origin is Annotated:
            yield from _inside(parts[:1], item)
        elif origin in (Union, UnionType):
            yield from _inside(parts, item)
        elif origin is dict:
            yield parts[1], None
        elif origin is tuple and isinstance(item, int):
            yield parts[0], None
        elif isinstance(kind, type) and issubclass(kind, BaseModel):
            for name, field in kind.model_fields.items():
                if item == (field.alias or name):
                    yield field.annotation, field
