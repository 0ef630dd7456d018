"""A perception model in the closed loop: turns the true world into what the model perceives of it."""

from __future__ import annotations

import math

import numpy as np

from resim.core.tracks import Strings
from resim.perception.model import PerceptionModel
from resim.perception.parts.definition import RunningPart
from resim.perception.parts.registry import PARTS
from resim.perception.runtime.detection import DetectionState
from resim.perception.runtime.height_history import HeightHistory
from resim.perception.runtime.history import History
from resim.perception.runtime.kernel import Q, perceive
from resim.perception.runtime.lists import HeldList, limits
from resim.perception.runtime.object_errors import ObjectErrorState
from resim.perception.runtime.random_rows import ObjectStreams, RandomRows
from resim.perception.runtime.streams import PartStreams, Streams
from resim.scenario.maneuvers import MANEUVERS
from resim.simulation.function.interface import EgoState, Perceived
from resim.simulation.perception import World

_SAME = 1e-9  # s


class Sensor:
    """Perceives the world as the model says (`resim.simulation.perception.Perception`).

    Where objects are is relative to the true EGO; what the EGO knows of itself has errors of its own. Latency, errors
    and detection of the objects are compiled; what comes after them are the parts of `resim.perception.parts`.
    """

    def __init__(self, model: PerceptionModel) -> None:
        self.model, self.hash = model, model.hash
        sets, own = [model.pooled, *model.maneuvers.values()], list(model.maneuvers)
        set_of = np.array([own.index(m) + 1 if m in own else 0 for m in MANEUVERS])
        self._history = History(sets, set_of)
        self._heights = HeightHistory(model.pooled.latency.position)
        self._errors = ObjectErrorState(sets)
        self._sight = DetectionState(model.detection, model.field_of_view)
        self._limits = limits(model.validity)
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last run; every random draw of the next comes from `rng`."""
        self._streams = Streams(rng)
        self._parts = _running(self.model, self._streams)
        self._timing = self._streams.of("update")
        self._t = self._listed = self._due = -math.inf
        self._held: HeldList | None = None
        self._names: list[str] = []
        self._ids: Strings | None = None
        self._rows = RandomRows()
        for part in (self._history, self._heights, self._errors, self._sight):
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
        own = world.ego
        for part in self._parts:
            own = part.localise(own, step)
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
        self._heights.append(world)
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
        came = {n: ObjectStreams.of(self._streams, names[n]) for n in new.tolist()}
        known = dict(zip(self._names, self._rows.streams, strict=True))
        self._errors.regroup(kept, before, {n: of.errors for n, of in came.items()}, len(names))
        self._sight.regroup(kept, before, len(names))
        streams = [came[n] if n in came else known[name] for n, name in enumerate(names)]
        self._rows.regroup(streams, kept, before, new)
        self._names, self._who = names, np.empty(len(names), dtype=np.intp)

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
        ids, kind = world.ids, world.kind
        z_ego = self._heights.z_ego(world)
        if count < n:
            who, table = who[:count], table[:, :count]
            ids, kind = ids[who], kind[who]
            z_ego = z_ego[who]
        x, y, v, heading, length, width = table
        seen = Perceived(world.t, own, ids, kind, x, y, heading, v, length, width, z_ego)
        for part in self._parts:
            seen = part.change(seen, world, self._step)
        return seen


def _running(model: PerceptionModel, streams: Streams) -> list[RunningPart]:
    """The parts of a model that do anything, in order."""
    known = ((part, getattr(model, part.name)) for part in PARTS)
    made = (part.make(of, PartStreams(streams, part.name)) for part, of in known if of is not None)
    return [part for part in made if part is not None]
