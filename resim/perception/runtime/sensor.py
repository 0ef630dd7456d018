"""A perception model in the closed loop: turns the true world into what the model perceives of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.core.tracks import Strings
from resim.perception.model import PerceptionModel
from resim.perception.runtime.clutter import Clutter
from resim.perception.runtime.detection import DetectionState
from resim.perception.runtime.ego_state import PerceivedEgoState, is_wrong
from resim.perception.runtime.history import History
from resim.perception.runtime.kernel import IDENTITY, Q, perceive
from resim.perception.runtime.lists import HeldList, limits, with_false
from resim.perception.runtime.object_errors import ObjectErrorState
from resim.perception.runtime.streams import RandomRows, Streams
from resim.scenario.maneuvers import MANEUVERS
from resim.simulation.function.interface import EgoState, Perceived
from resim.simulation.perception import World

_SAME = 1e-9  # s

Columns = NDArray[np.intp]


class Sensor:
    """Perceives the world as the model says (`resim.simulation.perception.Perception`).

    Where objects are is relative to the true EGO; what the EGO knows of itself has errors of its own.
    """

    def __init__(self, model: PerceptionModel) -> None:
        self.model, self.hash = model, model.hash
        sets, own = [model.pooled, *model.maneuvers.values()], list(model.maneuvers)
        set_of = np.array([own.index(m) + 1 if m in own else 0 for m in MANEUVERS])
        self._history = History(sets, set_of)
        self._errors = ObjectErrorState(sets)
        self._sight = DetectionState(model.detection, model.field_of_view)
        self._limits = limits(model.validity)
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last run; every random draw of the next comes from `rng`."""
        model, self._streams = self.model, Streams(rng)
        of = self._streams.of
        self._own = PerceivedEgoState(model.ego, of("ego")) if is_wrong(model.ego) else None
        self._clutter = Clutter(model.false_objects, of("false")) if model.false_objects.rate > 0.0 else None
        self._timing = of("update")
        self._t = self._listed = self._due = -math.inf
        self._held: HeldList | None = None
        self._names: list[str] = []
        self._ids: Strings | None = None
        self._shown: Strings | None = None
        self._switched: dict[str, int] = {}
        self._rows = RandomRows()
        for part in (self._history, self._errors, self._sight):
            part.clear()
        self._shown_so_far = self._outside = 0

    @property
    def shown(self) -> int:
        """Samples of objects on the lists so far."""
        return self._shown_so_far

    @property
    def outside(self) -> int:
        """How many of `shown` lie outside of what the model was trained for (`validity`)."""
        return self._outside

    def perceive(self, world: World) -> Perceived:
        """Give what is perceived of the world; called with times that increase."""
        step = self._take_in(world)
        own = world.ego if self._own is None else self._own.perceive(world.ego, step)
        if self._held is not None and world.t < self._due - _SAME:
            return self._held.seen(world.t, own)
        self._step = world.t - self._listed if self._listed > -math.inf else 0.0
        seen = self._list(world, own)
        self._listed = world.t
        if self.model.update.period > 0.0:
            self._schedule(world.t)
            self._held = HeldList(seen)
        return seen

    def _take_in(self, world: World) -> float:
        """Remember the truth; gives the time [s] since the last."""
        history, t = self._history, world.t
        if world.ids is not self._ids:
            self._regroup(world)
        if self._t == -math.inf:
            history.begin(world)
            step = math.inf
        else:
            step = t - self._t
            history.append(world, step)
        self._t = t
        return step

    def _regroup(self, world: World) -> None:
        """Let objects come and go."""
        names = world.ids.tolist()
        self._ids = world.ids
        if names == self._names and self._t > -math.inf:
            return
        column = {name: n for n, name in enumerate(self._names)}
        kept = np.array([n for n, name in enumerate(names) if name in column], dtype=np.intp)
        before = np.array([column[name] for name in names if name in column], dtype=np.intp)
        new = np.array([n for n, name in enumerate(names) if name not in column], dtype=np.intp)
        if self._t > -math.inf:
            self._history.regroup(world, kept, before, new)
        came = {n: self._streams.of("object", names[n]) for n in new.tolist()}
        known = dict(zip(self._names, self._rows.streams, strict=True))
        self._errors.regroup(kept, before, came, len(names))
        self._sight.regroup(kept, before, len(names))
        streams = [came[n] if n in came else known[name] for n, name in enumerate(names)]
        self._rows.regroup(streams, kept, before, new)
        self._names, self._who = names, np.empty(len(names), dtype=np.intp)
        self._rename()

    def _rename(self) -> None:
        """Give objects the ids that they have after their switches."""
        counts = self._switched
        self._shown = None
        if any(name in counts for name in self._names):
            self._shown = np.array([f"{n}#{counts[n]}" if n in counts else n for n in self._names], dtype=str)

    def _schedule(self, t: float) -> None:
        """Set when the next list is due."""
        update = self.model.update
        self._due = max(self._due, t - update.period) if self._due > -math.inf else t
        while self._due <= t + _SAME:
            jitter = update.jitter * self._timing.standard_normal() if update.jitter > 0.0 else 0.0
            self._due += max(update.period + jitter, 1e-3)

    def _list(self, world: World, own: EgoState) -> Perceived:
        """Make a list: the objects as they were, with errors, as far as they are detected."""
        ego, history, errors, sight = world.ego, self._history, self._errors, self._sight
        look, random, who, n = history.lookups(), self._rows.take(), self._who, len(self._names)
        table = np.empty((Q, n))  # kept by who perceives
        count, beyond = perceive(
            history.past, history.end, look.weights, look.span, look.settled, history.set_of,
            ego.x, ego.y, ego.heading, ego.v, world.length, world.width, random,
            errors.tables.table(self._step), errors.least_size, errors.drift,
            sight.edges, sight.tables.table(self._step), sight.state, sight.reach, sight.opening,
            self._limits, table, who,
        )  # fmt: skip
        self._shown_so_far += count
        self._outside += beyond
        if self.model.id_switch > 0.0:
            self._switch(random[IDENTITY], who[:count])
        ids, kind = world.ids if self._shown is None else self._shown, world.kind
        if count < n:
            who, table = who[:count], table[:, :count]
            ids, kind = ids[who], kind[who]
        x, y, v, heading, length, width = table
        seen = Perceived(world.t, own, ids, kind, x, y, heading, v, length, width)
        if self._clutter is not None:
            return with_false(seen, self._clutter.at(world.t, ego), self.model.false_objects, ego)
        return seen

    def _switch(self, uniform: Floats, seen: Columns) -> None:
        """Give some of the objects that are seen another id."""
        chance = -math.expm1(-self.model.id_switch * self._step)
        if self._rows.least() >= chance:
            return
        for n in seen[uniform[seen] < chance].tolist():
            self._switched[self._names[n]] = self._switched.get(self._names[n], 1) + 1
        self._rename()
