"""What a sweep's file says."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

from resim.core import remedies
from resim.core.errors import InputError
from resim.core.schema import Row
from resim.core.spec import Strict, read_strict
from resim.recordings.listed import RecordingEntry
from resim.simulation.reactive.settings import WithTraffic
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.plans.registry import PLANS, SweepPlan
from resim.variations.swept import SweepVariation

EXAMPLE = remedies.SWEEP
EngineName = Literal["sumo", "direct"]


def _known_plan(name: str) -> str:
    """The name of a plan. Raises PydanticCustomError for one that there is not."""
    if name not in PLANS:
        *others, last = map(repr, PLANS.names)
        raise PydanticCustomError("literal_error", f"expected {', '.join(others)} or {last}")
    return name


PlanName = Annotated[
    str, AfterValidator(_known_plan), WithJsonSchema({"type": "string", "enum": list(PLANS.names)})
]


class Adaptive(Strict):
    """Where an adaptive plan spends its runs: where the share of a point's seeds that are good falls below `share`.

    outcome: an outcome of `resim.sweeps.outcomes` by which runs are good, such as "verdict" (PASS), "same_decision" (as
    measured) or "no collision", or a criterion's name (PASS).
    """

    outcome: str = "verdict"
    share: float = Field(strict=True, default=0.5, gt=0.0, le=1.0)

    def good(self, row: Row) -> bool:
        """Say whether a run is good; one that failed, or is without a result, is not."""
        if row.get("end") == "failed" or row.get("failure"):
            return False
        from resim.sweeps.outcomes.registry import column_of  # its outcomes take long to load

        column, good = column_of(self.outcome)
        return row.get(column) == good


class SweepFile(WithTraffic):
    """What a sweep's file says; paths from the folder of the file.

    recording, suite: which recordings, one by one or those of a suite. build: the builds. perception: the base model,
    that perception parameters are parameters of. plan: see `sweeps.plans`. points: how many, of a plan that draws
    them; the most of an adaptive one. seed: of what is drawn. seeds: runs of each point. time_limit: s of wall clock
    for one run. adaptive: of the plan of that name. engine: "direct" runs without a simulator, which gives the same
    and is faster; the first of its runs, and this share of all, is repeated in SUMO: one that differs ends the sweep.
    traffic, reactive: how traffic moves. variation: how recordings are varied, where parameters are of variations.
    """

    name: str = Field(min_length=1)
    recording: tuple[RecordingEntry, ...] = ()
    suite: str | None = None
    build: tuple[str, ...] = Field(min_length=1)
    perception: str | None = None
    criteria: str = Field(min_length=1)
    plan: PlanName = "grid"
    adaptive: Adaptive = Adaptive()
    engine: EngineName = "sumo"
    repeated_in_sumo: float = Field(strict=True, default=0.01, ge=0.0, le=1.0)
    points: int = Field(strict=True, default=64, ge=1, le=1_000_000)
    seed: int = Field(strict=True, default=0, ge=0)
    seeds: int = Field(strict=True, default=5, ge=1, le=100_000)
    time_limit: float = Field(strict=True, default=60.0, ge=0.001, le=1e6)
    accept: tuple[str, ...] = ()
    variation: SweepVariation | None = None
    parameter: tuple[SweepParameter, ...] = Field(min_length=1)

    @property
    def planned(self) -> SweepPlan:
        """The plan of this name."""
        return PLANS[self.plan]


def read_sweep_file(path: Path) -> SweepFile:
    """Give what the file says, before anything that it names is read. Raises InputError naming every fault."""
    file = read_strict(path, SweepFile, EXAMPLE)
    if bool(file.recording) == (file.suite is not None):
        raise InputError(path, "needs either [[recording]] or suite", "Name one of them.")
    if again := [name for name in file.build if file.build.count(name) > 1]:
        raise InputError(path, f"build {again[0]!r} is a duplicate", "Take one away.")
    names = [p.name for p in file.parameter]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(path, f"parameter {twice[0]!r} is a duplicate", "Take one away.")
    if file.perception is None and (of := [name for name in names if name.startswith("perception.")]):
        raise InputError(path, f"parameter {of[0]!r} without a model", "Name one with perception = ...")
    if file.engine == "direct" and file.reactive.drivers == "sumo":
        raise InputError(
            path,
            'reactive.drivers: SUMO\'s own drivers are not in the engine "direct"',
            'Set engine = "sumo".',
        )
    _check_variations(path, file)
    return file


def _check_variations(path: Path, file: SweepFile) -> None:
    """Raise InputError for parameters of variations that are none, or that nothing says how to vary."""
    of = [p for p in file.parameter if p.name.startswith("variation.")]
    if bool(of) == (file.variation is None):
        problem = (
            f"parameter {of[0].name!r} without [variation]" if of else "[variation] without a parameter of it"
        )
        raise InputError(path, problem, EXAMPLE)
    for p in of:
        if p.name == "variation.number":
            levels = p.levels() if file.plan in ("grid", "one_at_a_time") or p.values else None
            if levels is None or (levels < 0.0).any() or (levels != levels.round()).any():
                problem = (
                    f"parameter {p.name!r}: expected whole numbers from 0 on, of a grid or one at a time"
                )
                raise InputError(path, problem, EXAMPLE)
        elif not p.name.removeprefix("variation.c").isdigit():
            raise InputError(
                path, f"parameter {p.name!r}: there are variation.number and variation.c1, c2, ...", EXAMPLE
            )
