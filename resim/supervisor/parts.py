"""What all pages work with."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from resim.core.errors import InputError
from resim.results.audit import AuditTrail
from resim.results.catalog import Catalog
from resim.results.entry import KINDS, ItemKind
from resim.results.lake import LakeItem, LakeQuery, find_page, items_with
from resim.results.overview import CatalogOverview
from resim.results.queue import QueuedTask, TaskQueue
from resim.results.scanning import roots_of
from resim.supervisor.access import Access
from resim.supervisor.events import Changes
from resim.supervisor.experiments import Experiments
from resim.supervisor.files import file_id, loose_files
from resim.supervisor.forms import FormField, JobForm
from resim.supervisor.growth import SweepsSoFar
from resim.supervisor.guard import Door
from resim.supervisor.kept import KeptPages
from resim.supervisor.worker import Worker

NOTICED = 0.2
"""s after which a change by another process, or by a task, is seen at the latest."""


@dataclass(frozen=True)
class SupervisorSettings:
    """What a Supervisor is made of.

    forms: of all jobs that may be started. tasks: folder of the logs and results of tasks. audit: file that tells who
    did what. jobs: tasks at once. note: what the first page says while tasks are unfinished.
    """

    catalog: Catalog
    forms: tuple[JobForm, ...]
    tasks: Path
    access: Access
    door: Door
    audit: Path
    jobs: int = 1
    note: str = ""


class Supervisor:
    """What pages read and change: results, tasks, registered files."""

    def __init__(self, settings: SupervisorSettings) -> None:
        self.settings = settings
        self.catalog, self.access = settings.catalog, settings.access
        self.overview = CatalogOverview(settings.catalog)
        self.queue = TaskQueue(settings.catalog)
        self.worker = Worker(self.queue, settings.jobs, self._told)
        self.experiments = Experiments(self.catalog, self.queue)
        self.changes = Changes(self)
        self.audit = AuditTrail(settings.audit)
        self.sweeps = SweepsSoFar()
        self.kept = KeptPages()
        self._version: tuple[float, Hashable] = (-math.inf, None)

    @cached_property
    def forms(self) -> dict[str, JobForm]:
        """All forms by name."""
        return {form.name: form for form in self.settings.forms}

    def version(self) -> Hashable:
        """Give what is another one after every change of what lists show: what others change is seen a moment later."""
        now = time.monotonic()
        looked, found = self._version
        if now > looked + NOTICED:
            found = self.catalog.version(), self.queue.version()
            self._version = now, found
        return found, self.changes.scanned, self.worker.fault

    def look_again(self) -> None:
        """Note that something was changed here: who asks next sees it."""
        self._version = -math.inf, None

    def files(self, *kinds: ItemKind, most: int) -> list[LakeItem]:
        """Give the files of this machine that jobs may be given, by name, at most so many."""
        query = LakeQuery(kinds=kinds, host=self.queue.host)
        return [i for i in find_page(self.catalog, query, sort="name", most=most).items if not i.fault]

    def file(self, name: str, kinds: Sequence[str]) -> LakeItem:
        """Give a file of this machine by its id. Raises InputError where there is none of these kinds."""
        found = items_with(self.catalog, [name[:40]])
        if not found or found[0].kind not in kinds or found[0].host != self.queue.host:
            what = " or ".join(kinds) or "file"
            raise InputError(f"{name:.20}", f"is no {what} in a registered folder")
        if found[0].fault:
            raise InputError(f"{name:.20}", f"cannot be used: {found[0].fault}")
        return found[0]

    def loose_files(self, field: FormField) -> Iterator[Path]:
        """Give the files that the lake does not know and a field takes: in registered folders, or made by tasks."""
        roots = [*roots_of(self.catalog), Path(os.path.realpath(self.settings.tasks))]
        return loose_files(roots, field.patterns)

    def path_of(self, name: str, field: FormField) -> Path:
        """Give what a page means by an id. Raises InputError where it is nothing that a field takes."""
        if field.patterns and (
            found := next((f for f in self.loose_files(field) if file_id(f) == name), None)
        ):
            return found
        item = self.file(name, field.of)
        path = Path(item.folder)
        tasks = os.path.realpath(self.settings.tasks)
        if field.own and not Path(os.path.realpath(path)).is_relative_to(tasks):
            raise InputError(f"{name:.20}", "was made by no task: what it is to be written into is not ours")
        whole = path / field.within if field.within else path
        if not (path / KINDS[item.kind][0] if item.kind in KINDS else whole).exists() or not whole.exists():
            raise InputError(f"{name:.20}", "is not there any more")
        return whole

    def made_by(self, task: QueuedTask) -> Path | None:
        """Give where the result of a task is, or will be, None for one without."""
        form = self.forms.get(task.job)
        return None if form is None else form.result(task.words)

    def _told(self, task: QueuedTask) -> dict[str, str]:
        """What the process of a task has to know of its result."""
        form, made = self.forms.get(task.job), self.made_by(task)
        if form is None or made is None:
            return {}
        told = {"entered": form.entered, "fresh": form.fresh and made.is_relative_to(task.folder)}
        return {name: str(made) for name, is_told in told.items() if is_told}
