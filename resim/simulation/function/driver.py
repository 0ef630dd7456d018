"""The AD function as the loop sees it: behind its watchdog, with its own cycle, its answers checked."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from resim.core.errors import FunctionError, ResimError
from resim.core.geometry import Floats, constant
from resim.core.plugins.descendants import end_strays
from resim.core.plugins.loading import LOAD_LIMIT
from resim.core.plugins.watchdog import Watchdog
from resim.simulation.function.interface import (
    AdFunction,
    Build,
    Command,
    EgoState,
    Perceived,
    Placement,
    Setup,
)

_FARTHEST = 1e9
"""s, m, rad or m/s from which on no plan is meant, and squares overflow in what looks at it."""
_RESET_LIMIT = 60.0  # s of wall clock; building a route, loading weights


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

    def __init__(self, build: Build, watchdog: Watchdog) -> None:
        self._build, self._watchdog, self._limit = build, watchdog, build.time_limit
        self._function: AdFunction
        self.seen: list[Perceived] = []
        self.plans: list[tuple[float, Floats]] = []

    def reset(self, setup: Setup) -> None:
        """Execute the function's modules, make it and prepare it."""
        self._watchdog.call(LOAD_LIMIT, self._build.factory.load)
        self._function = self._watchdog.call(_RESET_LIMIT, self._build.make)
        self._watchdog.call(_RESET_LIMIT, lambda: self._function.reset(setup))
        self._step = self._watchdog.call(_RESET_LIMIT, lambda: self._function.step)

    def step(self, perceived: Perceived, keep: bool) -> Command | Placement:
        """Give the function's answer; FunctionError for one that cannot be driven."""
        answer: Command | Placement = self._watchdog.call(
            self._limit, self._answer, unchangeable(perceived), keep
        )
        return answer

    def _answer(self, perceived: Perceived, keep: bool) -> Command | Placement:
        """Ask and check the answer, which may run code of the function's, too."""
        answer: Command | Placement = self._step(perceived)
        if isinstance(answer, Command):
            answer = _copied(answer)
            if keep and answer.plan is not None:
                self.plans.append((perceived.t, answer.plan))
        elif isinstance(answer, Placement):
            if not self._build.needs_truth:
                raise FunctionError("answered a Placement; only oracles may, that declare needs_truth = True")
            answer = _placement(answer)
        else:
            raise FunctionError(f"answered {answer!r:.60}, expected a Command")
        if keep:
            self.seen.append(perceived)
        return answer

    def close(self) -> None:
        """End the function, and what it left running. Raises FunctionError where it did."""
        try:
            if hasattr(self, "_function"):
                self._watchdog.call(_RESET_LIMIT, lambda: self._function.close())
        finally:
            end_strays()


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
