"""A perception model in the closed loop: turns the true world into what the model perceives of it."""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.core.tracks import Strings
from resim.perception.chance import IDENTITY, SIGHT, Rows, Streams
from resim.perception.clutter import Clutter
from resim.perception.history import History
from resim.perception.lists import Held, Limits, with_false
from resim.perception.model import FieldOfView, PerceptionModel
from resim.perception.own import OwnState, is_wrong
from resim.perception.tables import (
    ABSOLUTE,
    BIAS,
    CHANCES,
    CONDITIONS,
    DRIVE,
    FRESH,
    KEEP,
    OUTCOMES,
    SPREADS,
    DetectionTables,
    ErrorTables,
    Maneuvers,
    Q,
)
from resim.perception.world import occlusion
from resim.sim.adfunction import EgoState, Perceived
from resim.sim.perception import World

LEAST_SIZE = 0.1
"""m; no perceived box is shorter or narrower, if the model has errors of size."""
LOOK = 0.2
"""s; so often it is looked again in which bin of detection objects are, and who hides whom."""
_TURN, _HALF_TURN = (
    np.array(2.0 * math.pi),
    np.array(math.pi),
)  # as arrays: numpy takes them faster than floats
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
        self._errors = ErrorTables([s.errors for s in sets])
        self._detection = DetectionTables(model.detection)
        view = model.field_of_view
        self._reach, self._opening = (None if c is None else np.array(c) for c in (view.range, view.bearing))
        self._masks = self._detection.any or view != FieldOfView()
        self._switches = model.id_switch > 0.0
        self._limits = Limits(model.validity)
        self._draws = self._errors.any or self._masks or self._switches or self._limits.any
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last run; every random draw of the next comes from `rng`."""
        model, self._streams = self.model, Streams(rng)
        of = self._streams.of
        self._own = OwnState(model.ego, of) if is_wrong(model.ego) else None
        self._clutter = Clutter(model.false_objects, of("false")) if model.false_objects.rate > 0.0 else None
        self._timing = of("update")
        self._t = self._listed = self._due = self._look = self._chance_step = -math.inf
        self._held: Held | None = None
        self._names: list[str] = []
        self._ids: Strings | None = None
        self._shown: Strings | None = None
        self._switched: dict[str, int] = {}
        self._history.clear()
        self._rows = Rows()
        self._drift, self._state = np.zeros((Q, 0)), np.zeros(0, dtype=np.intp)
        self._limits.clear()
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
        drift, state = self._drift, self._state
        self._drift = np.zeros((Q, len(names)))
        self._state = np.full(len(names), FRESH * self._detection.bins)
        if self._draws:
            streams = dict(zip(self._names, self._rows.streams, strict=True))
            came = {names[n]: self._streams.of("object", names[n]) for n in new.tolist()}
            for n in new.tolist():
                self._drift[:, n] = self._errors.root.dot(came[names[n]].standard_normal(Q))
            self._rows.regroup([(streams | came)[name] for name in names], kept, before, new)
        self._drift[:, kept], self._state[kept] = drift[:, before], state[before]
        self._limits.begin(self._rows)
        self._names, self._look = names, -math.inf
        self._cells = np.arange(OUTCOMES * len(names)).reshape(OUTCOMES, -1)
        self._choose(np.zeros(len(names), dtype=np.intp))
        self._kept, self._sight = b"", b""
        self._rename()

    def _choose(self, chosen: Columns) -> None:
        """Set which set of parameters each object has."""
        self._matrix_step = -math.inf
        self._chosen, self._picks = chosen.tobytes(), self._history.picks(chosen)
        self._used = tuple(sorted(set(chosen.tolist()))) or (0,)
        self._choice = None
        if len(self._used) > 1:
            place = np.array(self._used).searchsorted(chosen)
            self._choice = self._cells + place * self._cells.size

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
            if self._masks:
                keep = self._detected(world, row, x, y, turned)
            if self._limits.any:
                self._limits.add(self._rows.next - 1, keep, ego.v)
        if row is not None and self._errors.any:
            table = self._wrong(row, world, (x, y, v, turned))
            x, y, v, heading, length, width = table if keep is None else table.take(self._few, 1)
        else:
            heading, length, width = _HALF_TURN - np.mod(turned, _TURN), world.length, world.width
            if keep is not None:
                x, y, v, heading, length, width = (
                    c.take(self._few) for c in (x, y, v, heading, length, width)
                )
        if self._switches:
            self._switch(keep)
        ids, kind = world.ids if self._shown is None else self._shown, world.kind
        if keep is not None:
            ids, kind = ids[self._few], kind[self._few]
        self._perceived += len(x)
        seen = Perceived(world.t, own, ids, kind, x, y, heading, v, length, width)
        if self._clutter is not None:
            return with_false(seen, self._clutter.at(world.t, ego), self.model.false_objects, ego)
        return seen

    def _row(self) -> Floats:
        """Give the next row of random numbers."""
        if self._rows.used_up:
            self._limits.count(self._rows)
            self._drift = self._drift.copy()  # it stands in the last row
            self._rows.refill()
            self._limits.begin(self._rows)
        return self._rows.take()

    def _wrong(self, row: Floats, world: World, true: tuple[Floats, Floats, Floats, Floats]) -> Floats:
        """Give (Q, N) x, y, v, heading, length and width with errors; true: x, y, v, and pi less the heading."""
        if not abs(self._step - self._matrix_step) < _SAME:
            self._matrix, self._matrix_step = self._errors.matrix(self._step, self._used), self._step
        outcomes = self._matrix.dot(row[: CONDITIONS + Q])
        if self._choice is not None:
            outcomes = outcomes.take(self._choice)
        drift = np.multiply(outcomes[KEEP], self._drift, row[CONDITIONS : CONDITIONS + Q])
        drift += outcomes[DRIVE]
        self._drift = drift
        errors = np.exp(outcomes[SPREADS])
        errors *= row[CHANCES]
        out = np.empty((Q, len(self._names)))
        out[0], out[1], out[2], out[3] = true
        out[4], out[5] = world.length, world.width
        out += outcomes[BIAS]
        out += errors[:Q]
        out += errors[Q:]
        heading = out[3]
        np.mod(heading, _TURN, heading)
        np.subtract(_HALF_TURN, heading, heading)
        if self._errors.sizes:
            sizes = out[4:]
            np.maximum(sizes, LEAST_SIZE, out=sizes)
        return out

    def _detected(self, world: World, row: Floats, x: Floats, y: Floats, turned: Floats) -> Bools | None:
        """Say which objects are detected and in the field of view; None for all."""
        keep: Bools | None = None
        if self._detection.any:
            step = self._step
            if world.t >= self._look - _SAME:
                self._watch(world, row, x, y, turned)
            if not abs(step - self._chance_step) < _SAME:
                self._chance_step, self._sight = step, b""
            if not self._sight:
                self._chance = self._detection.probabilities(step).take(self._cell + self._state)
            keep = row[SIGHT] < self._chance
            if (key := keep.tobytes()) != self._sight:
                self._state, self._sight = keep * self._detection.bins, key
                self._chance = self._detection.probabilities(step).take(self._cell + self._state)
        if self._reach is not None:
            near = row[1] <= self._reach
            keep = near if keep is None else keep & near
        if self._opening is not None:
            ahead = row[ABSOLUTE.start] <= self._opening
            keep = ahead if keep is None else keep & ahead
        if keep is None or b"\0" not in (key := keep.tobytes()):
            return None
        if key != self._kept:
            self._kept, self._few = key, keep.nonzero()[0]
        return keep

    def _watch(self, world: World, row: Floats, x: Floats, y: Floats, turned: Floats) -> None:
        """Look in which bin of detection the objects are."""
        hidden = None
        if self._detection.hides:
            hidden = occlusion(x, y, math.pi - turned, world.length, world.width)
        self._cell = self._detection.cells(row[1], row[ABSOLUTE.start], hidden)
        self._look, self._sight = world.t + LOOK, b""

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
