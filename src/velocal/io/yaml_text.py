"""YAML from outside: plain data only, bounded in size, with the line of every fault."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from velocal.errors import VelocalError

#: Values of a file after its aliases are replaced, and depth of lists and keys in one another.
MOST_VALUES, DEEPEST = 100_000, 50
LARGEST_BYTES = 20_000_000
#: The same safe loader, in C where libyaml is there: ten times as fast.
_SAFE: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
#: What a loader raises for values such as ``!!int ""``, besides its own errors.
_FAULTS = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError)


def read_yaml(path: Path, error: type[VelocalError], *, unique_keys: bool = True) -> Any:
    """Read a YAML file.

    Parameters
    ----------
    path : Path
    error : type of VelocalError
        Class of the errors.
    unique_keys : bool
        Whether a key that occurs twice is an error; else the last one counts.

    Returns
    -------
    dict, list, str, int, float, bool, date or None

    Raises
    ------
    VelocalError
        Of the class `error`, see `parse_yaml`; also if the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except (OSError, ValueError) as fault:
        reason = fault.strerror if isinstance(fault, OSError) else str(fault)
        raise error(f"cannot be read: {reason}", where=str(path)) from None
    return parse_yaml(data, str(path), error, unique_keys=unique_keys)


def parse_yaml(
    data: bytes, where: str, error: type[VelocalError], *, unique_keys: bool = True
) -> Any:
    """Parse YAML without tags of programs, bounded in size.

    Parameters
    ----------
    data : bytes
        UTF-8.
    where : str
        File, for errors.
    error : type of VelocalError
        Class of the errors.
    unique_keys : bool
        Whether a key that occurs twice is an error; else the last one counts.

    Returns
    -------
    dict, list, str, int, float, bool, date or None

    Raises
    ------
    VelocalError
        Of the class `error`: if the text is no YAML, a value cannot be read, a key occurs twice,
        or aliases contain one another or make more than `MOST_VALUES` values.
    """
    if len(data) > LARGEST_BYTES:
        raise error(
            "the file is too large", where=where, allowed=f"up to {LARGEST_BYTES // 10**6} MB"
        )
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        line = data[: fault.start].count(b"\n") + 1
        raise error(
            f"is not YAML: the byte 0x{data[fault.start]:02x} is not UTF-8 text",
            where=f"{where}, line {line}",
            hint="Save the file as UTF-8.",
        ) from None
    if control := re.search(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]", text):
        line = text[: control.start()].count("\n") + 1
        raise error(
            f"is not YAML: the line holds the control character U+{ord(control[0]):04X}",
            where=f"{where}, line {line}",
            hint="Delete it.",
        )
    node = None
    try:
        _check_events(text, where, error, unique_keys)
        loader = _SAFE(text)
        try:
            node = loader.get_single_node()
            return None if node is None else loader.construct_document(node)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as fault:
        mark = fault.problem_mark or fault.context_mark
        lines = text.splitlines()
        bad_line = lines[mark.line] if mark and mark.line < len(lines) else ""
        tab = "\t" in bad_line[: len(bad_line) - len(bad_line.lstrip())]
        hint = "Values with a colon, a brace or a special first character need quotes."
        if tab:
            hint = "Indent with spaces, not with tabs."
        elif isinstance(fault, yaml.constructor.ConstructorError):
            hint = "Write the value plainly, without a tag (!!...)."
        raise error(
            f"is not YAML: {fault.problem or fault.context}",
            where=f"{where}, line {mark.line + 1}" if mark else where,
            hint=hint,
        ) from None
    except yaml.YAMLError as fault:
        reason = str(fault).splitlines()[0]
        raise error(f"is not YAML: {reason}", where=where) from None
    except _FAULTS:
        bad = next(_unreadable(node), None)
        at = f"{where}, line {bad.start_mark.line + 1}" if bad else where
        shown = f"the value {bad.value[:40]!r}" if bad else "a value"
        raise error(
            f"is not YAML: {shown} cannot be read as {_kind(bad)}",
            where=at,
            hint="Write the value plainly, or text in quotes.",
        ) from None


def _kind(node: Any) -> str:
    return str(node.tag).rsplit(":", 1)[-1] if node else "what it says to be"


def _unreadable(node: Any) -> Iterator[Any]:
    """Scalars that the loader cannot convert."""
    if isinstance(node, yaml.ScalarNode):
        try:
            yaml.SafeLoader("").construct_object(node)
        except Exception:  # whatever the loader meets is what is looked for
            yield node
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            yield from _unreadable(item)
    elif isinstance(node, yaml.MappingNode):
        for pair in node.value:
            for item in pair:
                yield from _unreadable(item)


@dataclass
class _Open:
    """A list or a mapping whose end has not come yet."""

    anchor: str | None
    mapping: bool
    values: int = 1
    items: int = 0
    keys: set[str] = field(default_factory=set)


def _check_events(text: str, where: str, error: type[VelocalError], unique_keys: bool) -> None:
    """Check the size that aliases make, the depth and the keys, before anything is built."""
    open_: list[_Open] = [_Open(None, mapping=False)]
    sizes: dict[str, int] = {}

    def at(event: Any) -> str:
        return f"{where}, line {event.start_mark.line + 1}"

    def add(size: int, event: Any) -> None:
        open_[-1].values += size
        open_[-1].items += 1
        if sum(part.values for part in open_) > MOST_VALUES:
            raise error(
                "holds too many values",
                where=at(event),
                allowed=f"up to {MOST_VALUES}, with the content of aliases",
                hint="Aliases (*name) that hold aliases multiply: write the values out.",
            )

    for event in yaml.parse(text, Loader=_SAFE):
        if isinstance(event, yaml.CollectionStartEvent):
            mapping = isinstance(event, yaml.MappingStartEvent)
            open_.append(_Open(event.anchor, mapping))
            if len(open_) > DEEPEST:
                raise error(
                    "is not YAML that can be read: lists and keys lie too deep in one another",
                    where=at(event),
                    allowed=f"{DEEPEST} levels",
                )
        elif isinstance(event, yaml.CollectionEndEvent):
            done = open_.pop()
            if done.anchor:
                sizes[done.anchor] = done.values
            add(done.values, event)
        elif isinstance(event, yaml.AliasEvent):
            if any(part.anchor == event.anchor for part in open_):
                raise error(f"the alias *{event.anchor} contains itself", where=at(event))
            add(sizes.get(str(event.anchor), 1), event)
        elif isinstance(event, yaml.ScalarEvent):
            inside = open_[-1]
            if unique_keys and inside.mapping and inside.items % 2 == 0 and event.value != "<<":
                if event.value in inside.keys:
                    raise error(
                        f"the key {event.value!r} occurs twice",
                        where=at(event),
                        hint="Only one of them would count: delete the other.",
                    )
                inside.keys.add(event.value)
            if event.anchor:
                sizes[event.anchor] = 1
            add(1, event)
