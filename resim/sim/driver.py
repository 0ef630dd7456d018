"""The AD function as the loop sees it: behind its watchdog, with its own cycle, its answers checked."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from resim.core.errors import FunctionError, ResimError
from resim.core.geometry import Floats
from resim.sim.adfunction import AdFunction, Build, Command, EgoState, Perceived, Placement, Setup
from resim.sim.watchdog import Watchdog

_RESET_LIMIT = 60.0  # s of wall clock; building a route, loading weights


def cycle_steps(build: Build, step: float) -> int:
    """Give how many simulation steps one cycle of the function takes."""
    if build.cycle_time is None:
        return 1
    steps = round(build.cycle_time / step)
    if steps < 1 or abs(steps * step - build.cycle_time) > 1e-9:
        raise ResimError(
            f"{build.path}: cycle_time {build.cycle_time:g} s is not a multiple of the step, {step:g} s. "
            "Change one of them."
        )
    return steps


class Driver:
    """One function for one run; remembers what it saw and planned from the scenario's start on."""

    def __init__(self, build: Build, watchdog: Watchdog) -> None:
        self._make, self._watchdog, self._limit = build.make, watchdog, build.time_limit
        self._function: AdFunction
        self.seen: list[Perceived] = []
        self.plans: list[tuple[float, Floats]] = []

    def reset(self, setup: Setup) -> None:
        """Make the function and prepare it."""
        self._function = self._watchdog.call(_RESET_LIMIT, self._make)
        self._watchdog.call(_RESET_LIMIT, self._function.reset, setup)

    def step(self, perceived: Perceived, keep: bool) -> Command | Placement:
        """Give the function's answer; FunctionError for one that cannot be driven."""
        answer: Command | Placement = self._watchdog.call(self._limit, self._function.step, perceived)
        if isinstance(answer, Command):
            answer = _numbers(answer)
            if keep and answer.plan is not None:
                self.plans.append((perceived.t, answer.plan))
        elif not isinstance(answer, Placement) or not _placeable(answer):
            raise FunctionError(f"answered {answer!r}, expected a Command")
        if keep:
            self.seen.append(perceived)
        return answer

    def close(self) -> None:
        """End the function."""
        if hasattr(self, "_function"):
            self._watchdog.call(_RESET_LIMIT, self._function.close)


def _numbers(answer: Command) -> Command:
    """Give the command with plain finite numbers, whatever kind of number the function calculates with."""
    a: Any = answer.acceleration  # whatever a plug-in puts there
    curvature: Any = answer.curvature
    numbers = (float, int, np.floating, np.integer)
    if not (isinstance(a, numbers) and isinstance(curvature, numbers)):
        raise FunctionError(f"answered acceleration {a!r:.60}, curvature {curvature!r:.60}")
    if type(a) is not float or type(curvature) is not float:
        try:
            answer = replace(answer, acceleration=float(a), curvature=float(curvature))
        except OverflowError:
            raise FunctionError("answered a number beyond all floats") from None
    if not (math.isfinite(answer.acceleration) and math.isfinite(answer.curvature)):
        raise FunctionError(f"answered acceleration {a}, curvature {curvature}")
    return answer


def _placeable(answer: Placement) -> bool:
    state = answer.state
    return isinstance(state, EgoState) and math.isfinite(state.x + state.y + state.heading + state.v)
