"""The pages: which template, and what it is told. What they show is read elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from starlette.requests import Request

from resim.supervisor.parts import Supervisor
from resim.supervisor.views import builds, dashboard, experiments, jobs, lake, results, tasks, trail
from resim.supervisor.views.common import Told

PAGES: Mapping[str, Callable[[Supervisor, Request], Told]] = {
    "/": dashboard.dashboard,
    "/experiments": experiments.experiments,
    "/experiments/{name}": experiments.experiment,
    "/builds": builds.builds,
    "/builds/compare": builds.compared,
    "/builds/{name}": builds.build,
    "/results": results.results,
    "/results/{name}": results.result,
    "/tasks": tasks.tasks,
    "/tasks/{name}": tasks.task,
    "/live": tasks.live,
    "/jobs": jobs.jobs,
    "/jobs/{name}": jobs.job,
    "/trail": trail.trail,
    "/lake": lake.lake,
    "/lake/{name}": lake.thing,
}
KEPT = (
    "/",
    "/experiments",
    "/builds",
    "/builds/compare",
    "/results",
    "/tasks",
    "/lake",
    "/jobs",
    "/jobs/{name}",
)
"""Pages that are kept for a moment (`resim.supervisor.kept`): lists and forms, which many ask for."""
