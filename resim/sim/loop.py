"""The closed loop: perceive, answer, move, for one scenario from its lead-in to its end."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from resim.core.errors import FunctionError, ResimError
from resim.core.geometry import Floats, boxes_overlap, wrap_angle
from resim.core.tracks import Strings, Tracks
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario
from resim.sim.adfunction import Build, Command, EgoState, Perceived, Placement, Setup
from resim.sim.dynamics import Kinematic, VehicleModel, VehicleState
from resim.sim.guide import Guide, guide
from resim.sim.perception import Ideal, Perception, World
from resim.sim.session import Session, from_sumo, open_session, to_sumo
from resim.sim.surface import Surface
from resim.sim.watchdog import Watchdog

RELAXATION = 3.0
"""Length of the lead-in [s] ("a few seconds", Wagner 2021, Section 5.2.3)."""

_RESET_LIMIT = 60.0  # s of wall clock; building a route, loading weights
_FOLLOWED = 1e-6  # m, m/s; how exactly SUMO has to be where it was told to

End = Literal["duration", "collision", "off_road", "function_failed"]


@dataclass(frozen=True)
class Collision:
    """The EGO's box first overlaps the object's at time t [s]."""

    t: float
    id: str


@dataclass(frozen=True, eq=False)
class Run:
    """What one simulation gave, from the scenario's start on.

    truth: EGO first, then the traffic objects, as read back from SUMO. perceived: one per cycle of the
    function. commands: (T, 2) acceleration [m/s²] and curvature [1/m] that act on the step from each time
    on, NaN for a placement. failure: why the function failed, or "". control_error: the largest difference
    [m] between a commanded and a re-simulated traffic object's position.
    """

    truth: Tracks
    perceived: tuple[Perceived, ...]
    commands: Floats
    plans: tuple[tuple[float, Floats], ...]
    collisions: tuple[Collision, ...]
    end: End
    failure: str
    seed: int
    control_error: float


def simulate(
    scenario: Scenario,
    network: RoadNetwork,
    net: Path,
    build: Build,
    *,
    step: float = 0.04,
    relaxation: float = RELAXATION,
    seed: int = 0,
    perception: Perception | None = None,
    model: VehicleModel | None = None,
    stop_at_collision: bool = True,
    gui: bool = False,
) -> Run:
    """Drive the scenario with the build's AD function in closed loop.

    net: the SUMO net of the scenario's map. step: s, whole milliseconds, of which the build's cycle time is
    a multiple. Faults of the function end the run (`Run.failure`); faults of the input raise ResimError.
    """
    cycle = _cycle_steps(build, step)
    session = open_session(net, step, gui=gui)
    perception, model = perception or Ideal(), model or Kinematic()
    loop = _Loop(
        scenario, guide(scenario, network, step=step, relaxation=relaxation), session, perception, model
    )
    loop.surface = Surface(network, loop.plan.x, loop.plan.y)
    perception.reset(np.random.default_rng(seed))
    with Watchdog() as watchdog:
        driver = _Driver(build, watchdog, cycle)
        try:
            driver.reset(_setup(scenario, network, loop.plan, loop.begin, step * cycle, seed, build))
            loop.run(driver, stop_at_collision)
        except FunctionError as e:
            loop.end, loop.failure = "function_failed", f"{build.label} at t = {loop.now:.2f} s {e}"
        driver.close()
    return loop.result(driver, seed)


def _cycle_steps(build: Build, step: float) -> int:
    if build.cycle_time is None:
        return 1
    steps = round(build.cycle_time / step)
    if steps < 1 or abs(steps * step - build.cycle_time) > 1e-9:
        raise ResimError(
            f"{build.path}: cycle_time {build.cycle_time:g} s is not a multiple of the step, {step:g} s. "
            "Change one of them."
        )
    return steps


def _setup(
    scenario: Scenario, network: RoadNetwork, plan: Guide, begin: int, cycle: float, seed: int, build: Build
) -> Setup:
    def recorded(t: float) -> EgoState:
        return plan.state(0, int(np.clip(round((t - plan.t[0]) / step), 0, len(plan.t) - 1)))

    step = float(plan.t[1] - plan.t[0])
    ego, last = scenario.ego, int(np.flatnonzero(plan.present[0])[-1])
    return Setup(
        road=network,
        start=plan.state(0, begin),
        goal=(float(plan.x[0, last]), float(plan.y[0, last])),
        length=ego.length,
        width=ego.width,
        cycle=cycle,
        seed=seed,
        recorded=recorded if build.needs_truth else None,
    )


class _Driver:
    """The AD function behind its watchdog, called every `cycle` steps; remembers what it saw and planned."""

    def __init__(self, build: Build, watchdog: Watchdog, cycle: int) -> None:
        self.function, self.watchdog, self.cycle, self.limit = build.make(), watchdog, cycle, build.time_limit
        self.seen: list[Perceived] = []
        self.plans: list[tuple[float, Floats]] = []
        self.answer: Command | Placement = Command(0.0, 0.0)

    def reset(self, setup: Setup) -> None:
        self.watchdog.call(_RESET_LIMIT, self.function.reset, setup)

    def step(self, perceived: Perceived, keep: bool) -> None:
        answer = self.watchdog.call(self.limit, self.function.step, perceived)
        if isinstance(answer, Command):
            if not (math.isfinite(answer.acceleration) and math.isfinite(answer.curvature)):
                raise FunctionError(
                    f"answered acceleration {answer.acceleration}, curvature {answer.curvature}"
                )
        elif not isinstance(answer, Placement):
            raise FunctionError(f"answered {answer!r}, not a Command")
        self.answer = answer
        if keep:
            self.seen.append(perceived)
            if isinstance(answer, Command) and answer.plan is not None:
                self.plans.append((perceived.t, answer.plan))

    def close(self) -> None:
        with_limit = self.watchdog.call
        try:
            with_limit(_RESET_LIMIT, self.function.close)
        except FunctionError:
            return


class _Loop:
    """One run's state: arrays of what is commanded and what came back, and the EGO's vehicle state."""

    surface: Surface

    def __init__(
        self, scenario: Scenario, plan: Guide, session: Session, perception: Perception, model: VehicleModel
    ) -> None:
        members = (scenario.ego, *scenario.objects)
        self.plan, self.session, self.perception, self.model = plan, session, perception, model
        self.ids = np.array([m.id for m in members], dtype=str)
        self.kind = np.array([m.kind for m in members], dtype=str)
        self.length = np.array([m.length for m in members])
        self.width = np.array([m.width for m in members])
        self.names = [str(n) for n in range(len(members))]  # SUMO's: whatever characters the ids have
        self.begin = int(np.searchsorted(plan.t, scenario.ego.spawn_time - 1e-6))
        self.step_length = float(plan.t[1] - plan.t[0])
        front = to_sumo(plan.x, plan.y, plan.heading, self.length[:, None])
        self.commanded = np.stack([*front, plan.v], axis=-1).transpose(1, 0, 2).copy()  # (T, N, 4)
        self.read = np.full_like(self.commanded, np.nan)
        self.commands = np.full((len(plan.t), 2), np.nan)
        self.ego_rates = np.full((len(plan.t), 2), np.nan)  # a, yaw rate
        self.reach = 0.5 * (np.hypot(self.length, self.width) + math.hypot(self.length[0], self.width[0]))
        self.collisions: list[Collision] = []
        self.end: End = "duration"
        self.failure = ""
        self.last = -1
        self.rows = np.empty(0, dtype=int)
        self.now = float(plan.t[0])

    def run(self, driver: _Driver, stop_at_collision: bool) -> None:
        plan, begin = self.plan, self.begin
        state: VehicleState | None = None
        ego = plan.state(0, 0)
        for k in range(len(plan.t)):
            self.advance(k, ego)
            if k >= begin and self.finished(k, ego, stop_at_collision):
                return
            if k == begin:
                state = self.model.settle(ego)
            if (k - begin) % driver.cycle == 0:
                driver.step(self.perception.perceive(self.world(k, ego)), keep=k >= begin)
            if k + 1 == len(plan.t):
                return
            if state is None:
                ego = plan.state(0, k + 1)
            else:
                state, ego = self.move(k, state, driver.answer)

    def move(self, k: int, state: VehicleState, answer: Command | Placement) -> tuple[VehicleState, EgoState]:
        """Take the EGO to step k + 1."""
        if isinstance(answer, Placement):
            return state, answer.state
        self.commands[k] = answer.acceleration, answer.curvature
        state = self.model.step(state, answer.acceleration, answer.curvature, self.step_length)
        return state, state.ego

    def advance(self, k: int, ego: EgoState) -> None:
        """Command every object's state at step k to SUMO, step, and read back."""
        present = self.plan.present[1:, k]
        if k == 0 or (present != self.plan.present[1:, k - 1]).any():
            self.populate(k)
        session, rows = self.session, self.rows
        values = self.commanded[k, rows].T if len(rows) < len(self.names) - 1 else self.commanded[k, 1:].T
        session.place(self.present_names[1:], *values)
        session.place_ego("0", ego.x, ego.y, ego.heading, ego.v)
        session.step()
        session.read(self.present_names, self.buffer)
        self.read[k, 0] = self.buffer[0]
        self.read[k, rows] = self.buffer[1:]
        self.ego_rates[k] = ego.a, ego.yaw_rate
        self.last, self.now = k, float(self.plan.t[k])

    def populate(self, k: int) -> None:
        """Let objects come and go."""
        before = set(self.rows.tolist()) if k else set()
        self.rows = 1 + np.flatnonzero(self.plan.present[1:, k])
        for n in sorted(before - set(self.rows.tolist())):
            self.session.remove(self.names[n])
        for n in ([0] if k == 0 else []) + sorted(set(self.rows.tolist()) - before):
            self.session.add(self.names[n], self.length[n], self.width[n], float(self.plan.v[n, k]))
        self.present_names = ["0", *(self.names[n] for n in self.rows)]
        self.buffer = np.empty((len(self.present_names), 4))
        r = self.rows
        self.fixed: tuple[Strings, Strings, Floats, Floats] = (
            self.ids[r],
            self.kind[r],
            self.length[r],
            self.width[r],
        )

    def world(self, k: int, ego: EgoState) -> World:
        """The truth at step k: where the objects were commanded to be, which `result` checks SUMO did."""
        plan, r = self.plan, self.rows
        ids, kind, length, width = self.fixed
        return World(
            self.now, ego, ids, kind, plan.x[r, k], plan.y[r, k], plan.heading[r, k], plan.v[r, k], length, width
        )  # fmt: skip

    def finished(self, k: int, ego: EgoState, stop_at_collision: bool) -> bool:
        """Note collisions; say whether the run ends here."""
        plan, r = self.plan, self.rows
        dx, dy = plan.x[r, k] - ego.x, plan.y[r, k] - ego.y
        near = r[dx * dx + dy * dy <= self.reach[r] ** 2]
        if len(near):
            self.collide(k, ego, near)
            if self.collisions and stop_at_collision:
                self.end = "collision"
                return True
        if not self.surface.holds(ego.x, ego.y):
            self.end = "off_road"
            return True
        return False

    def collide(self, k: int, ego: EgoState, near: np.ndarray[tuple[int], np.dtype[np.intp]]) -> None:
        plan, n = self.plan, near
        hit = boxes_overlap(
            ego.x, ego.y, ego.heading, self.length[0], self.width[0],
            plan.x[n, k], plan.y[n, k], plan.heading[n, k], self.length[n], self.width[n],
        )  # fmt: skip
        known = {c.id for c in self.collisions}
        for name in self.ids[near[hit]].tolist():
            if name not in known:
                self.collisions.append(Collision(self.now, name))

    def result(self, driver: _Driver, seed: int) -> Run:
        kept = slice(self.begin, max(self.last, self.begin) + 1)
        read = self.read[kept].transpose(2, 1, 0)
        x, y, heading = from_sumo(read[0], read[1], read[2], self.length[:, None])
        plan = self.plan
        error = np.abs(self.read[kept, 1:] - self.commanded[kept, 1:])
        error = error[np.isfinite(error)]
        control_error = float(error.max()) if error.size else 0.0
        if control_error > _FOLLOWED:
            raise ResimError(
                f"SUMO did not put the traffic objects where it was told to: off by {control_error:g}"
            )
        a, yaw_rate = plan.a[:, kept].copy(), plan.yaw_rate[:, kept].copy()
        a[0], yaw_rate[0] = self.ego_rates[kept].T
        truth = Tracks(
            t=plan.t[kept], ids=self.ids, kind=self.kind, x=x, y=y, heading=wrap_angle(heading), v=read[3],
            length=self.length, width=self.width, valid=np.isfinite(x), a=a, yaw_rate=yaw_rate,
        )  # fmt: skip
        return Run(
            truth=truth,
            perceived=tuple(driver.seen),
            commands=self.commands[kept],
            plans=tuple(driver.plans),
            collisions=tuple(self.collisions),
            end=self.end,
            failure=self.failure,
            seed=seed,
            control_error=control_error,
        )
