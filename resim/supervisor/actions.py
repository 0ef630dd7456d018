"""What forms do: start a job, and cancel, pause, repeat or reorder tasks. Each gives the address of the page that
comes next."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from starlette.requests import Request

from resim.core.errors import InputError
from resim.jobs.tasks import ACTS, add_task
from resim.results.queue import new_id
from resim.supervisor.forms import FormError, FormField, command_line
from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import MissingError, task_of


def start(supervisor: Supervisor, request: Request) -> str:
    """Put a job in that was filled in."""
    form = supervisor.forms.get(request.path_params["job"])
    if form is None:
        raise MissingError("There is no such job.")
    name = new_id()
    folder = supervisor.settings.tasks / name

    def path_of(given: str, field: FormField) -> Path:
        try:
            return supervisor.path_of(given, field)
        except InputError as e:
            raise FormError(f"{field.name}: {e}") from e

    words = command_line(form, request.state.form, path_of, folder)
    with _told_in_form():
        add_task(supervisor.catalog, folder, form.name, words, again=form.again)
    return f"/tasks/{name}"


def _of_task(supervisor: Supervisor, request: Request) -> str:
    """Do something with a task; where it is too late for that, its page shows how it is now."""
    task = task_of(supervisor, request.path_params["task"])
    act = ACTS.get(request.path_params["act"])
    if act is None:
        raise MissingError("There is no such action.")
    with _told_in_form():
        act(supervisor.queue, task.id)
    return "/tasks" if request.state.form == [("back", "tasks")] else f"/tasks/{task.id}"


@contextmanager
def _told_in_form() -> Iterator[None]:
    """What cannot be put in is told as what is filled in wrongly is."""
    try:
        yield
    except InputError as e:
        raise FormError(str(e)) from e


ACTIONS: Mapping[str, Callable[[Supervisor, Request], str]] = {
    "/jobs/{job}": start,
    "/tasks/{task}/{act}": _of_task,
}
