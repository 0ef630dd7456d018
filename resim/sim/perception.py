"""Perception: what of the true world the AD function is shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from resim.core.geometry import Floats, to_frame, wrap_angle
from resim.core.tracks import Strings
from resim.sim.adfunction import EgoState, Perceived


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """The truth at time t [s]: the EGO, and N traffic objects in the map frame, arrays (N,) in SI units."""

    t: float
    ego: EgoState
    ids: Strings
    kind: Strings
    x: Floats
    y: Floats
    heading: Floats
    v: Floats
    length: Floats
    width: Floats


class Perception(Protocol):
    """Turns the truth into what the AD function perceives; keeps its own history between calls."""

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last run; every random draw of the next comes from `rng`."""

    def perceive(self, world: World) -> Perceived:
        """Give what is perceived of the world; called with times that increase."""


class Ideal:
    """Sees every object as it is."""

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to forget."""

    def perceive(self, world: World) -> Perceived:
        """Give the true objects in the EGO's frame."""
        ego = world.ego
        x, y = to_frame(world.x, world.y, ego.x, ego.y, ego.heading)
        turned = wrap_angle(world.heading - ego.heading)
        return Perceived(
            world.t, ego, world.ids, world.kind, x, y, turned, world.v, world.length, world.width
        )  # fmt: skip
