"""What a script of the workflow gets from its rule: named arguments of the types that it states.

The function `main` of a script takes the rule's inputs, outputs and params by name, and those of
the job's wildcards that it needs. Its annotations say what each becomes. A name that only one of
the two sides knows, and a value of another type, is one `ScriptError` before anything is computed.

A job that makes the same files for several windows or figures calls `main` once for each of them:
`for_each` names the arguments of which the rule gives a list, with one value a call. So the start
of Python and its imports are paid once a job, and `main` still does one thing. Where a call takes
several files of an input, or perhaps none, the param `taken` of the rule says which each takes.
"""

from __future__ import annotations

import gc
import inspect
import signal
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Protocol, TypeVar, Union, get_args, get_origin, get_type_hints

from velocal.errors import ScriptError, VelocalError, reported
from velocal.io import run_lock
from velocal.io.output import check_outputs, stopped_cleanly

#: Params that tell Snakemake when to run a job again; no script takes them.
TRIGGERS = frozenset({"library", "given"})
#: Param that says which files of an input each call of `main` takes: lists of their numbers in the
#: input, by name of the input.
TAKEN = "taken"
#: Params that no `main` takes.
NOT_TAKEN = TRIGGERS | {TAKEN}

_Main = TypeVar("_Main", bound=Callable[..., None])


class Named(Protocol):
    """Part of a job: values by name."""

    def items(self) -> Iterable[tuple[str, Any]]:
        """Pairs of name and value."""
        ...


class Job(Protocol):
    """What Snakemake gives to a script as the global name ``snakemake``."""

    rule: str
    input: Named
    output: Named
    params: Named
    wildcards: Named
    log: Sequence[str]


def for_each(*names: str) -> Callable[[_Main], _Main]:
    """Say which arguments of `main` the rule gives as lists, with one value for each call.

    Parameters
    ----------
    *names : str
        Arguments of `main`; all others are the same in all calls.

    Returns
    -------
    callable
        Decorator of a `main`, which stays as it is otherwise.
    """

    def mark(main: _Main) -> _Main:
        main.__dict__["for_each"] = names
        return main

    return mark


def run(main: Callable[..., None], job: Job) -> None:
    """Call the `main` of a script with what its rule gives.

    An error of the family `VelocalError` becomes its message in the job's log and on standard
    error, and exit code 1. Outputs may replace files, as Snakemake owns the results, but never
    an input of the job.

    Parameters
    ----------
    main : callable
        Takes keyword-only arguments, named as the rule's inputs, outputs and params and as
        wildcards, each with an annotation.
    job : Job
        The object ``snakemake`` of the script.
    """
    # What is imported lives until the end: Python need not visit it to look for garbage, neither
    # while it computes nor when it ends.
    gc.freeze()
    with stopped_cleanly(), reported(job.log[0] if job.log else None):
        run_lock.join()
        check_outputs(_paths(job.output), _paths(job.input))
        try:
            for given in (every := calls(main, job)):
                try:
                    main(**given)
                except VelocalError as error:
                    # The job alone does not say which of its figures, say, the error is about.
                    if len(every) > 1 and error.where is None:
                        error.where = _made_by(main, job, given)
                    raise
        except KeyboardInterrupt:
            raise SystemExit(128 + signal.SIGINT) from None


def _made_by(main: Callable[..., None], job: Job, given: Mapping[str, Any]) -> str:
    """First file that one of several calls makes."""
    outputs = dict(job.output.items())
    return str(next(given[name] for name in main.__dict__["for_each"] if name in outputs))


def _paths(named: Named) -> list[Path]:
    """All files of a job's inputs or outputs."""
    given = [value for _, value in named.items()]
    lists = [[value] if isinstance(value, str) else value for value in given]
    return [Path(path) for paths in lists for path in paths]


def calls(main: Callable[..., None], job: Job) -> list[dict[str, Any]]:
    """Take the arguments of every call of `main` from a job, converted by its annotations.

    Parameters
    ----------
    main : callable
    job : Job

    Returns
    -------
    list of dict of str to object
        One for each value of the arguments that `for_each` names; one alone without it.

    Raises
    ------
    ScriptError
        If the names of the rule and of `main` differ, a value does not fit its annotation, or the
        lists of `for_each` have different lengths.
    """
    parts = {
        "input": dict(job.input.items()),
        "output": dict(job.output.items()),
        "param": {k: v for k, v in job.params.items() if k not in NOT_TAKEN},
    }
    wildcards = dict(job.wildcards.items())
    faults = disagreements(main, parts, wildcards)
    if faults:
        raise ScriptError("; ".join(faults), where=f"rule {job.rule}")
    given = {**wildcards, **parts["input"], **parts["output"], **parts["param"]}
    types = get_type_hints(main)
    separate = main.__dict__.get("for_each", ())
    lists = {name: _listed(given[name], f"rule {job.rule}, {name!r}") for name in separate}
    for name, taken in dict(job.params.items()).get(TAKEN, {}).items():
        files, numbers = lists[name], {number for each in taken for number in each}
        if numbers != set(range(len(files))):
            raise ScriptError(
                f"{len(files)} files of {name!r}, but those taken are {sorted(numbers)}",
                where=f"rule {job.rule}",
            )
        lists[name] = [_alone([files[number] for number in each]) for each in taken]
    lengths = {name: len(values) for name, values in lists.items()}
    if len(set(lengths.values())) > 1:
        raise ScriptError(f"lists of different lengths: {lengths}", where=f"rule {job.rule}")
    found = []
    for number in range(next(iter(lengths.values()), 1)):
        own = given | {name: values[number] for name, values in lists.items()}
        found.append(
            {
                name: convert(own[name], types[name], f"rule {job.rule}, {name!r}")
                for name in inspect.signature(main).parameters
            }
        )
    return found


