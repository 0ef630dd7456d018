"""The CommonRoad reactive planner as an AD function: lanes and objects in, an acceleration and a curvature out.

It replans in every cycle from the EGO's state. The planner itself is unchanged.
"""

from __future__ import annotations

import copy
import math
import sys
import warnings
from collections.abc import Sequence
from typing import Any

import commonroad_dc.pycrcc as crcc
import numpy as np
from commonroad.scenario.lanelet import Lanelet
from commonroad.scenario.scenario import Scenario
from commonroad_rp.reactive_planner import ReactivePlanner
from commonroad_rp.state import ReactivePlannerState
from commonroad_rp.utility.config import ReactivePlannerConfiguration
from commonroad_rp.utility.utils_coordinate_system import create_coordinate_system

from adfunc.reactive_planner.road import Way, driven, reference_lanes, reference_path, road_edge
from resim.function import Command, EgoState, ObjectList, RunSetup

STANDING = 0.5
"""m/s below which a yaw rate says nothing of the steering."""


class ReactivePlannerFunction:
    """Drives by the optimal trajectory; where there is none, brakes along the lane.

    desired_speed [m/s]: that of the start, if not given. look_ahead [s]: the command is what the trajectory has then:
    half a cycle, and the vehicle's lag. margin [m]: how much wider and longer objects are taken, on each side. braking
    [m/s²]: where the planner finds no trajectory. planning, sampling: fields of the planner's configuration.
    """

    def __init__(
        self,
        *,
        desired_speed: float | None = None,
        look_ahead: float = 0.25,
        margin: float = 0.2,
        braking: float = 8.0,
        planning: dict[str, Any] | None = None,
        sampling: dict[str, Any] | None = None,
    ) -> None:
        self.desired_speed, self.look_ahead = desired_speed, look_ahead
        self.margin, self.braking = margin, braking
        self.planning, self.sampling = planning or {}, sampling or {}
        self.each: list[ReactivePlannerFunction] = []
        self.without: list[tuple[float, str]] = []

    def reset(self, setup: RunSetup) -> None:
        """Make the planner for this road and EGO."""
        self.setup, self.wanted = setup, setup.start.v if self.desired_speed is None else self.desired_speed
        config = ReactivePlannerConfiguration()
        config.debug.multiproc, config.debug.logging_level = False, "CRITICAL"
        config.vehicle.length, config.vehicle.width = setup.length, setup.width
        for part, given in ((config.planning, self.planning), (config.sampling, self.sampling)):
            for name, value in given.items():
                if not hasattr(part, name):
                    raise ValueError(f"{type(part).__name__} has no {name!r}")
                part[name] = value
        way = reference_lanes(setup)
        config.update(scenario=_scenario(setup, way, config.planning.dt))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its numerics: it smooths the path within 7 cm
            self.path = create_coordinate_system(reference_path(setup, way))
        self.edge = crcc.ShapeGroup()
        for one, other in road_edge(setup, way):
            (dx, dy), at = (other - one).tolist(), (0.5 * (one + other)).tolist()
            self.edge.add_shape(crcc.RectOBB(0.5 * math.hypot(dx, dy), 0.01, math.atan2(dy, dx), *at))
        self.config, self.planner = config, ReactivePlanner(config)
        self.times = config.planning.dt * np.arange(config.planning.time_steps_computation + 1)
        self.steering, self.cycles = 0.0, 0

    def step(self, perceived: ObjectList) -> Command:
        """Plan from here, and answer with what the optimal trajectory has a moment ahead."""
        ego, car = perceived.ego, self.config.vehicle
        if ego.v > STANDING:
            self.steering = math.atan(car.wheelbase * ego.yaw_rate / ego.v)
        self.cycles += perceived.t >= 0.0  # before, the EGO is guided, whatever is answered
        try:
            states = self.planned(ego, perceived)
            why = "all of its trajectories collide or cannot be driven"
        except Exception as e:  # somebody else's code: whatever it fails with, the vehicle has to go on
            states, why = None, f"{type(e).__name__}: {e}"
        if states is None:
            self.without += [(perceived.t, why)] if perceived.t >= 0.0 else []
            return self.brake(perceived.t, ego)
        t = perceived.t + self.times
        states = [*states, *[states[-1]] * (len(t) - len(states))]  # where it stands, it tells one state less
        shifted = [ReactivePlannerState.shift_state_to_center(state, car.wb_rear_axle) for state in states]
        plan = [
            (t_k, *one.position, max(one.velocity, 0.0)) for t_k, one in zip(t.tolist(), shifted, strict=True)
        ]
        then = perceived.t + self.look_ahead
        a = np.interp(then, t, [state.acceleration for state in states])
        curvature = np.tan(np.interp(then, t, [state.steering_angle for state in states])) / car.wheelbase
        return Command(float(a), float(curvature), plan)

    def reset_batch(self, setups: Sequence[RunSetup]) -> None:
        """Make a planner for each run: they share what it takes to import it."""
        for setup in setups:
            self.each.append(copy.copy(self))
            self.each[-1].each, self.each[-1].without = [], []
            self.each[-1].reset(setup)

    def step_batch(self, lists: Sequence[ObjectList]) -> list[Command]:
        """Plan for each run."""
        return [one.step(perceived) for one, perceived in zip(self.each, lists, strict=True)]

    def planned(self, ego: EgoState, perceived: ObjectList) -> Any:
        """The states of the optimal trajectory; None where there is none."""
        planner = self.planner
        state = ReactivePlannerState(
            time_step=0, position=np.array(self.rear(ego)), steering_angle=self.steering, velocity=max(ego.v, 0.0),
            orientation=ego.heading, acceleration=ego.a, yaw_rate=ego.yaw_rate,
        )  # fmt: skip
        planner.reset(
            initial_state_cart=state, collision_checker=self.obstacles(perceived), coordinate_system=self.path
        )
        # at a speed of exactly 0 it would look for a planning problem, which there is none of
        planner.set_desired_velocity(self.wanted, max(ego.v, 1e-3))
        found = planner.plan()
        return None if found is None else found[0].state_list

    def obstacles(self, perceived: ObjectList) -> Any:
        """The road's edge, and every object at its speed and heading for as long as the planner looks ahead.

        Who comes up from behind in the EGO's lane minds the EGO, and not the other way round.
        """
        ego, p, m = perceived.ego, perceived, self.margin
        checker = crcc.CollisionChecker()
        checker.add_collision_object(self.edge)
        t = self.times
        cos, sin = math.cos(ego.heading), math.sin(ego.heading)
        length, width = self.setup.length + p.length, self.setup.width + p.width
        behind = (p.x_ego < -0.5 * length) & (np.abs(p.y_ego) < 0.5 * width)
        for n in np.flatnonzero(~behind):
            heading = ego.heading + p.heading_ego[n]
            x = ego.x + cos * p.x_ego[n] - sin * p.y_ego[n] + p.v[n] * math.cos(heading) * t
            y = ego.y + sin * p.x_ego[n] + cos * p.y_ego[n] + p.v[n] * math.sin(heading) * t
            moving = crcc.TimeVariantCollisionObject(0)
            half_length, half_width = float(0.5 * p.length[n] + m), float(0.5 * p.width[n] + m)
            for at in zip(x.tolist(), y.tolist(), strict=True):
                moving.append_obstacle(crcc.RectOBB(half_length, half_width, float(heading), *at))
            checker.add_collision_object(moving)
        return checker

    def brake(self, t: float, ego: EgoState) -> Command:
        """Brake hard along the reference path, back to its middle, critically damped at 0.8 rad/s."""
        path = self.path
        s, d = path.convert_to_curvilinear_coords(*self.rear(ego))
        turn = math.remainder(ego.heading - float(np.interp(s, path.ref_pos, path.ref_theta)), 2.0 * math.pi)
        v = max(ego.v, 3.0)
        bend = float(np.interp(s + 0.15 * v, path.ref_pos, path.ref_curv))
        curvature = bend - (0.64 * d + 1.6 * v * math.sin(turn)) / v**2
        plan = []
        for dt in self.times.tolist():
            speed = max(ego.v - self.braking * dt, 0.0)
            ahead = (ego.v**2 - speed**2) / (2.0 * self.braking) + self.config.vehicle.wb_rear_axle
            plan.append((t + dt, *path.convert_to_cartesian_coords(s + ahead, d), speed))
        return Command(-self.braking if ego.v > 0.0 else 0.0, curvature, plan)

    def rear(self, ego: EgoState) -> tuple[float, float]:
        """Where the rear axle is, of which the planner thinks [m]."""
        back = self.config.vehicle.wb_rear_axle
        return ego.x - back * math.cos(ego.heading), ego.y - back * math.sin(ego.heading)

    def close(self) -> None:
        """Tell how often it had no trajectory, and let go of the planner before the process ends."""
        for one in self.each:
            one.close()
        self.each, self.planner, self.path, self.edge = [], None, None, None
        if self.without:
            t, why = self.without[0]
            print(
                f"reactive planner: no trajectory in {len(self.without)} of {self.cycles} cycles, "
                f"first at {t:.2f} s ({why}): braked along the lane",
                file=sys.stderr,
            )


def _scenario(setup: RunSetup, way: Way, dt: float) -> Any:
    """The road as the planner wants it to begin with: a lanelet for each lane of the reference path."""
    scenario = Scenario(dt)
    for k, _ in way:
        left, centre, right = (driven(setup.road.lanes[k], line) for line in ("left", "centre", "right"))
        scenario.add_objects(Lanelet(left, centre, right, k + 1))
    return scenario
