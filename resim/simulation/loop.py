"""The closed loop: perceive, answer, move, for runs of one scenario from its lead-in to its end."""

from __future__ import annotations

import contextlib
import linecache
import math
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from resim.core.errors import FunctionError, ResimError
from resim.core.geometry import Bools, Boxes, Floats, boxes_overlap, constant, wrap_angle
from resim.core.levels import over
from resim.core.plugins.unlisted_files import OpenedFiles
from resim.core.plugins.watchdog import Watchdog, heard, heard_since
from resim.core.tracks import Tracks
from resim.road.driven_route import first_off_routes
from resim.road.opendrive import RoadNetwork, lend_network
from resim.simulation.between import pose_between, shares
from resim.simulation.case import Case, Collision, End, SimulatedDrive
from resim.simulation.engine import Mirror
from resim.simulation.followed_height import FollowedHeight
from resim.simulation.function.batch import PerceivedBatch
from resim.simulation.function.driver import BatchDriver, Driver, cycle_steps, driver_of
from resim.simulation.function.interface import EgoState, Placement, Setup
from resim.simulation.live import live_states
from resim.simulation.perception import PerceptionBatch, Worlds
from resim.simulation.reactive.traffic import ReactiveTraffic
from resim.simulation.traffic import Phase, Stage, staged

Poses = tuple[Floats, Floats, Floats]
"""x, y [m] and heading [rad]."""
_BLOCK = 100
"""Steps between two looks for a collision or the road's edge: as arrays, and back to where it was."""


def drive(cases: Sequence[Case], beside: Callable[[Stage], Mirror] | None = None) -> list[SimulatedDrive]:
    """Drive cases of one scenario in closed loop: at once where function and perceptions can, else one by one.

    cases: alike in all but their perceptions and seeds. beside: what makes the simulator that goes along; None for
    none.

    What each gives does not depend on the others. Where something fails in a batch its halves are driven, down to the
    one that fails.
    """
    if len(cases) > 1 and cases[0].build.in_batches and beside is None and cases[0].traffic is None:
        rngs = [np.random.default_rng(case.seed) for case in cases]
        perception = cases[0].perception.together([case.perception for case in cases[1:]], rngs)
        if perception is not None:
            with contextlib.suppress(FunctionError):
                return ClosedLoop(cases, perception).drive()
            half = len(cases) // 2
            return drive(cases[:half]) + drive(cases[half:])
    return [one for case in cases for one in _alone(case, beside)]


def _alone(case: Case, beside: Callable[[Stage], Mirror] | None) -> list[SimulatedDrive]:
    """Drive one case."""
    perception = case.perception.together((), [np.random.default_rng(case.seed)])
    if perception is None:
        raise ResimError(f"the perception {case.perception.hash} cannot be simulated")
    return ClosedLoop([case], perception, beside).drive()


def _own_z(truth: Tracks) -> Floats | None:
    """Heights (T,) [m] of the EGO."""
    return None if truth.z is None else truth.z[0]


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


