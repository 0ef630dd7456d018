"""Perception: what of the true world the AD function is shown."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, constant
from resim.core.tracks import Strings
from resim.simulation.function.interface import EgoState, Perceived, unknown_heights


class World(NamedTuple):
    """The truth at time t [s]: the EGO, and N traffic objects in the map frame.

    position: (N,) complex, x + iy [m] of the box centres. heading [rad], v [m/s], length, width [m]: (N,). z: (N,) m,
    heights of the road under them, NaN where not known, None where none is; ego_z: m, under the EGO.
    """

    t: float
    ego: EgoState
    ids: Strings
    kind: Strings
    position: NDArray[np.complex128]
    heading: Floats
    v: Floats
    length: Floats
    width: Floats
    z: Floats | None = None
    ego_z: float = math.nan

    @property
    def z_ego(self) -> Floats:
        """Heights (N,) [m] above the road under the EGO, NaN where not known."""
        return unknown_heights(len(self.ids)) if self.z is None else constant(self.z - self.ego_z)


class Perception(Protocol):
    """Turns the truth into what the AD function perceives; keeps its own history between calls."""

    @property
    def hash(self) -> str:
        """Of all that it follows from."""

    @property
    def shown(self) -> int:
        """Samples of objects on the lists since `reset`."""

    @property
    def outside(self) -> int:
        """How many of them lie outside of what the perception was trained for."""

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last run; every random draw of the next comes from `rng`."""

    def perceive(self, world: World) -> Perceived:
        """Give what is perceived of the world; called with times that increase."""


class IdealPerception:
    """Sees every object as it is."""

    hash = "ideal"
    shown = outside = 0

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to forget."""

    def perceive(self, world: World) -> Perceived:
        """Give the true objects in the EGO's frame."""
        ego = world.ego
        away = world.position - complex(ego.x, ego.y)
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        relative = c * away - complex(0.0, s) * away  # of one complex product, processors round differently
        relative = np.frombuffer(relative.tobytes(), complex)  # whoever sees it cannot change it
        turned = math.pi - np.mod((math.pi + ego.heading) - world.heading, 2.0 * math.pi)
        turned = np.frombuffer(turned.tobytes())
        return Perceived(
            world.t, ego, world.ids, world.kind, relative.real, relative.imag, turned, world.v,
            world.length, world.width, world.z_ego,
        )  # fmt: skip
