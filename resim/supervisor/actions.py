"""What forms do: start a job, and cancel, pause, repeat or reorder tasks. Each gives the address of the page that
comes next."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from starlette.requests import Request

from resim.core.errors import InputError
from resim.results.queue import new_id
from resim.supervisor.forms import FormError, FormField, command_line
from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import MissingError, task_of

MOST_WAITING = 10_000
"""Tasks that may wait or pause."""


def start(supervisor: Supervisor, request: Request) -> str:
    """Put a job in that was filled in."""
    form = supervisor.forms.get(request.path_params["job"])
    if form is None:
        raise MissingError("There is no such job.")
    _check_room(supervisor, form.name)
    name = new_id()
    folder = supervisor.settings.tasks / name

    def path_of(given: str, field: FormField) -> Path:
        try:
            return supervisor.path_of(given, field)
        except InputError as e:
            raise FormError(f"{field.name}: {e}") from e

    words = command_line(form, request.state.form, path_of, folder)
    supervisor.queue.add(name, form.name, words, str(folder), form.again)
    return f"/tasks/{name}"


def _check_room(supervisor: Supervisor, what: str) -> None:
    counts = supervisor.queue.counts()
    if counts.get("waiting", 0) + counts.get("paused", 0) >= MOST_WAITING:
        raise FormError(f"{what}: {MOST_WAITING} tasks are waiting already")


def _cancel(supervisor: Supervisor, name: str) -> bool:
    return supervisor.queue.cancel(name)


def _pause(supervisor: Supervisor, name: str) -> bool:
    return supervisor.queue.pause(name)


def _resume(supervisor: Supervisor, name: str) -> bool:
    return supervisor.queue.resume(name)


def _retry(supervisor: Supervisor, name: str) -> bool:
    _check_room(supervisor, name)
    return supervisor.queue.retry(name)


def _first(supervisor: Supervisor, name: str) -> bool:
    highest = max((t.priority for t in supervisor.queue.unfinished() if t.state == "waiting"), default=0)
    return supervisor.queue.prioritise(name, min(highest + 1, 1_000_000))


def _earlier(supervisor: Supervisor, name: str) -> bool:
    return supervisor.queue.move(name, -1)


def _later(supervisor: Supervisor, name: str) -> bool:
    return supervisor.queue.move(name, 1)


_OF_TASKS: Mapping[str, Callable[[Supervisor, str], bool]] = {
    "cancel": _cancel, "pause": _pause, "resume": _resume, "retry": _retry,
    "first": _first, "earlier": _earlier, "later": _later,
}  # fmt: skip


def _of_task(supervisor: Supervisor, request: Request) -> str:
    """Do something with a task; where it is too late for that, its page shows how it is now."""
    task = task_of(supervisor, request.path_params["task"])
    act = _OF_TASKS.get(request.path_params["act"])
    if act is None:
        raise MissingError("There is no such action.")
    act(supervisor, task.id)
    return "/tasks" if request.state.form == [("back", "tasks")] else f"/tasks/{task.id}"


ACTIONS: Mapping[str, Callable[[Supervisor, Request], str]] = {
    "/jobs/{job}": start,
    "/tasks/{task}/{act}": _of_task,
}
