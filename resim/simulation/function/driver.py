"""The AD function as the loop sees it: behind its watchdog, with its own cycle, its answers checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from resim.core.errors import FunctionError, ResimError
from resim.core.geometry import Floats, constant
from resim.core.plugins.descendants import end_strays
from resim.core.plugins.loading import LOAD_LIMIT
from resim.core.plugins.watchdog import Watchdog
from resim.simulation.function.batch import (
    BatchFunction,
    CommandBatch,
    ListsOfBatch,
    PerceivedBatch,
    PerceivedLists,
)
from resim.simulation.function.conversation import Exchange
from resim.simulation.function.interface import (
    AdFunction,
    Build,
    Command,
    EgoState,
    Perceived,
    Placement,
    Setup,
)
from resim.simulation.function.messages import MessageFunction

_FARTHEST = 1e12
"""s, m, rad or m/s from which on no plan is meant: as far as the clocks and places of recordings go."""
RESET_LIMIT = 60.0  # s of wall clock; building a route, loading weights


def cycle_steps(build: Build, step: float) -> int:
    """Give how many simulation steps one cycle of the function takes."""
    if build.cycle_time is None:
        return 1
    steps = round(build.cycle_time / step)
    if steps < 1 or abs(steps * step - build.cycle_time) > 1e-9:
        raise ResimError(
            f"{build.path}: cycle_time {build.cycle_time:g} s is not a multiple of the step, {step:g} s. "
            f"A step of {build.cycle_time / max(1, round(build.cycle_time / step)):g} s would fit."
        )
    return steps


class Driver:
    """One function for one run; remembers what it saw and planned from the scenario's start on."""

    def __init__(self, build: Build, watchdog: Watchdog, *, record: bool = False) -> None:
        self._build, self._watchdog, self._limit = build, watchdog, build.time_limit
        self._exchanges: list[Exchange] | None = [] if record else None
        self._function: AdFunction
        self._seen: list[Perceived] = []
        self._plans: list[tuple[float, Floats]] = []

    def reset(self, setups: Sequence[Setup]) -> None:
        """Execute the function's modules, make it and prepare it."""
        (setup,) = setups
        self._function = _made(self._build, self._watchdog)
        if isinstance(self._function, MessageFunction):
            self._function.exchanges = self._exchanges
        self._watchdog.call(RESET_LIMIT, lambda: self._function.reset(setup))
        self._step = self._watchdog.call(RESET_LIMIT, lambda: self._function.step)

    def step(self, perceived: PerceivedBatch, keep: bool) -> Floats | Placement:
        """Give the function's answer, (1, 2) acceleration and curvature; FunctionError for none that can be driven."""
        answer: Floats | Placement = self._watchdog.call(
            self._limit, self._answer, unchangeable(perceived.of(0)), keep
        )
        return answer

    def seen(self, b: int, until: float) -> PerceivedLists:
        """Give what it saw until then [s]."""
        return PerceivedLists(tuple(p for p in self._seen if p.t <= until))

    @property
    def exchanges(self) -> tuple[Exchange, ...]:
        """What was said to and by a process, if that is recorded."""
        return tuple(self._exchanges or ())

    def plans(self, b: int, until: float) -> tuple[tuple[float, Floats], ...]:
        """Give when [s] it made which plans until then."""
        return tuple(plan for plan in self._plans if plan[0] <= until)

    def _answer(self, perceived: Perceived, keep: bool) -> Floats | Placement:
        """Ask and check the answer, which may run code of the function's, too."""
        answer: Command | Placement = self._step(perceived)
        given: Floats | Placement
        if isinstance(answer, Command):
            command = _copied(answer)
            given = np.array([[command.acceleration, command.curvature]])
            if keep and command.plan is not None:
                self._plans.append((perceived.t, command.plan))
        elif isinstance(answer, Placement):
            if not self._build.needs_truth:
                raise FunctionError("answered a Placement; only oracles may, that declare needs_truth = True")
            given = _placement(answer)
        else:
            raise FunctionError(f"answered {answer!r:.60}, expected a Command")
        if keep:
            self._seen.append(perceived)
        return given

    def close(self) -> None:
        """End the function, and what it left running. Raises FunctionError where it did."""
        _closed(self._watchdog, self.__dict__)


