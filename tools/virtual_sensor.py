"""The virtual sensors of the drives that ship: objects too far ahead, and speeds that are derived, hence late."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resim.core.geometry import from_frame, to_frame, wrap_angle
from resim.simulation.function.interface import EgoState, Perceived
from resim.simulation.perception import OneRun, Perception, PerceptionBatch, World

STEP = 0.04
"""s between two images of the sensors, and between two steps of the simulation."""


@dataclass(frozen=True)
class SensorErrors:
    """Errors of the virtual sensors, of the sizes of Wagner 2021, Section 5.2.1.

    too_far, drift [m]: mean and standard deviation of an object's distance error, forwards, and drift_time [s]
    its correlation time. noise [m]: white noise of an object's position. window [s]: speed and heading of
    objects are the slope of a line through their positions over this time, so they are half of it late.
    ego_x, ego_y, ego_noise [m]: localisation error of the EGO, mean forwards and left, and white noise;
    ego_v [m/s] its mean speed error and ego_v_noise its white noise; ego_heading_noise [rad].
    """

    too_far: float = 1.53
    drift: float = 0.25
    drift_time: float = 2.0
    noise: float = 0.03
    window: float = 1.6
    ego_x: float = -0.10
    ego_y: float = 0.19
    ego_noise: float = 0.05
    ego_v: float = 0.036
    ego_v_noise: float = 0.042
    ego_heading_noise: float = 1.8e-4


class Sensor:
    """A perception whose objects are too far ahead, and whose speeds and headings are derived, hence late."""

    def __init__(self, errors: SensorErrors = SensorErrors()) -> None:
        self.errors, self.hash = errors, repr(errors)

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last drive."""
        self.rng = rng
        self.drift: dict[str, float] = {}
        self.seen: dict[str, list[tuple[float, float, float]]] = {}

    def together(
        self, others: Sequence[Perception], rngs: Sequence[np.random.Generator]
    ) -> PerceptionBatch | None:
        """Give that of one run."""
        if others:
            return None
        self.reset(rngs[0])
        return OneRun(self.perceive)

    def perceive(self, world: World) -> Perceived:
        """Give what the sensors make of the world."""
        ego = self.localise(world.ego)
        true = world.ego
        x, y = to_frame(world.position.real, world.position.imag, true.x, true.y, true.heading)
        x = x + np.array([self.wander(name) for name in world.ids.tolist()])
        x = x + self.errors.noise * self.rng.standard_normal(len(x))
        y = y + self.errors.noise * self.rng.standard_normal(len(y))
        map_x, map_y = from_frame(x, y, ego.x, ego.y, ego.heading)
        motion = [
            self.derive(name, world.t, px, py, h, v)
            for name, px, py, h, v in zip(
                world.ids.tolist(),
                map_x.tolist(),
                map_y.tolist(),
                world.heading.tolist(),
                world.v.tolist(),
                strict=True,
            )
        ]
        v, heading = np.array(motion).reshape(len(motion), 2).T
        turned = wrap_angle(heading - ego.heading)
        return Perceived(world.t, ego, world.ids, world.kind, x, y, turned, v, world.length, world.width)

    def localise(self, ego: EgoState) -> EgoState:
        """Give the EGO's state as its own sensors have it."""
        e, rng = self.errors, self.rng
        x, y = from_frame(
            e.ego_x + e.ego_noise * rng.standard_normal(), e.ego_y + e.ego_noise * rng.standard_normal(),
            ego.x, ego.y, ego.heading,
        )  # fmt: skip
        v = ego.v + e.ego_v + e.ego_v_noise * rng.standard_normal()
        heading = ego.heading + e.ego_heading_noise * rng.standard_normal()
        return ego._replace(x=float(x), y=float(y), v=v, heading=heading)

    def wander(self, name: str) -> float:
        """Give the object's distance error [m]: a first-order autoregression about its mean."""
        e = self.errors
        keep = np.exp(-STEP / e.drift_time)
        last = self.drift.get(name, e.drift * self.rng.standard_normal())
        self.drift[name] = keep * last + e.drift * np.sqrt(1.0 - keep**2) * self.rng.standard_normal()
        return e.too_far + self.drift[name]

    def derive(
        self, name: str, t: float, x: float, y: float, heading: float, v: float
    ) -> tuple[float, float]:
        """Give speed and heading from the positions of the last `window` seconds."""
        track = self.seen.setdefault(name, [])
        track.append((t, x, y))
        while track[0][0] < t - self.errors.window - 1e-9:
            track.pop(0)
        if t - track[0][0] < 0.5 * self.errors.window:
            return v, heading
        times, xs, ys = np.array(track).T
        times = times - times.mean()
        vx, vy = (float(times @ c / (times @ times)) for c in (xs, ys))
        return float(np.hypot(vx, vy)), float(np.arctan2(vy, vx))
