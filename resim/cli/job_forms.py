"""Forms of the jobs that the Supervisor starts, made from the parameters of their commands."""

from __future__ import annotations

import inspect
import types
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, Union, get_args, get_origin

from resim.cli.inputs import (
    A_BUILD,
    A_CRITERIA,
    A_DRIVE,
    A_MAP,
    A_MODEL,
    A_RECORDING,
    A_SUITE,
    A_SWEEP,
    A_SWEPT,
)
from resim.cli.offered import OFFERED, OfferedJob
from resim.cli.parameters import option_of
from resim.results.entry import KINDS
from resim.simulation.vehicles.registry import VEHICLES
from resim.supervisor.forms import FieldKind, FormField, JobForm

_FILES: Mapping[Any, tuple[str, ...]] = {
    A_RECORDING: ("recording",), A_BUILD: ("build",), A_SUITE: ("suite",), A_SWEEP: ("sweep-file",),
    A_CRITERIA: ("criteria",), A_MODEL: ("model",), A_DRIVE: ("recording", "run"), A_MAP: ("map",),
    A_SWEPT: ("sweep",),
}  # fmt: skip
"""What may be given where a command looks at a path in this way."""
_NAMED: Mapping[str, tuple[str, ...]] = {
    "recording": ("recording",), "recordings": ("recording",), "mined": ("mining",), "space": ("space",),
    "one": ("space",), "other": ("space",), "sweep": ("sweep", "verification"), "held_out": ("sweep", "verification"),
    "drive": ("recording", "run", "scenario"), "drives": ("recording", "run", "scenario"), "kernels": ("kernels",),
    "build": ("build",), "perception": ("model",), "conversation": ("build",), "results": tuple(KINDS),
    "verified": ("verification",), "replay": ("verification",),
}  # fmt: skip
"""The same of parameters that are looked at later, by their names."""
_PATTERNS: Mapping[str, tuple[str, ...]] = {
    "settings": ("*.toml",), "labels": ("*.toml",), "limits": ("*.toml",), "recipes": ("*.toml",),
    "traffic": ("*.toml",), "prediction": ("*.json",), "folder": ("././recording.toml",),
}  # fmt: skip
"""How files are called that the lake does not know."""
_WITHIN = {"verified": "verification.json", "replay": "verification.json"}
_OWN = {("space-cover", "space")}
"""What a command writes into: nothing but what tasks made."""
_PAGES = {"report": "report.html"}
"""Pages that are written besides, where one asks for them."""
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "vehicle": tuple(VEHICLES), "traffic": ("traces", "reactive"), "prediction": ("published", "ngsim", "mcity"),
    "version": ("1.1", "1.2", "1.3"), "style": ("trajectory", "route"), "outliers": ("robust", "moving-average"),
}  # fmt: skip
"""Of texts that could be something else, such as a path, which never comes from a page."""
_LEFT_OUT = {"gui", "dry_run", "shard", "scheduler", "resume", "video"}
"""Parameters for a terminal or a cluster, and those of which a task has its own."""
_ELSEWHERE = {("verify", "replay")}
"""Parameters for which there is another form."""
_NAME = FormField(
    "result_name", "What the result is called; default: like the first file that is given.", "name"
)


def job_forms() -> tuple[JobForm, ...]:
    """Give the forms of all jobs that are offered."""
    return tuple(_form(name, offered) for name, offered in OFFERED.items())


def _form(name: str, offered: OfferedJob) -> JobForm:
    parameters = inspect.signature(offered.job, eval_str=True).parameters.values()
    fields = [field for p in parameters if (field := _field(name, offered, p)) is not None]
    told = offered.help or (inspect.getdoc(offered.job) or "").split("\n\n")[0].replace("\n", " ")
    return JobForm(
        name, offered.words, told, tuple(fields + [_NAME] * bool(offered.out)), offered.out, offered.suffix,
        offered.again, offered.kept, offered.entered, offered.group, offered.fresh,
    )  # fmt: skip


def _field(job: str, offered: OfferedJob, parameter: inspect.Parameter) -> FormField | None:
    """The field of a parameter; None for one that pages do not offer. Raises LookupError for an unknown path."""
    annotated, info = get_args(parameter.annotation)[:2]
    kind_of, many, size = _plain(annotated)
    name, default = parameter.name, parameter.default
    is_left_out = name in _LEFT_OUT or (job, name) in _ELSEWHERE or name not in (offered.only or (name,))
    choices = _choices(kind_of, name)
    kind = "page" if name in _PAGES and kind_of is Path else _kind(kind_of, choices)
    option, off = option_of(info, name, is_flag=kind == "flag")
    if is_left_out or option == offered.out != "":
        return None
    is_file = kind in ("file", "choice")
    of = _FILES.get(info.callback, _NAMED.get(name, ())) if kind == "file" else ()
    patterns = offered.patterns.get(name, () if of else _PATTERNS.get(name, ())) if is_file else ()
    if kind == "file" and not (of or patterns):
        raise LookupError(f"{job}: {name}: what may be chosen as this path stands nowhere in {__name__}")
    required = default is inspect.Parameter.empty or name in offered.required
    return FormField(
        name, info.help or "", kind, option, _PAGES.get(name, off), of, patterns, _WITHIN.get(name, ""),
        (job, name) in _OWN, required, many, size, _default(default, kind), choices, info.min, info.max,
    )  # fmt: skip


def _plain(kind: Any) -> tuple[Any, bool, int]:
    """A type without None, list and tuple around it, whether it was a list, and how long the tuple was."""
    if get_origin(kind) in (Union, types.UnionType):
        kind = next(one for one in get_args(kind) if one is not type(None))
    many = get_origin(kind) in (list, Sequence)
    kind = get_args(kind)[0] if many else kind
    size = len(get_args(kind)) if get_origin(kind) is tuple else 1
    return (get_args(kind)[0] if size > 1 else kind), many, size


def _choices(kind: Any, name: str) -> tuple[str, ...]:
    if isinstance(kind, type) and issubclass(kind, Enum):
        return tuple(str(one.value) for one in kind)
    return _CHOICES.get(name, ())


def _kind(kind: Any, choices: Sequence[str]) -> FieldKind:
    if choices:
        return "choice"
    kinds: dict[Any, FieldKind] = {Path: "file", bool: "flag", int: "whole", float: "number"}
    return kinds.get(kind, "text")


def _default(value: Any, kind: FieldKind) -> str:
    if kind in ("flag", "page"):
        return "yes" if value is True else "no"
    if value is None or value is inspect.Parameter.empty:
        return ""
    return str(value.value if isinstance(value, Enum) else value)