def driver_of(build: Build, watchdog: Watchdog, runs: int, *, record: bool = False) -> Driver | BatchDriver:
    """Give what drives so many runs. record: whether the conversation of one is kept."""
    return Driver(build, watchdog, record=record) if runs == 1 else BatchDriver(build, watchdog)


def _made(build: Build, watchdog: Watchdog) -> Any:
    """Execute the function's modules, and make it."""
    watchdog.call(LOAD_LIMIT, build.factory.load)
    return watchdog.call(RESET_LIMIT, build.make)


def try_to_make(build: Build) -> None:
    """Make a function and let go of it: both run its code. Raises FunctionError where one of them fails."""
    with Watchdog() as watchdog:
        watchdog.call(RESET_LIMIT, lambda: build.make() and None)


class BatchDriver:
    """One function for several runs; remembers as `Driver` does.

    All runs together have the time that one has alone: so none passes that is too slow by itself, and who takes longer
    is driven in smaller batches, which takes no run's result from it.
    """

    exchanges: tuple[Exchange, ...] = ()

    def __init__(self, build: Build, watchdog: Watchdog) -> None:
        self._build, self._watchdog, self._limit = build, watchdog, build.time_limit
        self._function: BatchFunction
        self._seen: list[PerceivedBatch] = []
        self._plans: list[tuple[float, Floats]] = []

    def reset(self, setups: Sequence[Setup]) -> None:
        """Execute the function's modules, make it and prepare it for all runs."""
        self._function = _made(self._build, self._watchdog)
        self._watchdog.call(RESET_LIMIT, lambda: self._function.reset_batch(setups))
        self._step = self._watchdog.call(RESET_LIMIT, lambda: self._function.step_batch)

    def step(self, perceived: PerceivedBatch, keep: bool) -> Floats:
        """Give the answers (B, 2), acceleration and curvature; FunctionError for some that cannot be driven."""
        answer: Floats = self._watchdog.call(self._limit, self._answer, perceived, keep)
        return answer

    def _answer(self, perceived: PerceivedBatch, keep: bool) -> Floats:
        """Ask and check the answers."""
        answer, runs = self._step(perceived), len(perceived)
        if not isinstance(answer, CommandBatch):
            raise FunctionError(f"answered {answer!r:.60}, expected a CommandBatch")
        out = np.empty((runs, 2))
        for column, name in enumerate(("acceleration", "curvature")):
            out[:, column] = _numbers(getattr(answer, name), (runs,), name)
        if answer.plan is not None:
            plan = _numbers(answer.plan, (runs, *np.shape(answer.plan)[1:]), "plan")
            if (
                plan.ndim != 3
                or plan.shape[1] < 1
                or plan.shape[2] != 4
                or not (np.abs(plan) < _FARTHEST).all()
            ):
                raise FunctionError(
                    f"answered plans of shape {plan.shape}, expected (B, K, 4), below {_FARTHEST:g}"
                )
            if not (np.diff(plan[:, :, 0], axis=1) > 0.0).all():
                raise FunctionError("answered a plan whose times do not increase")
            if keep:
                self._plans.append((perceived.t, plan))
        if keep:
            self._seen.append(perceived)
        return out

    def seen(self, b: int, until: float) -> PerceivedLists:
        """Give what the function of a run saw until then [s]."""
        return ListsOfBatch([p for p in self._seen if p.t <= until], b)

    def plans(self, b: int, until: float) -> tuple[tuple[float, Floats], ...]:
        """Give when [s] the function of a run made which plans until then."""
        return tuple((t, plan[b]) for t, plan in self._plans if t <= until)

    def close(self) -> None:
        """End the function, and what it left running. Raises FunctionError where it did."""
        _closed(self._watchdog, self.__dict__)


