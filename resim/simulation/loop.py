"""The closed loop: perceive, answer, move, for one scenario from its lead-in to its end."""

from __future__ import annotations

import linecache
import math
import time
from array import array
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from resim.core.errors import FunctionError
from resim.core.geometry import Bools, Boxes, Floats, boxes_overlap, wrap_angle
from resim.core.levels import over
from resim.core.plugins.unlisted_files import OpenedFiles
from resim.core.plugins.watchdog import Watchdog
from resim.core.tracks import Tracks
from resim.road.driven_route import first_off_route
from resim.road.opendrive import RoadNetwork, lent
from resim.simulation.case import Case, Collision, End, SimulatedDrive
from resim.simulation.engine import Mirror
from resim.simulation.followed_height import FollowedHeight
from resim.simulation.function.driver import Driver, cycle_steps
from resim.simulation.function.interface import Command, EgoState, Placement, Setup
from resim.simulation.traffic import Stage, staged
from resim.simulation.vehicles.model import VehicleState

_BLOCK = 100
"""Steps between two looks for a collision or the road's edge: as arrays, and back to where it was."""


def drive(case: Case, beside: Callable[[Stage], Mirror] | None) -> SimulatedDrive:
    """Drive a case in closed loop. beside: what makes the simulator that goes along; None for none."""
    begin, build = time.perf_counter(), case.build
    cycle = cycle_steps(build, case.step)
    stage = staged(case.scenario, case.network, case.step, case.lead_in)
    loop = _Loop(case, stage, None if beside is None else beside(stage))
    case.perception.reset(np.random.default_rng(case.seed))
    with (
        lent(case.network, build.path) as road, Watchdog() as watchdog, build.factory.afresh(case.seed) as opened,
    ):  # fmt: skip
        driver = Driver(build, watchdog)
        try:
            driver.reset(_setup(case, road, stage, case.step * cycle))
            loop.run(driver, cycle)
        except FunctionError as e:
            loop.failed(f"{build.label} at t = {loop.now:.2f} s {e}{_remedy(opened)}", e.frames)
        try:
            driver.close()
        except FunctionError as e:
            loop.failure, loop.frames = (
                loop.failure or f"{build.label} on closing {e}",
                loop.frames or e.frames,
            )
            loop.end = "function_failed" if loop.end == "duration" else loop.end
    return loop.result(driver, begin, _lines(loop.frames, opened))


def _lines(frames: Sequence[tuple[str, int, str]], opened: OpenedFiles) -> tuple[str, ...]:
    """Where the function failed, a line for each call, of the files that the user knows."""
    return tuple(
        f"{opened.name_of(file)}, line {line}, in {name}: {linecache.getline(file, line).strip()}".rstrip(
            ": "
        )
        for file, line, name in frames
    )


def _remedy(opened: OpenedFiles) -> str:
    """What the user may have to write into the build file, after a failure."""
    remedy = opened.remedy()
    return f". {remedy}" if remedy else ""


def _setup(case: Case, road: RoadNetwork, stage: Stage, cycle: float) -> Setup:
    plan = stage.plan
    step = float(plan.t[1] - plan.t[0])

    def recorded(t: float) -> EgoState:
        return plan.state(0, min(max(round((t - float(plan.t[0])) / step), 0), len(plan.t) - 1))

    last = int(np.flatnonzero(plan.present[0])[-1])
    return Setup(
        road=road,
        start=plan.state(0, plan.begin),
        goal=(float(plan.x[0, last]), float(plan.y[0, last])),
        length=case.scenario.ego.length,
        width=case.scenario.ego.width,
        cycle=cycle,
        seed=case.seed,
        recorded=recorded if case.build.needs_truth else None,
        route=stage.route,
    )