def _alone(files: list[Any]) -> Any:
    """Take one file alone as itself, as Snakemake does."""
    return files[0] if len(files) == 1 else files


def _listed(value: Any, where: str) -> Sequence[Any]:
    """Take a value as a list; Snakemake gives one file alone as itself."""
    items = [value] if isinstance(value, str) else value
    if not isinstance(items, Sequence):
        raise _misfit(value, "a list", where)
    return items


def disagreements(
    main: Callable[..., None],
    parts: Mapping[str, Collection[str]],
    wildcards: Collection[str],
) -> list[str]:
    """Compare the names of a rule with the arguments of a script.

    Parameters
    ----------
    main : callable
    parts : mapping of str to collection of str
        Names that `main` has to take, by what they are: "input", "output", "param".
    wildcards : collection of str
        Names that `main` may take: they also serve to tell jobs apart.

    Returns
    -------
    list of str
        One sentence per fault; empty if both sides agree.
    """
    faults = []
    takes = inspect.signature(main).parameters
    for name, parameter in takes.items():
        if parameter.kind is not parameter.KEYWORD_ONLY:
            faults.append(f"main takes {name!r} by position, not by name only")
        if parameter.annotation is parameter.empty:
            faults.append(f"main states no type of {name!r}")
    unknown = [name for name in main.__dict__.get("for_each", ()) if name not in takes]
    faults += [f"for_each names {name!r}, which main does not take" for name in unknown]
    kinds = [(name, kind) for kind, names in parts.items() for name in names]
    kinds += [(name, "wildcard") for name in wildcards]
    given: dict[str, str] = {}
    for name, kind in kinds:
        if name in given:
            faults.append(f"{name!r} is both {given[name]} and {kind} of the rule")
        given.setdefault(name, kind)
        if kind != "wildcard" and name not in takes:
            faults.append(f"main does not take the {kind} {name!r} of the rule")
    missing = takes.keys() - given.keys()
    faults += [f"the rule does not give {name!r}, which main takes" for name in missing]
    return sorted(faults)


def convert(value: Any, type_: Any, where: str) -> Any:
    """Convert a value of a job to the type that an annotation states.

    Parameters
    ----------
    value : object
        Path or paths as text, text of a wildcard, or any value of a param.
    type_ : type
        ``Path``, ``str``, ``int``, ``float``, ``bool``, ``Any``; a ``Literal``; a class with the
        class method ``model_validate``; a list, tuple, sequence or mapping of
        these; each of them ``| None``, where no file (an empty list) is None too.
    where : str
        Argument, for errors.

    Returns
    -------
    object

    Raises
    ------
    ScriptError
        If the value does not fit, or the annotation is none of these.
    """
    origin, inner = get_origin(type_), get_args(type_)
    if type_ is Any:
        return value
    if origin is Literal:
        if value not in inner:
            raise _misfit(value, ", ".join(map(str, inner)), where)
        return value
    if origin in (Union, UnionType):
        known = [each for each in inner if each is not NoneType]
        if len(known) != 1:
            raise ScriptError(f"{type_} states more than one type", where=where)
        no_file = isinstance(value, Sequence) and not isinstance(value, str) and not value
        return None if value is None or no_file else convert(value, known[0], where)
    if (origin or type_) in (list, tuple, Sequence):
        of = inner[0] if inner else Any
        converted = [convert(item, of, where) for item in _listed(value, where)]
        return tuple(converted) if origin is tuple else converted
    if (origin or type_) in (dict, Mapping):
        if not isinstance(value, Mapping):
            raise _misfit(value, "a mapping", where)
        of = inner[1] if inner else Any
        return {key: convert(item, of, where) for key, item in value.items()}
    if type_ is Path:
        if not isinstance(value, (str, Path)):
            raise _misfit(value, "one path", where)
        return Path(value)
    if hasattr(type_, "model_validate"):
        try:
            return type_.model_validate(value)
        except ValueError as error:
            raise ScriptError(str(error), where=where) from None
    return _scalar(value, type_, where)


def _scalar(value: Any, type_: Any, where: str) -> Any:
    """Convert to text, a number or a truth value; wildcards are text, so text may be a number."""
    if type_ is str and isinstance(value, str):
        return str(value)
    if type_ is bool and isinstance(value, bool):
        return value
    if type_ in (int, float) and not isinstance(value, bool):
        try:
            number = type_(value)
        except (TypeError, ValueError):
            raise _misfit(value, type_.__name__, where) from None
        if isinstance(value, str) or number == value:
            return number
    raise _misfit(value, getattr(type_, "__name__", str(type_)), where)


def _misfit(value: Any, expected: str, where: str) -> ScriptError:
    return ScriptError(f"{value!r} does not fit", where=where, allowed=expected)