_for_good: list[Any] = []
"""Functions that nobody lets go of any more: that would not return."""


def _closed(watchdog: Watchdog, held: dict[str, Any]) -> None:
    """End the function that a driver holds, if it was made, and what it left running; let go of it."""

    def let_go() -> None:  # which runs its code, too, where something of it has a `__del__`
        held.pop("_step", None)
        held.pop("_function", None)

    try:
        if "_function" in held:
            watchdog.call(RESET_LIMIT, lambda: held["_function"].close())
    finally:
        try:
            watchdog.call(RESET_LIMIT, let_go)
        except FunctionError:
            _for_good.append(held.copy())
            raise
        finally:
            end_strays()


def _numbers(given: Any, shape: tuple[int, ...], what: str) -> Floats:
    """Give a copy of an array of plain finite numbers of this shape."""
    if (
        isinstance(given, np.ndarray)
        and given.dtype.kind in "fiu"
        and not isinstance(given, np.ma.MaskedArray)
    ):
        copy: Floats = given.astype(float, order="C", subok=False)
        if copy.shape == shape and np.isfinite(copy).all():
            return copy
    raise FunctionError(f"answered {what} {given!r:.60}, expected finite numbers of shape {shape}")


def unchangeable(p: Perceived) -> Perceived:
    """Give the same with arrays that nobody can change; those that can be are copied."""
    if not (p.x_ego.flags.writeable or p.v.flags.writeable or p.ids.flags.writeable):
        return p  # as of `Ideal`, all of whose arrays are constant
    columns: tuple[Any, ...] = (
        p.ids,
        p.kind,
        p.x_ego,
        p.y_ego,
        p.heading_ego,
        p.v,
        p.length,
        p.width,
        p.z_ego,
    )
    return Perceived(p.t, p.ego, *[constant(c) if c.flags.writeable else c for c in columns])


_NUMBERS = (float, int, np.floating, np.integer)


def _plain(number: Any, what: str) -> float:
    """Give a plain finite float, whatever kind of number the function calculates with."""
    if type(number) is float and math.isfinite(number):
        return number
    try:
        value = float(number) if isinstance(number, _NUMBERS) else math.nan
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise FunctionError(f"answered {what} {number!r:.60}, expected a finite number")
    return value


def _copied(answer: Command) -> Command:
    """Give a command of plain numbers that the function cannot change any more."""
    a = _plain(answer.acceleration, "acceleration")
    curvature = _plain(answer.curvature, "curvature")
    return Command(a, curvature, None if answer.plan is None else _plan(answer.plan))


def _placement(answer: Placement) -> Placement:
    state: Any = answer.state
    if not isinstance(state, EgoState):
        raise FunctionError(f"answered the placement {state!r:.60}, expected an EgoState")
    values = zip(EgoState._fields, state, strict=True)
    return Placement(EgoState(*[_plain(value, f"placement {name}") for name, value in values]))


def _plan(plan: Any) -> Floats:
    """Give a copy of a plan: the function may write the next one into the same array."""
    if isinstance(plan, np.ndarray) and plan.dtype.kind in "fiu" and not isinstance(plan, np.ma.MaskedArray):
        copy: Floats = plan.astype(float, order="C", subok=False)
        is_table = copy.ndim == 2 and copy.shape[1] == 4 and len(copy) > 0
        if is_table and (
            np.vdot(copy, copy) < _FARTHEST**2 or (np.abs(copy) < _FARTHEST).all()
        ):  # the former is quicker
            if not (steps := np.diff(copy[:, 0]) > 0.0).all():
                k = int(np.argmin(steps))
                raise FunctionError(
                    f"answered a plan whose times do not increase: {copy[k, 0]:g} s and then {copy[k + 1, 0]:g} s"
                )
            return copy
    raise FunctionError(
        f"answered the plan {plan!r:.60}, expected one or more rows of finite numbers (K, 4) below {_FARTHEST:g}"
    )
