"""The public classes and functions of the library: for Sphinx, and short enough to be read as plain Markdown."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import resim.core.errors
import resim.core.tracks
import resim.gym
import resim.jobs.assess
import resim.jobs.augment
import resim.jobs.check
import resim.jobs.convert
import resim.jobs.generate
import resim.jobs.kernels
import resim.jobs.play
import resim.jobs.resimulate
import resim.jobs.sweep
import resim.jobs.traffic
import resim.jobs.train
import resim.jobs.vary
import resim.jobs.verify
import resim.metrics.measures
import resim.metrics.risk
import resim.perception.training
import resim.recordings
import resim.resimulation
import resim.road.driven_route
import resim.road.opendrive
import resim.road.path
import resim.scenario.jscen
import resim.scenario.scenario
import resim.simulation.case
import resim.simulation.function.batch
import resim.simulation.function.interface

API = {
    "Re-simulate": resim.jobs.resimulate,
    "Assess": resim.jobs.assess,
    "See a drive": resim.jobs.play,
    "Verify and compare": resim.jobs.verify,
    "Sweep": resim.jobs.sweep,
    "Check and repair": resim.jobs.check,
    "Train": resim.jobs.train,
    "Generate": resim.jobs.generate,
    "Traffic": resim.jobs.traffic,
    "Augment": resim.jobs.augment,
    "Vary": resim.jobs.vary,
    "Train maneuver kernels": resim.jobs.kernels,
    "Check and convert maps": resim.jobs.convert,
    "Re-simulation": resim.resimulation,
    "Cases and simulated drives": resim.simulation.case,
    "AD functions": resim.simulation.function.interface,
    "AD functions in batches": resim.simulation.function.batch,
    "Agents that learn": resim.gym,
    "Recordings": resim.recordings,
    "Tracks": resim.core.tracks,
    "Scenarios": resim.scenario.scenario,
    "JSCEN files": resim.scenario.jscen,
    "Roads": resim.road.opendrive,
    "Routes": resim.road.driven_route,
    "Paths along lanes": resim.road.path,
    "Measures": resim.metrics.measures,
    "Accident risk": resim.metrics.risk,
    "Training of perception models": resim.perception.training,
    "Errors": resim.core.errors,
}
"""The modules of the reference, by heading."""

IN_FULL: tuple[Any, ...] = (
    resim.simulation.function.interface,
    resim.simulation.function.batch,
    resim.gym,
    resim.road.driven_route.Route,
    resim.road.path,
    resim.road.opendrive.RoadNetwork,
    resim.road.opendrive.RoadPositions,
)
"""Modules and classes that who writes a function needs: shown as they stand in the source, without their bodies."""

ROOT = Path(__file__).parents[1]


def api_on_the_site(_: str = "") -> str:
    """Give all classes and functions with their docstrings, module by module, as Sphinx makes them."""
    return "\n\n".join(
        f"## {head}\n\n`{module.__name__}`\n\n```{{eval-rst}}\n.. automodule:: {module.__name__}\n```"
        for head, module in API.items()
    )


def api(_: str = "") -> str:
    """Give a table of the classes and functions of each module, and in full what is `IN_FULL`."""
    return "\n\n".join(_module(head, module) for head, module in API.items())


def _module(head: str, module: ModuleType) -> str:
    members = list(_members(module))
    rows = ["| name | what | source |", "|---|---|---|", *(_row(member) for member in members)]
    full = [f"```py\n{_outline(m)}\n```" for m in members if module in IN_FULL or m in IN_FULL]
    return "\n\n".join([f"## {head}", f"`{module.__name__}`", "\n".join(rows), *full])


def _members(module: ModuleType) -> Iterator[Any]:
    """The public classes and functions of a module: those that it exports, or else those that it defines."""
    exported = getattr(module, "__all__", None)
    for name in exported or vars(module):
        member = getattr(module, name)
        own = exported or getattr(member, "__module__", None) == module.__name__
        if (
            own
            and not name.startswith("_")
            and (inspect.isclass(member) or inspect.isroutine(inspect.unwrap(member)))
        ):
            yield member


def _row(member: Any) -> str:
    path = Path(inspect.getsourcefile(inspect.unwrap(member)) or "").relative_to(ROOT).as_posix()
    said = " ".join((inspect.getdoc(member) or "").partition("\n\n")[0].split())
    said = re.sub(r"([*<|]|\](?=\())", r"\\\1", re.split(r"(?<=\.) (?=[A-Z`])", said)[0])
    return f"| `{_called(member)}` | {said} | [{Path(path).name}](../../{path}) |"


def _called(member: Any) -> str:
    """A function's name with those of its arguments, a class's name."""
    if inspect.isclass(member):
        return member.__name__
    names, before = [], None
    for argument in inspect.signature(member).parameters.values():
        if argument.kind is argument.KEYWORD_ONLY and before is not argument.KEYWORD_ONLY:
            names.append("*")
        names.append(argument.name)
        before = argument.kind
    return f"{member.__name__}({', '.join(names)})"


def _outline(member: Any) -> str:
    """The source of a class or function without private parts and bodies, docstrings kept."""
    source = inspect.getsource(inspect.unwrap(member))
    lines = source.splitlines()
    (node,) = ast.parse(source).body
    return "\n".join(_outlined(node, lines))


def _outlined(node: Any, lines: list[str]) -> Iterator[str]:
    first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
    documented = ast.get_docstring(node) is not None
    yield from lines[first - 1 : node.body[0].end_lineno if documented else node.body[0].lineno - 1]
    if not isinstance(node, ast.ClassDef):
        return
    fields = [part for part in node.body if isinstance(part, ast.AnnAssign)]
    yield from [""] if fields and documented else []
    for field in fields:
        if isinstance(field.target, ast.Name) and not field.target.id.startswith("_"):
            yield from lines[field.lineno - 1 : field.end_lineno]
    for part in node.body:
        if isinstance(part, ast.FunctionDef) and not part.name.startswith("_"):
            yield ""
            yield from _outlined(part, lines)


def as_rst(lines: list[str]) -> list[str]:
    """Give a docstring for reStructuredText: what stands between backticks is code, everything else plain text."""
    out: list[str] = []
    for line in "\n".join(lines).split("`"):
        out.append(line if len(out) % 2 else re.sub(r"([\\*|_])", r"\\\1", line))
    return "``".join(out).replace("````", "").split("\n")
