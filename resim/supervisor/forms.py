"""Forms of jobs, as pages show them, and what was filled in as a command line. Who makes them knows the commands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from resim.core.errors import ResimError

FieldKind = Literal["file", "text", "whole", "number", "choice", "flag"]
LONGEST = 300
"""Characters of a text at most."""
MOST = 200
"""Values of one field at most."""


class FormError(ResimError):
    """Something filled in cannot be used."""


@dataclass(frozen=True)
class FormField:
    """One parameter of a job.

    name: of the parameter. option: how the command line names it, such as "--seeds"; "" for an argument. off: of a
    flag what switches it off. kind: what its values are. of: of a file which kind (`resim.results.entry.InputKind`).
    required: whether there must be a value; many: whether there may be several. default: what holds where none is
    given, as text. choices: of a choice. low, high: of a number.
    """

    name: str
    help: str
    kind: FieldKind
    option: str = ""
    off: str = ""
    of: tuple[str, ...] = ()
    required: bool = False
    many: bool = False
    default: str = ""
    choices: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class JobForm:
    """A job that can be started.

    name: in addresses. words: of the command. help: what it does. fields: its parameters. out: option of the folder or
    file for its results, "" for none, and result: what that is called in the folder of its task. again: words that a
    further attempt has besides. kept: whether a further attempt goes on where the one before was stopped.
    """

    name: str
    words: tuple[str, ...]
    help: str
    fields: tuple[FormField, ...]
    out: str = ""
    result: str = ""
    again: tuple[str, ...] = ()
    kept: bool = False


def command_line(
    form: JobForm,
    given: Sequence[tuple[str, str]],
    path_of: Callable[[str, tuple[str, ...]], Path],
    folder: Path,
) -> list[str]:
    """Give the words of the command line that was filled in.

    path_of: gives the path of a registered file by its id and kinds, and raises ResimError where there is none. folder:
    of the task. A value never becomes an option of its own, whatever it begins with. Raises FormError.
    """
    unknown = {name for name, _ in given} - {field.name for field in form.fields}
    if unknown:
        raise FormError(f"{form.name}: there is no parameter {min(unknown)!r:.60}")
    options: list[str] = []
    arguments: list[str] = []
    for field in form.fields:
        values = _values(field, given)
        _check_count(field, values)
        if field.kind == "flag":
            options += _flag(field, values)
            continue
        texts = [_text(field, value, path_of) for value in values]
        if field.option:
            options += [f"{field.option}={text}" for text in texts]
        else:
            arguments += texts
    if form.out:
        options.append(f"{form.out}={folder / form.result}")
    return [*form.words, *options, *(["--", *arguments] if arguments else [])]


def _values(field: FormField, given: Sequence[tuple[str, str]]) -> list[str]:
    """What was filled in: of a field with several texts one in each line."""
    told = [value for name, value in given if name == field.name]
    lines = [line for value in told for line in (value.split("\n") if field.many else [value])]
    return [line.strip() for line in lines if line.strip()]


def _check_count(field: FormField, values: Sequence[str]) -> None:
    if field.required and not values:
        raise FormError(f"{field.name}: is missing")
    if len(values) > (MOST if field.many else 1):
        raise FormError(
            f"{field.name}: has {len(values)} values, at most {MOST if field.many else 1} are taken"
        )


def _flag(field: FormField, values: Iterable[str]) -> list[str]:
    """The word of a flag that is not as it is by default."""
    told = next(iter(values), field.default)
    if told not in ("yes", "no"):
        raise FormError(f"{field.name}: is {told!r:.60}, expected yes or no")
    if told == field.default:
        return []
    return [field.option if told == "yes" else field.off]


def _text(field: FormField, value: str, path_of: Callable[[str, tuple[str, ...]], Path]) -> str:
    if field.kind == "file":
        return str(path_of(value, field.of))
    if len(value) > LONGEST or not value.isprintable():
        raise FormError(f"{field.name}: takes at most {LONGEST} printable characters")
    if field.kind == "choice" and value not in field.choices:
        raise FormError(f"{field.name}: is {value!r:.60}, expected one of {', '.join(field.choices)}")
    if field.kind in ("whole", "number"):
        _check_number(field, value)
    return value


def _check_number(field: FormField, value: str) -> None:
    try:
        number = int(value) if field.kind == "whole" else float(value)
    except ValueError:
        kind = "a whole number" if field.kind == "whole" else "a number"
        raise FormError(f"{field.name}: is {value!r:.60}, expected {kind}") from None
    low, high = field.low, field.high
    if not abs(number) < 1e15 or (low is not None and number < low) or (high is not None and number > high):
        both = (("at least", low), ("at most", high))
        limits = " and ".join(f"{words} {limit:g}" for words, limit in both if limit is not None)
        raise FormError(f"{field.name}: is {value}, expected {limits or 'a finite number'}")
