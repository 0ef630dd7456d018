"""Forms of jobs, as pages show them, and what was filled in as a command line. Who makes them knows the commands."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from resim.core.errors import ResimError
from resim.supervisor.runner import OWN_FILES

FieldKind = Literal["file", "text", "whole", "number", "choice", "flag", "page", "name"]
"""page: whether a page is written, too; name: what the result is called."""
LONGEST = 300
"""Characters of a text at most."""
MOST = 200
"""Values of one field at most."""
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]{0,59}")
"""Of a result."""


class FormError(ResimError):
    """Something filled in cannot be used."""


@dataclass(frozen=True)
class FormField:
    """One parameter of a job.

    name: of the parameter. option: how the command line names it, such as "--seeds"; "" for an argument. off: of a
    flag what switches it off; of a page the name of its file. kind: what its values are. of: of a file which kinds of
    the lake (`resim.results.entry.ItemKind`). patterns: of a file that the lake does not know how it is called
    (`resim.supervisor.files`). within: of a folder of results the file in it that is meant. own: whether it must be a
    result of a task. required: whether there must be a value; many: whether there may be several; size: of how many
    numbers one consists. default: what holds where none is given, as text. choices: of a choice, beside files. low,
    high: of a number.
    """

    name: str
    help: str
    kind: FieldKind
    option: str = ""
    off: str = ""
    of: tuple[str, ...] = ()
    patterns: tuple[str, ...] = ()
    within: str = ""
    own: bool = False
    required: bool = False
    many: bool = False
    size: int = 1
    default: str = ""
    choices: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None

    @property
    def has_files(self) -> bool:
        """Whether files may be chosen."""
        return bool(self.of or self.patterns)


PathOf = Callable[[str, FormField], Path]
"""Gives the path of a file by the id that a page has of it; raises ResimError where a field takes none such."""


@dataclass(frozen=True)
class JobForm:
    """A job that can be started.

    name: in addresses. words: of the command. help: what it does. fields: its parameters. out: option of the folder or
    file for its results, "" for none, and suffix: of that file, "" for a folder. again: words that a further attempt
    has besides. kept: whether a further attempt goes on where the one before was stopped. entered: whether the result
    is to be registered in the lake, as its command does not do that. group: what jobs it belongs to. fresh: whether the
    command refuses a result that is there already.
    """

    name: str
    words: tuple[str, ...]
    help: str
    fields: tuple[FormField, ...]
    out: str = ""
    suffix: str = ""
    again: tuple[str, ...] = ()
    kept: bool = False
    entered: bool = False
    group: str = ""
    fresh: bool = False

    def result(self, words: Sequence[str]) -> Path | None:
        """Give the folder or file for the results of a command line of this form, None where there is none."""
        begin = f"{self.out}="
        return next((Path(w.removeprefix(begin)) for w in words if self.out and w.startswith(begin)), None)


def command_line(form: JobForm, given: Sequence[tuple[str, str]], path_of: PathOf, folder: Path) -> list[str]:
    """Give the words of the command line that was filled in.

    folder: of the task, in which its results come to lie, called as was filled in, else like the first file that it is
    given. A value never becomes an option of its own, whatever it begins with. Raises FormError.
    """
    unknown = {name for name, _ in given} - {field.name for field in form.fields}
    if unknown:
        raise FormError(f"{form.name}: there is no parameter {min(unknown)!r:.60}")
    options: list[str] = []
    arguments: list[str] = []
    called, paths = "", list[Path]()
    for field in form.fields:
        values = _values(field, given)
        _check_count(field, values)
        if field.kind == "name":
            called = _name(field, values, form.suffix)
        elif field.kind in ("flag", "page"):
            options += _flag(field, values, folder)
        else:
            texts = [_text(field, value, path_of) for value in values]
            if field.kind == "file":
                paths += map(Path, texts)
            if field.size > 1:
                options += [word for text in texts for word in (field.option, *text.split())]
            elif field.option:
                options += [f"{field.option}={text}" for text in texts]
            else:
                arguments += texts
    if form.out:
        options.append(f"{form.out}={folder / f'{called or called_like(paths, form.suffix)}{form.suffix}'}")
    return [*form.words, *options, *(["--", *arguments] if arguments else [])]


def _name(field: FormField, values: Sequence[str], suffix: str) -> str:
    told = next(iter(values), "")
    if told and (not NAME.fullmatch(told) or f"{told}{suffix}" in OWN_FILES):
        signs = "up to 60 letters, digits and _ . + - of which the first is a letter, a digit or _"
        raise FormError(f"{field.name}: is {told!r:.60}, expected another name: {signs}")
    return told


def called_like(paths: Sequence[Path], suffix: str) -> str:
    """Give the name of a result, without its suffix: that of the first file that it is made of, "result" of none."""
    stem = next((path.name.removesuffix(".json").removesuffix(".jscen") for path in paths), "")
    stem = re.sub(r"\.(toml|xodr|csv|parquet|xml|xosc|osi|mcap)$", "", stem)
    told = re.sub(r"[^A-Za-z0-9_.+-]", "_", stem)[:60].lstrip(".+-")
    return told if told and f"{told}{suffix}" not in OWN_FILES else "result"


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


def _flag(field: FormField, values: Iterable[str], folder: Path) -> list[str]:
    """The word of a flag that is not as it is by default; of a page where it is written."""
    told = next(iter(values), field.default)
    if told not in ("yes", "no"):
        raise FormError(f"{field.name}: is {told!r:.60}, expected yes or no")
    if told == field.default:
        return []
    if field.kind == "page":
        return [f"{field.option}={folder / field.off}"]
    return [field.option if told == "yes" else field.off]


def _text(field: FormField, value: str, path_of: PathOf) -> str:
    if field.has_files and value not in field.choices:
        return str(path_of(value, field))
    if len(value) > LONGEST or not value.isprintable():
        raise FormError(f"{field.name}: takes at most {LONGEST} printable characters")
    if field.kind == "choice" and value not in field.choices:
        raise FormError(f"{field.name}: is {value!r:.60}, expected one of {', '.join(field.choices)}")
    if field.kind in ("whole", "number"):
        numbers = value.split() if field.size > 1 else [value]
        if len(numbers) != field.size:
            raise FormError(f"{field.name}: is {value!r:.60}, expected {field.size} numbers")
        for number in numbers:
            _check_number(field, number)
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
