"""Forms of the jobs that the Supervisor starts, made from the parameters of their commands."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Union, get_args, get_origin

from typer.models import ArgumentInfo

from resim.cli.assess import assess
from resim.cli.check import check
from resim.cli.inputs import A_BUILD, A_CRITERIA, A_DRIVE, A_MODEL, A_RECORDING, A_SUITE, A_SWEEP
from resim.cli.mine import mine
from resim.cli.play import play
from resim.cli.run import run
from resim.cli.space import build, grow
from resim.cli.sweep import sweep
from resim.cli.vary import vary
from resim.cli.verify import verify
from resim.simulation.vehicles.registry import VEHICLES
from resim.supervisor.forms import FieldKind, FormField, JobForm


@dataclass(frozen=True)
class _Offered:
    """A command that is offered, what its results are called, what a further attempt has besides, if it goes on."""

    words: tuple[str, ...]
    job: Callable[..., None]
    result: str = "result"
    again: tuple[str, ...] = ()
    kept: bool = False


OFFERED: Mapping[str, _Offered] = {
    "run": _Offered(("run",), run),
    "verify": _Offered(("verify",), verify, kept=True),
    "sweep": _Offered(("sweep", "run"), sweep, again=("--resume",), kept=True),
    "assess": _Offered(("assess", "drive"), assess),
    "check": _Offered(("check",), check, result=""),
    "mine": _Offered(("mine",), mine, kept=True),
    "vary": _Offered(("vary", "drive"), vary),
    "space": _Offered(("space", "build"), build),
    "space-grow": _Offered(("space", "grow"), grow),
    "play": _Offered(("play",), play, result="play.html"),
}
_FILES: Mapping[Any, tuple[str, ...]] = {
    A_RECORDING: ("recording",), A_BUILD: ("build",), A_SUITE: ("suite",), A_SWEEP: ("sweep-file",),
    A_CRITERIA: ("criteria",), A_MODEL: ("model",), A_DRIVE: ("drive", "recording", "result"),
}  # fmt: skip
"""What may be given where a command looks at a path in this way."""
_NAMED: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("mine", "recordings"): ("recording",),
    ("space", "mined"): ("mining",),
    ("space-grow", "space"): ("space",),
    ("space-grow", "mined"): ("mining",),
    ("play", "drives"): ("drive", "recording", "result"),
    ("vary", "kernels"): ("kernels",),
}
"""The same of parameters that are looked at later."""
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "vehicle": tuple(VEHICLES), "traffic": ("traces", "reactive"), "prediction": ("published", "ngsim", "mcity"),
}  # fmt: skip
"""Of texts that could be something else, such as a path, which never comes from a page."""
_LEFT_OUT = {"gui", "record", "dry_run", "shard", "scheduler", "resume", "max_gap", "outliers"}
"""Parameters for a terminal, those of which a task has its own, and those that need a path."""
_REQUIRED = {("verify", "suite"), ("verify", "build")}
"""What a command asks for itself, as it has another way to be called."""


def job_forms() -> tuple[JobForm, ...]:
    """Give the forms of all jobs that are offered."""
    return tuple(_form(name, offered) for name, offered in OFFERED.items())


def _form(name: str, offered: _Offered) -> JobForm:
    parameters = inspect.signature(offered.job, eval_str=True).parameters.values()
    fields = [field for p in parameters if (field := _field(name, p)) is not None]
    out = "--out" if offered.result else ""
    told = (inspect.getdoc(offered.job) or "").split("\n\n")[0].replace("\n", " ")
    return JobForm(name, offered.words, told, tuple(fields), out, offered.result, offered.again, offered.kept)


def _field(job: str, parameter: inspect.Parameter) -> FormField | None:
    """The field of a parameter; None for one that pages do not offer, such as a path that is nobody's to choose."""
    kind_of, info = get_args(parameter.annotation)[:2]
    kind_of, many = _plain(kind_of)
    name, default = parameter.name, parameter.default
    of = _FILES.get(info.callback, _NAMED.get((job, name), ()))
    if name in _LEFT_OUT or (kind_of is Path and not of):
        return None
    choices = _choices(kind_of, name)
    kind = _kind(kind_of, choices)
    option, off = _option(info, name, kind)
    required = default is inspect.Parameter.empty or (job, name) in _REQUIRED
    return FormField(
        name, info.help or "", kind, option, off, of, required=required, many=many, default=_default(default, kind),
        choices=choices, low=info.min, high=info.max,
    )  # fmt: skip


def _option(info: Any, name: str, kind: FieldKind) -> tuple[str, str]:
    """How the command line names a parameter, and what switches it off, "" where nothing does."""
    if isinstance(info, ArgumentInfo):
        return "", ""
    words = [
        w for w in (info.default, *(info.param_decls or ())) if isinstance(w, str) and w.startswith("--")
    ]
    option = words[0].partition("/")[0] if words else f"--{name.replace('_', '-')}"
    return option, f"--no-{option.removeprefix('--')}" if kind == "flag" and not words else ""


def _plain(kind: Any) -> tuple[Any, bool]:
    """A type without None and list around it, and whether it was a list."""
    if get_origin(kind) in (Union, types.UnionType):
        kind = next(one for one in get_args(kind) if one is not type(None))
    many = get_origin(kind) in (list, Sequence)
    return (get_args(kind)[0] if many else kind), many


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
    if kind == "flag":
        return "yes" if value is True else "no"
    if value is None or value is inspect.Parameter.empty:
        return ""
    return str(value.value if isinstance(value, Enum) else value)
