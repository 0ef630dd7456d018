"""What an AD function sees and answers, and the build file that pins one to a version and its parameters."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from resim.core import faults, remedies
from resim.core.errors import InputError
from resim.core.files import parse_toml, read_file
from resim.core.geometry import Floats, constant, from_frame
from resim.core.plugins.frozen import FrozenCopy, FrozenFile, load_frozen
from resim.core.plugins.loading import LoadedCallable, freeze_code, load_named
from resim.core.plugins.unlisted_files import OpenedFiles
from resim.core.spec import ModuleAndName
from resim.core.spelling import did_you_mean
from resim.core.tracks import Strings
from resim.function import Command as Command
from resim.function import EgoState as EgoState
from resim.road.driven_route import NO_ROUTE, Route
from resim.road.opendrive import RoadNetwork
from resim.simulation.function.conversation import CycleTime, TimeLimit
from resim.simulation.function.fmu import FmiTable, fmu_files
from resim.simulation.function.grpc_stream import GrpcProgram, GrpcTable
from resim.simulation.function.grpc_wire import refuse_without_grpc
from resim.simulation.function.program import (
    NamedProgram,
    ProcessTable,
    RecordedTable,
    outside,
    own_files,
    program_of,
    recorded_files,
    recorded_program,
    unit_program,
)

PARTS = remedies.BUILD


_NOT_GIVEN: Any = None
_BY_MESSAGES = "resim.simulation.function.messages:MessageFunction"
_IN_BATCHES = (("reset", "reset_batch"), ("step", "step_batch"))
"""What a function has for one run and, if it can drive several at once, for them."""


@lru_cache(maxsize=256)
def unknown_heights(count: int) -> Floats:
    """Give NaN (count,), which nobody can change."""
    return constant(np.full(count, np.nan))


@dataclass(frozen=True, slots=True, eq=False)
class Perceived:
    """What the AD function sees at time t [s]: its own state, and a list of N objects in the EGO's frame.

    ids, kind: (N,). x_ego, y_ego: (N,) m, forward and left of the EGO's box centre to the object's.
    heading_ego: (N,) rad against the EGO's heading. v: (N,) m/s over ground along the object's heading.
    length, width: (N,) m. z_ego: (N,) m, height of the road under the objects above that under the EGO, NaN where it is
    not known, as it is where nobody gives it.
    """

    t: float
    ego: EgoState
    ids: Strings
    kind: Strings
    x_ego: Floats
    y_ego: Floats
    heading_ego: Floats
    v: Floats
    length: Floats
    width: Floats
    z_ego: Floats = _NOT_GIVEN

    def __post_init__(self) -> None:
        if self.z_ego is _NOT_GIVEN:
            object.__setattr__(self, "z_ego", unknown_heights(len(self.ids)))

    def map_positions(self) -> tuple[Floats, Floats]:
        """Give x, y (N,) [m] of the objects in the map frame, as far as the perceived EGO pose is right."""
        return from_frame(self.x_ego, self.y_ego, self.ego.x, self.ego.y, self.ego.heading)


@dataclass(frozen=True, slots=True)
class Placement:
    """Puts the EGO into a state at the next step, past the vehicle model. Only oracles answer this."""

    state: EgoState


@dataclass(frozen=True, eq=False)
class Setup:
    """What an AD function gets before a run.

    start: the EGO's state at t = 0. goal: x, y [m] where the recorded EGO was last. cycle: s between two
    calls of `step`. recorded: the EGO's measured states at times t, None unless the function declares
    `needs_truth = True`, as oracles do. route: the roads and connections that the recorded EGO took; the function is to
    stay on them, in whichever lane.
    """

    road: RoadNetwork
    start: EgoState
    goal: tuple[float, float]
    length: float
    width: float
    cycle: float
    seed: int
    recorded: Callable[[float], EgoState] | None = None
    route: Route = NO_ROUTE


class AdFunction(Protocol):
    """An automated-driving function under test. The factory of its build makes one per run."""

    def reset(self, setup: Setup) -> None:
        """Prepare for a run. `step` is called from before t = 0 on, while the EGO is still guided."""

    def step(self, perceived: Perceived) -> Command | Placement:
        """Answer what is perceived."""

    def close(self) -> None:
        """End the run."""


class BuildFile(BaseModel):
    """What a build file says."""

    model_config = ConfigDict(extra="forbid")
    name: str = Field(min_length=1)
    version: str = Field(min_length=1)
    factory: ModuleAndName | None = None
    process: ProcessTable | None = None
    grpc: GrpcTable | None = None
    fmi: FmiTable | None = None
    recorded: RecordedTable | None = None
    cycle_time: CycleTime = None
    time_limit: TimeLimit = 1.0
    files: tuple[str, ...] = ()
    parameters: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _is_code_or_process(self) -> BuildFile:
        if self.recorded is not None:
            given = self.model_fields_set - {"name", "version", "recorded"}
            if given:
                raise ValueError(
                    f"{sorted(given)[0]}: [recorded] has its own, as it was recorded; leave it out"
                )
            return self
        by_command = self.process is not None and bool(self.process.command)
        elsewhere = (self.grpc is not None) + (self.fmi is not None)
        if (self.factory is not None) + by_command + elsewhere != 1 or (
            self.process is not None and elsewhere
        ):
            raise ValueError(
                "expected factory, or [process] with a command, or factory and [process] with python, or [grpc], "
                "or [fmi], or [recorded]"
            )
        return self


@dataclass(frozen=True, eq=False)
class Build:
    """An AD function at one version: what makes it, with which parameters.

    Attributes:
        name: What it is called.
        version: Its version.
        path: The build file.
        factory: What makes the function.
        needs_truth: Whether the function is an oracle that is given the recorded EGO.
        in_batches: Whether it can drive several runs at once (`resim.simulation.function.batch.BatchFunction`).
        parameters: What the factory is called with.
        cycle_time: s between two answers, None for every simulation step.
        time_limit: s of wall clock for one answer; `reset` and `close` have a minute, the import of its module three.
        frozen: The copy that it was loaded from, whose hash is of the build file, the factory's module, what that
            imports from its own folder, the program, and the files that the build lists.
        program: What is asked by messages for each run, None of one that is Python of this environment.
    """

    name: str
    version: str
    path: Path
    factory: LoadedCallable
    needs_truth: bool
    in_batches: bool
    parameters: dict[str, Any]
    cycle_time: float | None
    time_limit: float
    frozen: FrozenFile
    program: NamedProgram | None = None

    @property
    def hash(self) -> str:
        """What pins it (SHA-256)."""
        return self.frozen.hash

    @property
    def label(self) -> str:
        """Name and version, as recordings state the build that drove."""
        return f"{self.name}-{self.version}"

    @property
    def opened(self) -> OpenedFiles:
        """What its code opens beside the build file that the hash does not know."""
        return self.factory.opened

    def make(self) -> AdFunction:
        """Make the function, in the context `factory.afresh`: with parameters of its own that no other run has."""
        given = deepcopy(self.parameters)
        make = self.factory.load()
        function: AdFunction = make(**given) if self.program is None else make(self.program, given)
        return function


def freeze_build(path: Path) -> FrozenFile:
    """Keep a copy of a build file with all that its hash is of. Raises InputError for what is not there."""
    raw = read_file(path, PARTS)
    file = _parsed(raw, path)
    named = [] if file.factory is None else [file.factory]
    if file.recorded is not None:
        return freeze_code(path, raw, named, recorded_files(path, file.recorded))
    if file.process is None:
        units = [] if file.fmi is None else fmu_files(path, file.fmi)
        return freeze_code(path, raw, named, [*file.files, *units])
    files = dict.fromkeys([*file.files, *own_files(path, file.process)])
    return freeze_code(path, raw, named, [*files], outside(path, file.process))


def load_build(file: str | Path | FrozenFile) -> Build:
    """Read a build file (TOML) and import the factory that it names, from a frozen copy.

    `factory` is "module:name"; a module file beside the build file goes before an installed module. With `[process]`
    the function is a process of its own (`resim.simulation.function.process`), whose factory nobody imports here; with
    `[grpc]` it is asked at an address (`resim.simulation.function.grpc_stream`); with `[fmi]` it is a co-simulation
    unit (`resim.simulation.function.fmu`); with `[recorded]` it is what was recorded of one
    (`resim.simulation.function.conversation`).

    Args:
        file: The build file, or its frozen copy.

    Returns:
        The build.

    Raises:
        InputError: A file, field, module or name is not there.
    """
    frozen = file if isinstance(file, FrozenFile) else freeze_build(Path(file))
    path, copy = frozen.path, load_frozen(frozen, freeze_build)
    said = _parsed(copy.raw, path)
    if said.factory is None or said.process is not None:
        return _asked_by_messages(frozen, copy, said)
    named = load_named(frozen, copy, said.factory, "factory")
    factory = named.load()
    name, needs_truth = said.factory.partition(":")[2], bool(getattr(factory, "needs_truth", False))
    lacks = [
        call
        for call in ("reset", "step", "close")
        if isinstance(factory, type) and not hasattr(factory, call)
    ]
    if lacks:
        raise InputError(
            path, f"factory {said.factory!r} has no {', '.join(lacks)}", "An AD function has all three."
        )
    if misfit := misfit_of(factory, said.parameters):
        raise InputError(path, f"[parameters] do not fit {name}: {misfit}", "Correct them.")
    return Build(
        name=said.name,
        version=said.version,
        path=path,
        factory=named,
        needs_truth=needs_truth,
        in_batches=not needs_truth and all(_has_both(factory, *names) for names in _IN_BATCHES),
        parameters=said.parameters,
        cycle_time=said.cycle_time,
        time_limit=said.time_limit,
        frozen=frozen,
    )


def _asked_by_messages(frozen: FrozenFile, copy: FrozenCopy, said: BuildFile) -> Build:
    """The build of a process, of a server, or of what was recorded."""
    path, cycle_time, time_limit, parameters = frozen.path, said.cycle_time, said.time_limit, said.parameters
    program: NamedProgram
    if said.process is not None:
        program, in_batches = program_of(path, said.process, said.factory or "", copy), said.process.batches
    elif said.grpc is not None:
        program, in_batches = GrpcProgram(said.grpc.address, said.grpc.digest), said.grpc.batches
        refuse_without_grpc(str(path))
    elif said.fmi is not None:
        program, in_batches = unit_program(path, said.fmi, parameters, copy), False
    else:
        assert said.recorded is not None
        program, in_batches = recorded_program(path, said.recorded, copy, said.name, said.version), False
        first = program.conversations[0]
        speaker, parameters = first.speaker, first.parameters
        cycle_time, time_limit = speaker.cycle_time, speaker.time_limit
    return Build(
        name=said.name,
        version=said.version,
        path=path,
        factory=load_named(frozen, copy, _BY_MESSAGES, "[process], [grpc], [fmi] or [recorded]"),
        needs_truth=False,
        in_batches=in_batches,
        parameters=parameters,
        cycle_time=cycle_time,
        time_limit=time_limit,
        frozen=frozen,
        program=program,
    )


def misfit_of(factory: Any, names: Iterable[str]) -> str:
    """Say which of the parameters of these names a factory does not take, or lacks; "" where it may be called so."""
    given = [*names]
    try:
        takes = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):  # compiled code may not say its parameters; a run will find out
        return ""
    known = [p.name for p in takes if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    anything = any(p.kind is p.VAR_KEYWORD for p in takes)
    if strange := [name for name in given if name not in known and not anything]:
        has = f"; it has: {', '.join(known)}" if known else "; it has none"
        return f"there is no parameter {strange[0]!r}{did_you_mean(strange[0], known) or has}"
    needed = [
        p.name for p in takes if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    lost = [name for name in needed if name not in given]
    return f"parameter {lost[0]!r} is missing" if lost else ""


def _has_both(factory: Any, one: str, many: str) -> bool:
    """Whether a class has a method for many runs that belongs to the one it has for one: not overridden since."""
    owners = [next((k for k, kind in enumerate(getattr(factory, "__mro__", ())) if name in vars(kind)), None)
              for name in (one, many)]  # fmt: skip
    return None not in owners and owners[1] <= owners[0]  # type: ignore[operator]


def _parsed(raw: bytes, path: Path) -> BuildFile:
    try:
        return BuildFile.model_validate(parse_toml(raw, path, PARTS))
    except ValidationError as e:
        tables = {str(fault["loc"][0]) if fault["loc"] else "" for fault in e.errors()}
        remedy = remedies.BUILD_TABLES.get(tables.pop(), PARTS) if len(tables) == 1 else PARTS
        raise InputError(path, faults.describe(e.errors(), BuildFile), remedy) from e
