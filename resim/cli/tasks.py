"""`resim tasks`: the queue of the Supervisor, in the terminal."""

from __future__ import annotations

import shlex
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app, command
from resim.cli.terminal import add_to_json, say, visible
from resim.core.errors import InputError

if TYPE_CHECKING:
    from resim.results.queue import QueuedTask

tasks = typer.Typer(
    help="Tasks of the Supervisor (`resim serve`): add, list, cancel, pause, repeat or reorder them, and see logs.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(tasks, name="tasks")
SHORT = 6
"""Digits of an id that are shown."""


class Priority(StrEnum):
    """As `resim.results.queue.PRIORITIES`."""

    HIGH = "high"
    NORMAL = "normal"
    LOW = "low"


Task = Annotated[str, typer.Argument(metavar="ID", help="Id of the task, or its first four or more digits.")]


@command(tasks, "list")
def list_(
    ended: Annotated[int, typer.Option(min=0, max=100_000, help="Tasks at most of those that ended.")] = 20,
) -> None:
    """List tasks: those that pause, run and wait, in their order, then those that ended, the latest first."""
    from resim.jobs.lake import the_catalog
    from resim.jobs.tasks import list_tasks

    found = list_tasks(the_catalog(), ended=ended)
    add_to_json(tasks=[_told(one) for one in found])
    for one in found:
        say(_line(one))
    if not found:
        say("no tasks; `resim tasks add` and the pages of `resim serve` put some in")


@command(tasks, context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False})
def add(
    words: Annotated[
        list[str],
        typer.Argument(metavar="COMMAND...", help="As it is called here, without `resim` before it."),
    ],
    priority: Annotated[Priority, typer.Option(help="Tasks of a higher one come first.")] = Priority.NORMAL,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--tasks", help="Folder for logs and results of tasks; default: tasks in the user's data folder."
        ),
    ] = None,
) -> None:
    """Put a command into the queue, for `resim serve` on this machine: `resim tasks add run DRIVE --build BUILD`.

    Results go where the command says, else into the task's folder.
    """
    from resim.cli.task_calls import task_call
    from resim.jobs.lake import the_catalog
    from resim.jobs.tasks import add_task
    from resim.results.audit import noted_command
    from resim.results.database import data_folder
    from resim.results.queue import new_id

    name = new_id()
    home = (folder or data_folder() / "tasks").absolute() / name
    form, call = task_call(words, home)
    told = [("command", shlex.join(call)), ("priority", priority.value)]
    with noted_command(f"/jobs/{form.name}", told):
        added = add_task(the_catalog(), home, form.name, call, again=form.again, priority=priority.value)
    add_to_json(**_told(added))
    say(_line(added))


@command(tasks)
def log(task: Task) -> None:
    """Print the log of a task, as far as it is written."""
    from resim.jobs.lake import the_catalog
    from resim.jobs.tasks import read_task_log

    text = read_task_log(the_catalog(), task)
    add_to_json(log=text)
    for line in text.splitlines():
        say(visible(line))


@command(tasks)
def cancel(task: Task) -> None:
    """End a task that waits or pauses, and stop one that runs."""
    _steer(task, "cancel", "has ended already")


@command(tasks)
def pause(task: Task) -> None:
    """Let a task wait until it is resumed; one that runs is stopped, and keeps what it can resume."""
    _steer(task, "pause", "neither waits nor runs")


@command(tasks)
def resume(task: Task) -> None:
    """Let a paused task wait again, at its place."""
    _steer(task, "resume", "is not paused")


@command(tasks)
def retry(task: Task) -> None:
    """Let a task that ended wait again, behind all others."""
    _steer(task, "retry", "has not ended")


@command(tasks)
def first(task: Task) -> None:
    """Let a task that waits come before all others."""
    _steer(task, "first", "does not wait")


@command(tasks)
def priority(
    task: Task, level: Annotated[Priority, typer.Argument(help="Tasks of a higher one come first.")]
) -> None:
    """Give a task that waits or pauses another priority."""
    _steer(task, level.value, "neither waits nor pauses")


@command(tasks)
def earlier(task: Task) -> None:
    """Let a task that waits change places with the one before."""
    _steer(task, "earlier", "does not wait, or is the first one")


@command(tasks)
def later(task: Task) -> None:
    """Let a task that waits change places with the one behind."""
    _steer(task, "later", "does not wait, or is the last one")


def _steer(task: str, act: str, too_late: str) -> None:
    from resim.jobs.lake import the_catalog
    from resim.jobs.tasks import steer_task
    from resim.results.audit import noted_command
    from resim.results.queue import TaskQueue

    catalog = the_catalog()
    name = TaskQueue(catalog).find(task)
    with noted_command(f"/tasks/{name}/{act}"):
        found, done = steer_task(catalog, name, act)
        if not done:
            raise InputError(task, f"{too_late}: it is {found.state}", "`resim tasks list` shows all.")
    add_to_json(**_told(found))
    say(_line(found))


def _told(one: QueuedTask) -> dict[str, object]:
    return {
        "id": one.id, "job": one.job, "state": _state(one), "command": [*one.call], "folder": one.folder,
        "host": one.host, "priority": one.urgency, "attempt": one.attempt, "code": one.code, "told": one.told,
    }  # fmt: skip


def _line(one: QueuedTask) -> str:
    names = " ".join(word.rsplit("/", 1)[-1] for word in one.words if word.startswith("/"))
    why = f": {one.told}" if one.told and one.state in ("failed", "lost", "bad") else ""
    urgency = f", {one.urgency} priority" if one.priority and one.state in ("waiting", "paused") else ""
    return visible(f"{one.id[:SHORT]} {one.job} {names}: {_state(one)}{urgency}{why}".replace(" :", ":"))


def _state(one: QueuedTask) -> str:
    return "pausing" if one.is_pausing else "stopping" if one.stop and one.state == "running" else one.state