class ClosedLoop:
    """B runs as they happen: the EGOs' states and commands, and how each ended.

    A run that has ended goes on with the others, and what comes after its end is forgotten.
    """

    def __init__(
        self,
        cases: Sequence[Case],
        perception: PerceptionBatch,
        beside: Callable[[Stage], Mirror] | None = None,
    ) -> None:
        self.began = time.perf_counter()
        self.cases, self.case, self.perception = cases, cases[0], perception
        case = self.case
        self.stage = stage = staged(case.scenario, case.network, case.step, case.lead_in)
        self.mirror = None if beside is None else beside(stage)
        self.reactive = self.reacting()
        self.plan = stage.plan if self.reactive is None else self.reactive.plan
        self.members = stage.members
        size = (len(stage.plan.t), len(cases))
        self.ego = np.empty((*size, 6))
        self.commands = np.full((*size, 2), np.nan)
        self.z = None if stage.plan.z is None else np.full(size, np.nan)
        self.steps, self.looked = 0, stage.plan.begin
        self.shares = shares(case.step)
        self.runs = [_Run() for _ in cases]
        self.broken: FunctionError | None = None  # what several runs failed with
        self.said = ""
        self.length, self.width = stage.length, stage.width

    def reacting(self) -> ReactiveTraffic | None:
        """Give the traffic that reacts; None where it keeps to its traces."""
        case = self.case
        if case.traffic is None:
            return None
        if case.traffic.drivers == "resim":
            return ReactiveTraffic(self.stage, case.traffic, case.network)
        if self.mirror is None:
            raise ResimError(
                'drivers = "sumo" needs SUMO, which does not run here. Take drivers = "resim", or engine = "sumo"'
            )
        if case.traffic.lane_change.possible and any(road.left_hand for road in case.network.roads.values()):
            raise ResimError(
                f'drivers = "sumo" on {case.network.path.name}: traffic keeps left there, SUMO\'s LC2013 right. '
                'Take drivers = "resim", or possible = false in [lane_change]'
            )
        return ReactiveTraffic(self.stage, case.traffic, case.network, self.mirror.deciders())

    def drive(self) -> list[SimulatedDrive]:
        """Drive from the lead-in's first step to the end. Raises FunctionError where several runs fail with one."""
        case, build = self.case, self.case.build
        cycle = cycle_steps(build, case.step)
        with (
            lend_network(case.network, build.path) as road, Watchdog() as watchdog,
            build.factory.afresh(case.seed) as opened,
        ):  # fmt: skip
            if build.program is None:
                opened.given(build.parameters)
            driver = driver_of(build, watchdog, len(self.cases), record=case.record)
            begin = heard()
            try:
                driver.reset([_setup(case, road, self.stage, case.step * cycle) for case in self.cases])
                self.run(driver, cycle)
            except FunctionError as e:
                self.failed(e, opened)
            try:
                driver.close()
            except FunctionError as e:
                self.failed_on_closing(e)
            self.said = heard_since(begin)
        if self.broken is not None:
            raise self.broken
        drives = [self.result(b, driver, opened) for b in range(len(self.cases))]
        left, taken = self.left_routes(drives), (time.perf_counter() - self.began) / len(drives)
        return [replace(d, left_route=when, time=taken) for d, when in zip(drives, left, strict=True)]

    @property
    def now(self) -> float:
        """Time [s] of the last step."""
        return float(self.plan.t[max(self.steps - 1, 0)])

    def run(self, driver: Driver | BatchDriver, cycle: int) -> None:
        """Take every step, from the lead-in's first to the end."""
        asked = self.ask(cycle)
        seen = next(asked, None)
        while seen is not None:
            answer = driver.step(*seen)
            try:
                seen = asked.send(answer)
            except StopIteration:
                return

    def ask(self, cycle: int) -> Generator[tuple[PerceivedBatch, bool], Floats | Placement, None]:
        """Take every step, and give what is perceived in each cycle and whether it counts; is sent the answer."""
        plan, case, mirror, perceive = self.plan, self.case, self.mirror, self.perception.perceive
        begin, last, runs = plan.begin, len(plan.t) - 1, len(self.cases)
        dt = float(plan.t[1] - plan.t[0])
        guided = np.stack([plan.x, plan.y, plan.heading, plan.v, plan.a, plan.yaw_rate], axis=2)[0]
        live = live_states(case, float(plan.t[last]))
        states: Floats | None = None
        answer: Floats | Placement = np.zeros((runs, 2))
        next_ego, heights = guided[0], self.heights()
        for phase in self.stage.phases:
            told = mirror if phase.shown else None
            if told is not None:
                told.enter(phase)
            worlds, places = self.world_of(phase)
            for k in range(phase.first, phase.after):
                self.ego[k] = next_ego
                ego = constant(self.ego[k])
                if told is not None:
                    told.advance(k - phase.first, EgoState(*ego[0].tolist()), places(k))
                if self.z is not None:
                    self.z[k] = plan.z[0, k] if k < begin else heights(ego)  # type: ignore[index]
                self.steps = k + 1
                if k - self.looked >= _BLOCK and self.look():
                    return
                if k == begin and not case.open_loop:
                    states = self.settled(ego)
                if (k - begin) % cycle == 0:
                    z = None if self.z is None else self.z[k]
                    world = worlds(k, ego, z)
                    if live is not None:
                        live.show(world)
                    answer = yield perceive(world), k >= begin
                if k == last:
                    break
                if self.reactive is not None and k >= begin:
                    self.reactive.advance(k, ego[0], math.nan if self.z is None else float(self.z[k, 0]))
                if states is None:
                    if k >= begin and not isinstance(answer, Placement):
                        self.commands[k] = answer
                    next_ego = guided[k + 1]
                elif isinstance(answer, Placement):
                    next_ego = np.array(answer.state)
                    states = self.settled(next_ego[None])
                else:
                    self.commands[k] = answer
                    case.vehicle.advance(states, answer, dt)
                    next_ego = states[:, :6]
        self.look()

    def world_of(
        self, phase: Phase
    ) -> tuple[Callable[[int, Floats, Floats | None], Worlds], Callable[[int], Floats | None]]:
        """Give what gives the truth at a step of a phase, and where its objects are that may not be on their traces."""
        reactive = self.reactive
        if reactive is None:
            return phase.worlds, lambda k: None
        return partial(reactive.worlds, phase), partial(reactive.places, phase)

    def settled(self, ego: Floats) -> Floats:
        """Give the states (B, 8) in which vehicles move on as (B, 6) say."""
        return np.array([self.case.vehicle.settle(EgoState(*one)) for one in ego.tolist()])

    def heights(self) -> Callable[[Floats], list[float]]:
        """Give what gives the heights [m] of the EGOs at their next places, from the scenario's begin on."""
        plan = self.plan
        if plan.z is None:
            return lambda ego: []
        start, z = plan.state(0, plan.begin), float(plan.z[0, plan.begin])
        followed = [FollowedHeight(self.case.network, start.x, start.y, z) for _ in self.cases]
        return lambda ego: [one.at(x, y) for one, (x, y) in zip(followed, ego[:, :2].tolist(), strict=True)]

    def failed(self, e: FunctionError, opened: OpenedFiles) -> None:
        """End the run with the function's failure, unless it had ended before."""
        if self.look():
            return
        if len(self.runs) > 1:
            self.broken = e
            return
        remedy = opened.remedy()
        why = f"{self.case.build.label} at t = {self.now:.2f} s {e}" + (f". {remedy}" if remedy else "")
        self.runs[0].fail(why, e)

    def failed_on_closing(self, e: FunctionError) -> None:
        """End the run with that."""
        if len(self.runs) > 1:
            self.broken = self.broken or e
            return
        self.runs[0].fail(f"{self.case.build.label} on closing {e}", e)

    def look(self) -> bool:
        """Look at the steps since the last look; say whether all runs ended in one or before."""
        first, self.looked = self.looked, self.steps
        on = [b for b, run in enumerate(self.runs) if not run.ended]
        if first < self.steps and on:
            steps, plan = slice(first, self.steps), self.plan
            own = (self.ego[steps, on, 0], self.ego[steps, on, 1], self.ego[steps, on, 2])
            hit, off = self.touched(
                steps, on, own, (plan.x[1:, steps], plan.y[1:, steps], plan.heading[1:, steps])
            )
            for share in self.shares:
                inner_hit, inner_off = self.touched(steps, on, *self.between(steps, on, share))
                hit, off = hit | inner_hit, off | inner_off
            for k, b in enumerate(on):
                self.look_at(b, first, hit[:, :, k], off[:, k])
        return all(run.ended for run in self.runs)

    def look_at(self, b: int, first: int, hit: Bools, off: Bools) -> None:
        """Look at a run's steps from `first` on: whom it hit (N, K), and when it was off the road (K,)."""
        run, count = self.runs[b], hit.shape[1]
        struck = hit.any(axis=0)
        ends = [(int(np.argmax(off)), "off_road")] if off.any() else []
        if self.case.stop_at_collision and struck.any():
            ends.append((int(np.argmax(struck)), "collision"))
        stop = min(ends)[0] if ends else count - 1
        known = {c.id for c in run.collisions}
        for n in np.flatnonzero(hit[:, : stop + 1].any(axis=1)).tolist():
            name = self.members[n + 1].id
            if name not in known:
                t = float(self.plan.t[first + int(np.argmax(hit[n]))])
                run.collisions.append(Collision(t, name))
        run.collisions.sort(key=lambda c: (c.t, c.id))
        if ends:
            run.end = "collision" if (stop, "collision") in ends else "off_road"
            run.steps = first + stop + 1
            run.shown = (int(self.perception.shown[b]), int(self.perception.outside[b]))

    def between(self, steps: slice, on: list[int], share: float) -> tuple[Poses, Poses]:
        """Give the poses of EGOs (K, R) and traffic objects (N, K) at a share of the ways to these steps."""
        plan, ks = self.plan, np.arange(steps.start, steps.stop)
        prior = np.maximum(ks - 1, plan.begin)  # what was before the begin is no part of the drive
        ego = self.ego[:, on][..., :4].transpose(2, 0, 1)
        others = np.stack([plan.x[1:], plan.y[1:], plan.heading[1:], plan.v[1:]])
        return (
            pose_between(ego[:, prior], ego[:, ks], share),
            pose_between(others[:, :, prior], others[:, :, ks], share),
        )

    def touched(self, steps: slice, on: list[int], own: Poses, others: Poses) -> tuple[Bools, Bools]:
        """Say (N, K, R) whom the EGOs touch at their poses (K, R), and (K, R) whether they are off the road."""
        x, y, _ = own
        off = ~self.stage.surface.holds(x.ravel(), y.ravel()).reshape(x.shape)
        return self.overlaps(steps, on, own, others), off

    def overlaps(self, steps: slice, on: list[int], own: Poses, others: Poses) -> Bools:
        """Say (N, K, R) which traffic objects' boxes overlap the EGOs', for their poses (K, R) and (N, K)."""
        plan, length, width = self.plan, self.length[:, None, None], self.width[:, None, None]
        x, y, heading = own
        px, py, turned = (part[:, :, None] for part in others)
        reach = 0.5 * (np.hypot(length[1:], width[1:]) + np.hypot(length[0], width[0]))
        hit = np.asarray(np.hypot(px - x, py - y) <= reach)
        if hit.any():
            boxes = Boxes(px, py, turned, length[1:], width[1:])
            hit &= boxes_overlap(Boxes(x, y, heading, length[0], width[0]), boxes)
        if plan.z is not None and self.z is not None:
            hit &= ~over(plan.z[1:, steps, None], self.z[steps, on])
        return hit

    def result(self, b: int, driver: Driver | BatchDriver, opened: OpenedFiles) -> SimulatedDrive:
        """Put together what a run gave, but for its route and its time, and check what a simulator said."""
        run, case = self.runs[b], self.cases[b]
        steps = run.steps or self.steps
        kept = slice(self.plan.begin, max(steps, self.plan.begin + 1))
        whole = self.motion(b, steps)
        control_error = 0.0 if self.mirror is None else self.mirror.off(whole, steps)
        t, motion = self.plan.t[kept], whole[:, :, kept]
        x, y, heading, v, a, yaw_rate = motion
        truth = Tracks(
            t=t, ids=np.array([m.id for m in self.members]), kind=np.array([m.kind for m in self.members]),
            x=x, y=y, heading=wrap_angle(heading), v=v, length=self.length, width=self.width,
            valid=np.isfinite(x), a=a, yaw_rate=yaw_rate, z=self.known_heights(b, steps, kept),
        )  # fmt: skip
        shown, outside = run.shown or (int(self.perception.shown[b]), int(self.perception.outside[b]))
        return SimulatedDrive(
            case=case,
            truth=truth,
            perceived=driver.seen(b, float(t[-1])),
            commands=self.commands[kept, b].copy(),
            plans=driver.plans(b, float(t[-1])),
            collisions=tuple(run.collisions),
            handed_over=() if self.reactive is None else self.reactive.ended(float(t[-1])),
            end=run.end,
            failure=run.failure,
            left_route=None,
            traceback=_lines(run.frames, opened),
            last_words=run.words,
            said=self.said,
            exchanges=driver.exchanges,
            unpinned=opened.note(),
            control_error=control_error,
            shown=shown,
            outside=outside,
            time=0.0,
        )

    def known_heights(self, b: int, steps: int, kept: slice) -> Floats | None:
        """Give the heights (N, T) [m], EGO first; None where none is known."""
        if self.plan.z is None or self.z is None:
            return None
        out = self.plan.z.copy()
        out[0] = np.nan
        out[0, :steps] = self.z[:steps, b]
        return out[:, kept]

    def left_routes(self, drives: Sequence[SimulatedDrive]) -> list[float | None]:
        """Give when [s] each EGO left the measured route."""
        ways = [(d.truth.x[0], d.truth.y[0], d.truth.heading[0], _own_z(d.truth)) for d in drives]
        first = first_off_routes(self.case.network, self.stage.route, ways)
        return [None if k is None else float(d.truth.t[k]) for k, d in zip(first, drives, strict=True)]

    def motion(self, b: int, steps: int) -> Floats:
        """Give what was commanded: (6, N, T) x, y, heading, v, a, yaw rate, EGO first; NaN after the last step."""
        plan = self.plan
        out = np.stack([plan.x, plan.y, plan.heading, plan.v, plan.a, plan.yaw_rate])
        out[:, 0] = np.nan
        out[:, :, steps:] = np.nan
        out[:, 0, :steps] = self.ego[:steps, b].T
        return out


@dataclass
class _Run:
    """How one run ended. steps: 0 for all; shown: samples on its lists, and those outside of the model."""

    end: End = "duration"
    steps: int = 0
    shown: tuple[int, int] | None = None
    failure: str = ""
    frames: Sequence[tuple[str, int, str]] = ()
    words: str = ""
    collisions: list[Collision] = field(default_factory=list)

    @property
    def ended(self) -> bool:
        """Whether it ended before the scenario did."""
        return self.end != "duration"

    def fail(self, why: str, e: FunctionError) -> None:
        """End with the function's failure, unless it had ended otherwise; the first one counts."""
        self.failure, self.frames, self.words = (
            self.failure or why, self.frames or e.frames, self.words or e.words,
        )  # fmt: skip
        self.end = self.end if self.ended else "function_failed"
