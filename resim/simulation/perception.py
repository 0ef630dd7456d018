"""Perception: what of the true world the AD function is shown."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, constant
from resim.core.tracks import Strings
from resim.simulation.function.batch import Integers, Keys, PerceivedBatch, batch_of_one
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


class Worlds(NamedTuple):
    """The truth at time t [s] of B runs: the EGOs, and the N traffic objects that all have.

    ego: (B, 6), the fields of `EgoState`. ego_z: (B,) m. The others as `World` has them.
    """

    t: float
    ego: Floats
    ids: Strings
    kind: Strings
    position: NDArray[np.complex128]
    heading: Floats
    v: Floats
    length: Floats
    width: Floats
    z: Floats | None
    ego_z: Floats

    def of(self, b: int) -> World:
        """Give the truth of one run."""
        return World(self.t, EgoState(*self.ego[b].tolist()), *self[2:10], float(self.ego_z[b]))


def worlds_of(world: World) -> Worlds:
    """Give the truth of one run as that of a batch of it alone."""
    return Worlds(world.t, np.array([world.ego]), *world[2:10], np.array([world.ego_z]))


class PerceptionBatch(Protocol):
    """The perceptions of B runs of one scenario at once; none depends on the others, nor on how many there are."""

    @property
    def shown(self) -> Integers:
        """Of each run (B,): samples of objects on its lists so far."""

    @property
    def outside(self) -> Integers:
        """How many of them lie outside of what its perception was trained for."""

    def perceive(self, worlds: Worlds) -> PerceivedBatch:
        """Give what is perceived of the worlds; called with times that increase."""


class Perception(Protocol):
    """Turns the truth into what the AD function perceives."""

    @property
    def hash(self) -> str:
        """Of all that it follows from."""

    def together(
        self, others: Sequence[Perception], rngs: Sequence[np.random.Generator]
    ) -> PerceptionBatch | None:
        """Give those of a batch of runs, this one's and the others'; None where they cannot be one batch.

        rngs: of each run what every random draw of it comes from.
        """


class IdealPerception:
    """Sees every object as it is."""

    hash = "ideal"

    def together(
        self, others: Sequence[Perception], rngs: Sequence[np.random.Generator]
    ) -> PerceptionBatch | None:
        """Give the ideal perceptions of a batch of runs."""
        return _Ideal(len(rngs)) if all(isinstance(other, IdealPerception) for other in others) else None


class _Ideal:
    """Sees every object as it is, in B runs."""

    def __init__(self, runs: int) -> None:
        self.shown = self.outside = np.zeros(runs, dtype=np.intp)
        self._keys, self._last = Keys(runs), np.empty(0, dtype=str)

    def perceive(self, worlds: Worlds) -> PerceivedBatch:
        """Give the true objects in the EGOs' frames."""
        ego = worlds.ego
        if worlds.ids is not self._last:
            self._last, shape = worlds.ids, (len(ego), len(worlds.ids))
            key = constant(self._keys.of_traffic(worlds.ids))
            columns = (key, worlds.ids, worlds.kind, worlds.length, worlds.width)
            self._columns: list[NDArray[Any]] = [np.broadcast_to(column, shape) for column in columns]
            self._count = constant(np.full(*shape))
        away = worlds.position - (ego[:, 0] + 1j * ego[:, 1])[:, None]
        turns = [(math.cos(heading), math.sin(heading)) for heading in ego[:, 2].tolist()]
        c, s = np.array(turns).T[:, :, None]
        relative = c * away - (1j * s) * away  # of one complex product, processors round differently
        x, y = constant(relative.real), constant(relative.imag)  # whoever sees it cannot change it
        turned = math.pi - np.mod((math.pi + ego[:, 2, None]) - worlds.heading, 2.0 * math.pi)
        v = np.broadcast_to(worlds.v, turned.shape)
        z_ego = z_above(worlds)
        key, ids, kind, length, width = self._columns
        return PerceivedBatch(
            worlds.t, ego, self._count, key, ids, kind, x, y, constant(turned), v, length, width, z_ego
        )


def z_above(worlds: Worlds) -> Floats:
    """Give heights (B, N) [m] of the road under the objects above that under the EGOs, NaN where not known."""
    if worlds.z is None:
        return _unknown(len(worlds.ego), len(worlds.ids))
    return constant(worlds.z - worlds.ego_z[:, None])


@lru_cache(maxsize=256)
def _unknown(runs: int, count: int) -> Floats:
    return np.broadcast_to(unknown_heights(count), (runs, count))


class OneRun:
    """The perception of a single run as a batch: what `look` gives of its world."""

    def __init__(self, look: Callable[[World], Perceived]) -> None:
        self.shown = self.outside = np.zeros(1, dtype=np.intp)
        self._look, self._keys = look, Keys(1)

    def perceive(self, worlds: Worlds) -> PerceivedBatch:
        """Give what is perceived."""
        seen = self._look(worlds.of(0))
        return batch_of_one(seen, self._keys.of_list(0, seen.ids))
