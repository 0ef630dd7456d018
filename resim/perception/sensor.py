"""A perception model in the closed loop: turns the true world into what the model perceives of it."""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.core.tracks import Strings
from resim.perception.chance import IDENTITY, Rows, Streams
from resim.perception.clutter import Clutter
from resim.perception.history import History
from resim.perception.lists import Held, Limits, with_false
from resim.perception.model import PerceptionModel
from resim.perception.own import OwnState, is_wrong
from resim.perception.sight import Sight
from resim.perception.tables import ABSOLUTE, Maneuvers
from resim.perception.wrong import HALF_TURN, TURN, Wrong
from resim.sim.adfunction import EgoState, Perceived
from resim.sim.perception import World

_SAME = 1e-9  # s

Columns = NDArray[np.intp]


class Sensor:
    """Perceives the world as the model says (`resim.sim.perception.Perception`).

    Where objects are is relative to the true EGO; what the EGO knows of itself has errors of its own.
    """

    def __init__(self, model: PerceptionModel) -> None:
        self.model = model
        sets = [model.pooled, *model.maneuvers.values()]
        self._history = History(sets)
        self._maneuvers = Maneuvers(model) if model.maneuvers else None
        self._errors = Wrong(sets)
        self._sight = Sight(model.detection, model.field_of_view)
        self._switches = model.id_switch > 0.0
        self._limits = Limits(model.validity)
        self._draws = self._errors.any or self._sight.any or self._switches or self._limits.any
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last run; every random draw of the next comes from `rng`."""
        model, self._streams = self.model, Streams(rng)
        of = self._streams.of
        self._own = OwnState(model.ego, of("ego")) if is_wrong(model.ego) else None
        self._clutter = Clutter(model.false_objects, of("false")) if model.false_objects.rate > 0.0 else None
        self._timing = of("update")
        self._t = self._listed = self._due = -math.inf
        self._held: Held | None = None
        self._names: list[str] = []
        self._ids: Strings | None = None
        self._shown: Strings | None = None
        self._switched: dict[str, int] = {}
        self._history.clear()
        self._rows = Rows()
        for part in (self._errors, self._sight, self._limits):
            part.clear()
        self._perceived = 0

    @property
    def perceived(self) -> int:
        """Samples of objects on the lists so far."""
        return self._perceived

    @property
    def outside(self) -> int:
        """How many of `perceived` lie outside of what the model was trained for (`validity`)."""
        self._limits.count(self._rows)
        return self._limits.outside

    def perceive(self, world: World) -> Perceived:
        """Give what is perceived of the world; called with times that increase."""
        turned = (math.pi + world.ego.heading) - world.heading
        step = self._take_in(world, turned)
        own = world.ego if self._own is None else self._own.perceive(world.ego, step)
        if self._held is not None and world.t < self._due - _SAME:
            return self._held.seen(world.t, own)
        self._step = world.t - self._listed if self._listed > -math.inf else 0.0
        seen = self._list(world, own, turned)
        self._listed = world.t
        if self.model.update.period > 0.0:
            self._schedule(world.t)
            self._held = Held(seen)
        return seen

    def _take_in(self, world: World, turned: Floats) -> float:
        """Remember the truth; gives the time [s] since the last."""
        history, t = self._history, world.t
        if world.ids is not self._ids:
            self._regroup(world, turned)
        if self._t == -math.inf:
            history.begin(world, turned)
            step = math.inf
        else:
            history.append(world, turned)
            step = t - self._t
        self._t = t
        return step

    def _regroup(self, world: World, turned: Floats) -> None:
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
            self._history.regroup(world, turned, kept, before, new)
        self._limits.count(self._rows)
        came: dict[int, np.random.Generator] = {}
        if self._draws:
            came = {n: self._streams.of("object", names[n]) for n in new.tolist()}
            known = dict(zip(self._names, self._rows.streams, strict=True))
        self._errors.regroup(kept, before, came, len(names))
        self._sight.regroup(kept, before, len(names))
        if self._draws:
            streams = [came[n] if n in came else known[name] for n, name in enumerate(names)]
            self._rows.regroup(streams, kept, before, new)
        self._limits.begin(self._rows)
        self._names = names
        self._choose(np.zeros(len(names), dtype=np.intp))
        self._rename()

    def _choose(self, chosen: Columns) -> None:
        """Set which set of parameters each object has."""
        self._chosen, self._picks = chosen.tobytes(), self._history.picks(chosen)
        self._errors.choose(chosen)

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

    def _list(self, world: World, own: EgoState, turned: Floats) -> Perceived:
        """Make a list: the objects as they were, with errors, as far as they are detected."""
        ego, history = world.ego, self._history
        look = history.lookups()
        if self._maneuvers is not None:
            chosen = history.sets_of(look, self._maneuvers)
            if chosen.tobytes() != self._chosen:
                self._choose(chosen)
        places, v, a, late = history.seen(look, world, self._picks)
        if history.late_heading:
            turned = (math.pi + ego.heading) - late
        relative = places - complex(ego.x, ego.y)
        relative = relative * cmath.rect(1.0, -ego.heading)
        x, y = relative.real, relative.imag
        keep, row = None, self._row() if self._draws else None
        if row is not None:
            _conditions(row, relative, turned, v, a, ego.v)
            if self._sight.any:
                keep = self._sight.look_at(world, row, x, y, turned, self._step)
            if self._limits.any:
                self._limits.add(self._rows.next - 1, keep, ego.v)
        if row is not None and self._errors.any:
            table = self._errors.add(row, self._step, world, (x, y, v, turned))
            x, y, v, heading, length, width = table if keep is None else table.take(self._sight.columns, 1)
        else:
            heading, length, width = HALF_TURN - np.mod(turned, TURN), world.length, world.width
            if keep is not None:
                x, y, v, heading, length, width = (
                    c.take(self._sight.columns) for c in (x, y, v, heading, length, width)
                )
        if self._switches:
            self._switch(keep)
        ids, kind = world.ids if self._shown is None else self._shown, world.kind
        if keep is not None:
            ids, kind = ids[self._sight.columns], kind[self._sight.columns]
        self._perceived += len(x)
        seen = Perceived(world.t, own, ids, kind, x, y, heading, v, length, width)
        if self._clutter is not None:
            return with_false(seen, self._clutter.at(world.t, ego), self.model.false_objects, ego)
        return seen

    def _row(self) -> Floats:
        """Give the next row of random numbers."""
        if self._rows.used_up:
            self._limits.count(self._rows)
            self._errors.hold()
            self._rows.refill()
            self._limits.begin(self._rows)
        return self._rows.take()

    def _switch(self, keep: Bools | None) -> None:
        """Give some of the detected objects another id."""
        chance = -math.expm1(-self.model.id_switch * self._step)
        if self._rows.least() >= chance:
            return
        now = self._rows.last()[IDENTITY] < chance
        for n in np.flatnonzero(now if keep is None else now & keep).tolist():
            self._switched[self._names[n]] = self._switched.get(self._names[n], 1) + 1
        self._rename()


def _conditions(
    row: Floats, relative: NDArray[np.complex128], turned: Floats, v: Floats, a: Floats, ego_v: float
) -> None:
    """Fill in what the errors depend on: `features`, from pi less the relative heading."""
    np.absolute(relative, row[1])
    np.arctan2(relative.imag, relative.real, row[2])
    along = np.cos(turned, row[3])
    along *= v
    np.subtract(-ego_v, along, along)
    row[4] = a
    np.absolute(row[2:5], row[ABSOLUTE])
