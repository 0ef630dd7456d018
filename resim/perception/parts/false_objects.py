"""Objects that are not there."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, model_validator

from resim.core.geometry import wrap_angle
from resim.perception.fields import NotNegative, Number, ParameterGroup, Positive
from resim.perception.parts.definition import PerceptionPart, RunningPart

if TYPE_CHECKING:
    from resim.simulation.function.interface import EgoState, Perceived
    from resim.simulation.perception import World

MOST_FALSE = 100.0
"""False objects on the list at once, in the mean."""

KIND = "car"
"""What false objects are taken for."""


class FalseObjects(ParameterGroup):
    """Objects that are not there: rate [1/s] at which they appear, mean lifetime [s], and where and how fast they are.

    Range [m] and |bearing| [rad] are uniform up to their limits; speed over ground [m/s] is normal, along the EGO's
    heading, and kept. length, width: m.
    """

    rate: Annotated[float, Field(strict=True, ge=0.0, le=100.0)] = 0.0
    lifetime: Positive = 0.5
    range: Positive = 80.0
    bearing: Positive = 0.5
    speed: Number = 0.0
    speed_spread: NotNegative = 0.0
    length: Positive = 4.7
    width: Positive = 1.9

    @model_validator(mode="after")
    def _not_a_crowd(self) -> FalseObjects:
        if self.rate * self.lifetime > MOST_FALSE:
            raise ValueError(
                f"rate: expected at most {MOST_FALSE:g} objects at once on average, rate x lifetime, found "
                f"{self.rate:g} x {self.lifetime:g} = {self.rate * self.lifetime:g}; lower rate or lifetime"
            )
        return self


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


class Clutter(RunningPart):
    """False objects as they come and go: a Poisson process, stationary from its start."""

    def __init__(self, model: FalseObjects, rng: np.random.Generator) -> None:
        self.model, self.rng = model, rng
        self.alive: list[FalseObject] = []
        self.count = 0
        self.birth = -math.inf

    def change(self, seen: Perceived, world: World, step: float) -> Perceived:
        """Give the list with those that are there now."""
        here = self.at(world.t, world.ego)
        if here and not (names := set(world.ids.tolist())).isdisjoint(one.id for one in here):
            here = self.alive = [self._renamed(one, names) if one.id in names else one for one in here]
        return with_false(seen, here, self.model, world.ego)

    def _renamed(self, one: FalseObject, names: set[str]) -> FalseObject:
        """Give it an id that no object there has: nobody is seen for a false object's sake."""
        while True:
            self.count += 1
            if (name := f"false{self.count}") not in names:
                return replace(one, id=name)

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


def with_false(seen: Perceived, false: list[FalseObject], model: FalseObjects, ego: EgoState) -> Perceived:
    """Give the list with false objects; ego: the true one."""
    if not false:
        return seen
    n = len(false)
    places = np.array([one.at(seen.t) for one in false]) - complex(ego.x, ego.y)
    places *= cmath.rect(1.0, -ego.heading)
    more = (
        (seen.ids, np.array([one.id for one in false])),
        (seen.kind, np.full(n, KIND)),
        (seen.x_ego, places.real),
        (seen.y_ego, places.imag),
        (seen.heading_ego, wrap_angle(np.array([one.heading for one in false]) - ego.heading)),
        (seen.v, np.array([one.v for one in false])),
        (seen.length, np.full(n, model.length)),
        (seen.width, np.full(n, model.width)),
        (seen.z_ego, np.full(n, np.nan)),
    )
    return type(seen)(seen.t, seen.ego, *(np.concatenate(parts) for parts in more))


FALSE_OBJECTS = PerceptionPart(
    name="false_objects",
    parameters=FalseObjects,
    make=lambda model, streams: Clutter(model, streams.of()) if model.rate > 0.0 else None,
)
