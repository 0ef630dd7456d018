"""Objects that are not there."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from resim.perception.model import FalseObjects
from resim.simulation.function.interface import EgoState

KIND = "car"
"""What false objects are taken for."""


@dataclass(frozen=True, slots=True)
class FalseObject:
    """One, from `since` [s] on at `position` (x + iy, map) with the speed `v` [m/s] along `heading`, to `until` [s]."""

    id: str
    since: float
    until: float
    position: complex
    heading: float
    v: float

    def at(self, t: float) -> complex:
        """Give where it is at t [s], in the map."""
        return self.position + (t - self.since) * cmath.rect(self.v, self.heading)


class Clutter:
    """False objects as they come and go: a Poisson process, stationary from its start."""

    def __init__(self, model: FalseObjects, rng: np.random.Generator) -> None:
        self.model, self.rng = model, rng
        self.alive: list[FalseObject] = []
        self.count = 0
        self.birth = -math.inf

    def at(self, t: float, ego: EgoState) -> list[FalseObject]:
        """Give those that are there at t [s], later than the last."""
        model, rng = self.model, self.rng
        if self.birth == -math.inf:
            for _ in range(int(rng.poisson(model.rate * model.lifetime))):
                self.alive.append(self.new(t, t, ego))
            self.birth = t + rng.exponential(1.0 / model.rate)
        while self.birth <= t:
            self.alive.append(self.new(self.birth, t, ego))
            self.birth += rng.exponential(1.0 / model.rate)
        if self.alive:
            self.alive = [one for one in self.alive if one.until > t]
        return self.alive

    def new(self, since: float, t: float, ego: EgoState) -> FalseObject:
        """Make one that came `since` [s] and is where it is as the EGO sees it at t [s]."""
        model, rng = self.model, self.rng
        self.count += 1
        life, distance = rng.exponential(model.lifetime), rng.uniform(0.0, model.range)
        bearing, v = (
            rng.uniform(-model.bearing, model.bearing),
            model.speed + model.speed_spread * rng.standard_normal(),
        )
        position = complex(ego.x, ego.y) + cmath.rect(distance, ego.heading + bearing)
        return FalseObject(f"false{self.count}", t, since + life, position, ego.heading, v)
