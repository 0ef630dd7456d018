"""Parameters of commands: how the command line names them, and what of them has to be said to do the same again."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import typer
from typer.models import ArgumentInfo

from resim.cli.terminal import say
from resim.core.errors import InputError

if TYPE_CHECKING:
    from resim.results.asked import AskedValue

Job = Callable[..., None]
WITHOUT_EFFECT: Mapping[str, str] = {
    "out": "where results go",
    "workers": "results are the same for any number",
    "scheduler": "results are the same on any machines",
    "shard": "all shards together are one result",
    "resume": "what is done is not done again",
    "gui": "shows the simulation besides",
    "dry_run": "makes no results",
    "replay": "makes no results",
}
"""Parameters that change nothing in results, and why."""
FILES_OR_WORDS = ("traffic", "prediction")
"""Texts that may be the path of a file."""


def option_of(info: Any, name: str, *, is_flag: bool) -> tuple[str, str]:
    """Give how the command line names a parameter, and what switches it off, "" where nothing does."""
    if isinstance(info, ArgumentInfo):
        return "", ""
    words = [
        w for w in (info.default, *(info.param_decls or ())) if isinstance(w, str) and w.startswith("--")
    ]
    option = words[0].partition("/")[0] if words else f"--{name.replace('_', '-')}"
    return option, f"--no-{option.removeprefix('--')}" if is_flag and not words else ""


def values_of(job: Job, given: Mapping[str, Any]) -> Iterator[AskedValue]:
    """Give what has to be said to call a command again as it was called: all that is not as it is by default.

    Raises InputError or OSError for a file that cannot be read.
    """
    for parameter in inspect.signature(job, eval_str=True).parameters.values():
        name, value = parameter.name, given[parameter.name]
        if name in WITHOUT_EFFECT or value == parameter.default or value in (None, [], ()):
            continue
        info = get_args(parameter.annotation)[1]
        option, off = option_of(info, name, is_flag=isinstance(value, bool))
        yield from _values(name, value, option, off)


def _values(name: str, value: Any, option: str, off: str) -> Iterator[AskedValue]:
    from resim.results.asked import AskedValue, content_of

    if isinstance(value, bool):
        yield AskedValue(option if value else off)
        return
    for text, is_path in texts_of(name, value):
        yield AskedValue(option, text, content_of(Path(text)) if is_path else "")


def texts_of(name: str, value: Any) -> Iterator[tuple[str, bool]]:
    """Give the texts of a parameter's value, one of each where it has several, and whether each is a path."""
    for one in value if isinstance(value, list | tuple) else (value,):
        text = str(one.value) if isinstance(one, Enum) else str(one)
        yield text, isinstance(one, Path) or (name in FILES_OR_WORDS and Path(text).is_file())


@contextmanager
def noted(job: Job, given: Mapping[str, Any], context: typer.Context) -> Iterator[None]:
    """Write down beside the results of a command how it was called, whatever its verdict is."""
    out = given.get("out")
    if not isinstance(out, Path):
        yield
        return
    before, inputs = {*_stamps({"out": out})}, [*_stamps(given, without=out)]
    try:
        yield
    finally:
        if new := {*_stamps({"out": out})} - before:
            same = [*_stamps(given, without=out)] == inputs  # else nobody knows what it was made of
            _note(job, given, _command(context), out, {name for name, _ in new} if same else set())


def _note(job: Job, given: Mapping[str, Any], words: tuple[str, ...], out: Path, new: set[Path]) -> None:
    """Write it down where what is new in the folder are results."""
    from resim.results.asked import AskedResults, mark_of, write_asked

    if mark_of(out) not in new:
        return
    try:
        write_asked(AskedResults(words, tuple(values_of(job, given))), out)
    except (InputError, OSError) as e:
        say(f"resim: warning: how to make {out} again could not be written down: {e}", err=True)


def _command(context: typer.Context) -> tuple[str, ...]:
    """The words of the command that is called, after `resim`."""
    words, at = list[str](), context
    while at.parent is not None:
        words.insert(0, str(at.info_name))
        at = at.parent  # type: ignore[assignment]
    return tuple(words)


def _stamps(given: Mapping[str, Any], without: Path | None = None) -> Iterator[tuple[Path, object]]:
    """By what a change is noticed of the files that a command is given, and of those in its folders."""
    values: Iterable[Any] = (one for v in given.values() for one in (v if isinstance(v, list) else [v]))
    for path in (one for one in values if isinstance(one, Path) and one != without):
        with suppress(OSError):  # of what cannot be read the command itself tells
            for file in sorted(path.glob("*")) if path.is_dir() else [path]:
                stat = file.stat() if file.is_file() else None
                yield file, stat and (stat.st_mtime_ns, stat.st_size, stat.st_ino)
