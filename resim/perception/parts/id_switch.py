"""Objects that get another id."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from resim.perception.parts.definition import PerceptionPart, RunningPart
from resim.perception.runtime.streams import PartStreams

if TYPE_CHECKING:
    from resim.core.tracks import Strings
    from resim.simulation.function.interface import Perceived
    from resim.simulation.perception import World


class IdSwitches(RunningPart):
    """Switches as they come: to each object by a Poisson process, felt where it is on the list at that time."""

    def __init__(self, rate: float, streams: PartStreams) -> None:
        self.rate, self.streams = rate, streams
        self.present: Strings | None = None
        self.rng: dict[str, np.random.Generator] = {}
        self.due: dict[str, float] = {}
        self.next = math.inf
        self.count: dict[str, int] = {}
        self.last, self.ids = (0, b""), np.empty(0, dtype=str)

    def change(self, seen: Perceived, world: World, step: float) -> Perceived:
        """Give the list with the ids that objects have by now."""
        if world.ids is not self.present:
            self._meet(world)
        if world.t >= self.next:
            self._switch(set(seen.ids.tolist()), world.t)
        if not self.count:
            return seen
        key = len(seen.ids), seen.ids.tobytes()
        if key != self.last:
            self.last, self.ids = key, self._named(seen.ids)
        return replace(seen, ids=self.ids)

    def _named(self, ids: Strings) -> Strings:
        """Give the ids that objects have by now; whoever sees them cannot change them."""
        count = self.count
        named = np.array([f"{n}#{count[n]}" if n in count else n for n in ids.tolist()], dtype=str)
        named.setflags(write=False)
        return named

    def _meet(self, world: World) -> None:
        """Let objects come and go; what comes draws anew."""
        self.present, names = world.ids, world.ids.tolist()
        new = [name for name in names if name not in self.due]
        self.rng |= {name: self.streams.of(name) for name in new}
        self.due = {name: self.due[name] for name in names if name not in new}
        self.due |= {name: self._after(name, world.t) for name in new}
        self.next, self.last = min(self.due.values(), default=math.inf), (0, b"")
        self._avoid_others()

    def _switch(self, seen: set[str], t: float) -> None:
        """Give objects that are due, and on the list, another id."""
        for name in [name for name, due in self.due.items() if due <= t]:
            self.due[name] = self._after(name, t)
            if name in seen:
                self.count[name] = self.count.get(name, 1) + 1
        self._avoid_others()
        self.next, self.last = min(self.due.values()), (0, b"")

    def _avoid_others(self) -> None:
        """Take no id that another object has."""
        names = () if self.present is None else set(self.present.tolist())
        for name in self.count:
            while f"{name}#{self.count[name]}" in names:
                self.count[name] += 1

    def _after(self, name: str, t: float) -> float:
        """When [s] the next switch of an object is due."""
        return t + float(self.rng[name].exponential(1.0 / self.rate))


ID_SWITCH = PerceptionPart(
    name="id_switch",
    parameters=float,
    make=lambda rate, streams: IdSwitches(rate, streams) if rate > 0.0 else None,
)
