"""A call of the command line as a task makes it: which job it is, and its words with whole paths.

A task is done elsewhere and later than it is put in, so nothing of its words hangs on the folder where that was.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import typer.main

from resim.cli.app import app
from resim.cli.job_forms import job_forms
from resim.cli.parameters import texts_of
from resim.core.errors import InputError
from resim.supervisor.forms import JobForm, called_like


def task_call(words: Sequence[str], folder: Path) -> tuple[JobForm, list[str]]:
    """Give the form of the job that a command line (its words after `resim`) is, and the words that a task calls.

    folder: of the task, into which results go that the words send nowhere. Raises InputError for what is no job of the
    Supervisor, and what the command itself raises for words that it does not take.
    """
    form = _form_of(words)
    path = _path(form)
    given = list(words[len(path) :])
    is_ours = bool(form.out) and not _has(given, form.out)
    if is_ours:
        given.insert(0, f"{form.out}={folder / 'result'}{form.suffix}")
    command: Any = typer.main.get_command(app)
    for word in path:
        command = command.commands[word]
    with command.make_context(" ".join(("resim", *path)), given) as context:
        options = [w for p in command.params if not _is_argument(p) for w in _words(context, p)]
        arguments = [w for p in command.params if _is_argument(p) for w in _texts(context, p)]
    if is_ours:
        at = next(k for k, option in enumerate(options) if option.startswith(f"{form.out}="))
        options[at] = f"{form.out}={folder / _called((*options[:at], *options[at + 1 :]), arguments, form)}"
    return form, [*path, *options, *(["--", *arguments] if arguments else [])]


def _called(options: Sequence[str], arguments: Sequence[str], form: JobForm) -> str:
    """The name of a result as forms give it: like the first file that the command is given."""
    told = (*arguments, *(option.partition("=")[2] for option in options))
    return called_like([Path(text) for text in told if text.startswith("/")], form.suffix) + form.suffix


def _form_of(words: Sequence[str]) -> JobForm:
    """The form with the most of the first words; of several the one whose own option is among the others."""
    found = [f for f in job_forms() if _path(f) == [*words[: len(_path(f))]] and {*f.words} <= {*words}]
    found = [form for form in found if len(form.words) == max(len(f.words) for f in found)]
    if not found:
        known = sorted({" ".join(form.words) for form in job_forms()})
        raise InputError(" ".join(words[:2]), "is no job of tasks", f"Known: {', '.join(known)}.")
    known_to_first = {found[0].out, *(field.option for field in found[0].fields)}
    for form in found[1:]:
        own = {form.out, *(field.option for field in form.fields if field.required)} - known_to_first
        if any(_has(words, option) for option in own if option):
            return form
    return found[0]


def _path(form: JobForm) -> list[str]:
    """Its words without options, which may stand anywhere behind."""
    return [word for word in form.words if not word.startswith("--")]


def _has(words: Sequence[str], option: str) -> bool:
    return any(word.partition("=")[0] == option for word in words)


def _is_argument(parameter: Any) -> bool:
    return bool(parameter.param_type_name == "argument")


def _words(context: Any, option: Any) -> Iterator[str]:
    """The words of an option that was given."""
    name, texts = option.opts[0], _texts(context, option)
    if option.is_flag:
        yield from (name if text == "True" else option.secondary_opts[0] for text in texts)
    elif option.nargs > 1:
        for at in range(0, len(texts), option.nargs):
            yield from (name, *texts[at : at + option.nargs])
    else:
        yield from (f"{name}={text}" for text in texts)


def _texts(context: Any, parameter: Any) -> list[str]:
    """The values of a parameter that was given, one after the other; [] of one that was not."""
    if context.get_parameter_source(parameter.name).name != "COMMANDLINE":
        return []
    value = context.params[parameter.name]
    several = (
        value if isinstance(value, list | tuple) else (value,)
    )  # of an option with two numbers each is a tuple
    told = (pair for one in several for pair in texts_of(parameter.name, one))
    return [str(Path(text).absolute()) if is_path else text for text, is_path in told]