class _Loop:
    """One run as it happens: the EGO's states and commands, and how it ended."""

    def __init__(self, case: Case, stage: Stage, mirror: Mirror | None) -> None:
        self.case, self.mirror = case, mirror
        self.stage, self.plan, self.members = stage, stage.plan, stage.members
        self.steps = 0
        self.z = array("d")  # of the EGO, where heights are known
        self.ego = array("d")  # compact: what a step leaves behind slows the next ones
        self.commands: list[tuple[float, float]] = []
        self.collisions: list[Collision] = []
        self.end: End = "duration"
        self.failure, self.frames = "", tuple[tuple[str, int, str], ...]()
        self.looked = stage.plan.begin
        self.length = np.array([m.length for m in self.members])
        self.width = np.array([m.width for m in self.members])

    @property
    def now(self) -> float:
        """Time [s] of the last step."""
        return float(self.plan.t[max(self.steps - 1, 0)])

    def run(self, driver: Driver, cycle: int) -> None:
        """Take every step, from the lead-in's first to the end."""
        begin, last = self.plan.begin, len(self.plan.t) - 1
        dt = float(self.plan.t[1] - self.plan.t[0])
        case, mirror = self.case, self.mirror
        perceive, move = case.perception.perceive, case.vehicle.step
        state: VehicleState | None = None
        answer: Command | Placement = Command(0.0, 0.0)
        ego, height = self.plan.state(0, 0), self.height()
        for phase in self.stage.phases:
            told = mirror if phase.shown else None
            if told is not None:
                told.enter(phase)
            for k in range(phase.first, phase.after):
                if told is not None:
                    told.advance(k - phase.first, ego)
                self.ego.extend(ego)
                if height is not None:
                    self.z.append(height.at(ego.x, ego.y) if k >= begin else self.led_in(k))
                self.steps = k + 1
                if k - self.looked >= _BLOCK and self.look():
                    return
                if k == begin and not case.open_loop:
                    state = case.vehicle.settle(ego)
                if (k - begin) % cycle == 0:
                    answer = driver.step(
                        perceive(phase.world(k, ego, self.z[-1] if self.z else np.nan)), k >= begin
                    )
                if k == last:
                    break
                if state is None:
                    if k >= begin and isinstance(answer, Command):
                        self.commands.append((answer.acceleration, answer.curvature))
                    ego = self.plan.state(0, k + 1)
                elif isinstance(answer, Placement):
                    self.commands.append((np.nan, np.nan))
                    ego = answer.state
                    state = case.vehicle.settle(ego)
                else:
                    self.commands.append((answer.acceleration, answer.curvature))
                    state = move(state, answer.acceleration, answer.curvature, dt)
                    ego = state.ego
        self.look()

    def height(self) -> FollowedHeight | None:
        """Give the height that the EGO begins the scenario at, to be followed; None where no height is known."""
        plan = self.plan
        if plan.z is None:
            return None
        start = plan.state(0, plan.begin)
        return FollowedHeight(self.case.network, start.x, start.y, float(plan.z[0, plan.begin]))

    def led_in(self, k: int) -> float:
        """Give the height [m] at a step of the lead-in."""
        return math.nan if self.plan.z is None else float(self.plan.z[0, k])

    def failed(self, why: str, frames: tuple[tuple[str, int, str], ...]) -> None:
        """End the run with the function's failure, unless it had ended before."""
        if not self.look():
            self.end, self.failure, self.frames = "function_failed", why, frames

    def look(self) -> bool:
        """Look at the steps since the last look; say whether the run ended in one, and if so forget what came after."""
        first, self.looked = self.looked, self.steps
        if first >= self.steps:
            return False
        steps = np.arange(first, self.steps)
        x, y, heading = np.array(self.ego[6 * first :]).reshape(-1, 6)[:, :3].T
        hit = self.overlaps(steps, x, y, heading)
        off = np.flatnonzero(~self.stage.surface.holds(x, y))
        ends = [(int(off[0]), "off_road")] if len(off) else []
        struck = hit.any(axis=0)
        if self.case.stop_at_collision and struck.any():
            ends.append((int(np.argmax(struck)), "collision"))
        stop = min(ends)[0] if ends else len(steps) - 1
        known = {c.id for c in self.collisions}
        for n in np.flatnonzero(hit[:, : stop + 1].any(axis=1)).tolist():
            name = self.members[n + 1].id
            if name not in known:
                self.collisions.append(Collision(float(self.plan.t[first + int(np.argmax(hit[n]))]), name))
        self.collisions.sort(key=lambda c: (c.t, c.id))
        if not ends:
            return False
        self.end = "collision" if (stop, "collision") in ends else "off_road"
        self.steps = first + stop + 1
        return True

    def overlaps(self, steps: NDArray[np.intp], x: Floats, y: Floats, heading: Floats) -> Bools:
        """Say (N, K) which traffic objects' boxes overlap the EGO's, for its poses (K,) at these steps."""
        plan, length, width = self.plan, self.length[:, None], self.width[:, None]
        px, py = plan.x[1:, steps], plan.y[1:, steps]
        reach = 0.5 * (np.hypot(length[1:], width[1:]) + np.hypot(length[0], width[0]))
        hit = np.asarray(np.hypot(px - x, py - y) <= reach)
        if hit.any():
            others = Boxes(px, py, plan.heading[1:, steps], length[1:], width[1:])
            hit &= boxes_overlap(Boxes(x, y, heading, length[0], width[0]), others)
        if plan.z is not None:
            hit &= ~over(plan.z[1:, steps], np.array(self.z)[steps])
        return hit

    def result(self, driver: Driver, began: float, traceback: tuple[str, ...]) -> SimulatedDrive:
        """Put together what the drive gave, and check what a simulator said. began: s of the process's clock."""
        kept = slice(self.plan.begin, max(self.steps, self.plan.begin + 1))
        whole = self.motion()
        control_error = 0.0 if self.mirror is None else self.mirror.off(whole, self.steps)
        t, motion = self.plan.t[kept], whole[:, :, kept]
        x, y, heading, v, a, yaw_rate = motion
        truth = Tracks(
            t=t, ids=np.array([m.id for m in self.members]), kind=np.array([m.kind for m in self.members]),
            x=x, y=y, heading=wrap_angle(heading), v=v, length=self.length, width=self.width,
            valid=np.isfinite(x), a=a, yaw_rate=yaw_rate, z=self.heights(kept),
        )  # fmt: skip
        commands = np.full((len(t), 2), np.nan)
        given = self.commands[: len(t)]
        commands[: len(given)] = np.array(given).reshape(-1, 2)
        return SimulatedDrive(
            case=self.case,
            truth=truth,
            perceived=tuple(p for p in driver.seen if p.t <= t[-1]),
            commands=commands,
            plans=tuple(p for p in driver.plans if p[0] <= t[-1]),
            collisions=tuple(self.collisions),
            end=self.end,
            failure=self.failure,
            left_route=self.left_route(t, truth),
            traceback=traceback,
            control_error=control_error,
            shown=self.case.perception.shown,
            outside=self.case.perception.outside,
            time=time.perf_counter() - began,
        )

    def heights(self, kept: slice) -> Floats | None:
        """Give the heights (N, T) [m], EGO first; None where none is known."""
        if self.plan.z is None:
            return None
        out = self.plan.z.copy()
        out[0] = np.nan
        out[0, : self.steps] = np.array(self.z)[: self.steps]
        return out[:, kept]

    def left_route(self, t: Floats, truth: Tracks) -> float | None:
        """Give when [s] the EGO left the measured route."""
        own = (truth.x[0], truth.y[0], truth.heading[0])
        z = None if truth.z is None else truth.z[0]
        first = first_off_route(self.case.network, self.stage.route, *own, z=z)
        return None if first is None else float(t[first])

    def motion(self) -> Floats:
        """Give what was commanded: (6, N, T) x, y, heading, v, a, yaw rate, EGO first; NaN after the last step."""
        plan = self.plan
        out = np.stack([plan.x, plan.y, plan.heading, plan.v, plan.a, plan.yaw_rate])
        out[:, 0] = np.nan
        out[:, :, self.steps :] = np.nan
        out[:, 0, : self.steps] = np.array(self.ego).reshape(-1, 6)[: self.steps].T
        return out
