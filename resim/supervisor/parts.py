"""What all pages work with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from resim.core.errors import InputError
from resim.results.catalog import Catalog
from resim.results.entry import ItemKind
from resim.results.lake import LakeItem, LakeQuery, find_page, items_with
from resim.results.overview import CatalogOverview
from resim.results.queue import TaskQueue
from resim.supervisor.access import Access
from resim.supervisor.audit import AuditTrail
from resim.supervisor.events import Changes
from resim.supervisor.experiments import Experiments
from resim.supervisor.forms import JobForm
from resim.supervisor.growth import SweepsSoFar
from resim.supervisor.guard import Door
from resim.supervisor.worker import Worker


@dataclass(frozen=True)
class SupervisorSettings:
    """What a Supervisor is made of.

    forms: of all jobs that may be started. tasks: folder of the logs and results of tasks. audit: file that tells who
    did what. jobs: tasks at once.
    """

    catalog: Catalog
    forms: tuple[JobForm, ...]
    tasks: Path
    access: Access
    door: Door
    audit: Path
    jobs: int = 1


class Supervisor:
    """What pages read and change: results, tasks, registered files."""

    def __init__(self, settings: SupervisorSettings) -> None:
        self.settings = settings
        self.catalog, self.access = settings.catalog, settings.access
        self.overview = CatalogOverview(settings.catalog)
        self.queue = TaskQueue(settings.catalog)
        self.worker = Worker(self.queue, settings.jobs)
        self.experiments = Experiments(self.catalog, self.queue)
        self.changes = Changes(self)
        self.audit = AuditTrail(settings.audit)
        self.sweeps = SweepsSoFar()

    @cached_property
    def forms(self) -> dict[str, JobForm]:
        """All forms by name."""
        return {form.name: form for form in self.settings.forms}

    def files(self, *kinds: ItemKind, most: int) -> list[LakeItem]:
        """Give the files of this machine that jobs may be given, by name, at most so many."""
        query = LakeQuery(kinds=kinds, host=self.queue.host)
        return [*find_page(self.catalog, query, sort="name", most=most).items]

    def file(self, name: str, kinds: Sequence[str]) -> LakeItem:
        """Give a file of this machine by its id. Raises InputError where there is none of these kinds."""
        found = items_with(self.catalog, [name[:40]])
        if not found or found[0].kind not in kinds or found[0].host != self.queue.host:
            raise InputError(f"{name:.20}", f"is no {' or '.join(kinds)} in a registered folder")
        return found[0]

    def form(self, name: str) -> JobForm:
        """Give a form. Raises InputError where there is none of this name."""
        if name not in self.forms:
            raise InputError(f"{name:.40}", "is no job that can be started here")
        return self.forms[name]
