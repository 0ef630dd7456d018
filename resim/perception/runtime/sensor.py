"""Perception models in the closed loop: turn the true world into what the models perceive of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from resim.core.geometry import Floats, constant
from resim.core.tracks import Strings
from resim.perception.model import PerceptionModel
from resim.perception.parts.definition import RunningPart
from resim.perception.parts.ego import EgoErrors, PerceivedEgoState
from resim.perception.parts.registry import PARTS
from resim.perception.runtime.clock import Clock, clocks
from resim.perception.runtime.detection import DetectionState
from resim.perception.runtime.height_history import HeightHistory
from resim.perception.runtime.history import History
from resim.perception.runtime.kernel import Q, perceive
from resim.perception.runtime.lists import limits
from resim.perception.runtime.object_errors import ObjectErrorState
from resim.perception.runtime.random_rows import ObjectStreams, RandomRows
from resim.perception.runtime.streams import PartStreams, Streams
from resim.scenario.maneuvers import MANEUVERS
from resim.simulation.function.batch import Keys, PerceivedBatch, stacked
from resim.simulation.function.interface import EgoState, Perceived
from resim.simulation.perception import (
    Perception,
    PerceptionBatch,
    World,
    Worlds,
    worlds_of,
    z_above,
)


class Sensor:
    """Perceives the world as the model says (`resim.simulation.perception.Perception`)."""

    def __init__(self, model: PerceptionModel) -> None:
        self.model, self.hash = model, model.hash
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Forget what was perceived; every random draw from now on comes from `rng`."""
        self._alone = Sensors([self.model], [rng])

    @property
    def shown(self) -> int:
        """Samples of objects on the lists so far."""
        return int(self._alone.shown[0])

    @property
    def outside(self) -> int:
        """How many of `shown` lie outside of what the model was trained for (`validity`)."""
        return int(self._alone.outside[0])

    def perceive(self, world: World) -> Perceived:
        """Give what is perceived of the world; called with times that increase."""
        return self._alone.perceive(worlds_of(world)).of(0)

    def together(
        self, others: Sequence[Perception], rngs: Sequence[np.random.Generator]
    ) -> PerceptionBatch | None:
        """Give the sensors of a batch of runs; None where another has none."""
        models = [self.model, *(other.model for other in others if isinstance(other, Sensor))]
        return Sensors(models, rngs) if len(models) == len(rngs) else None


class Sensors:
    """The sensors of B runs of one scenario, each by its model (`resim.simulation.perception.PerceptionBatch`).

    Where objects are is relative to the true EGO; what the EGO knows of itself has errors of its own. Latency, errors
    and detection of the objects are compiled; what comes after them are the parts of `resim.perception.parts`.

    rngs: of each run what every random draw of it comes from.
    """

    def __init__(self, models: Sequence[PerceptionModel], rngs: Sequence[np.random.Generator]) -> None:
        runs = len(models)
        self._models = models
        sets = [[model.pooled, *model.maneuvers.values()] for model in models]
        first = np.cumsum([0, *map(len, sets)])[:-1, None]
        self._set_of = first + np.array([_set_of(model) for model in models])
        self._history = History(sets)
        lags = [model.pooled.latency.position for model in models]
        self._heights = {lag: HeightHistory(lag) for lag in lags}
        self._lags = lags
        self._errors = ObjectErrorState(sets)
        self._sight = DetectionState([m.detection for m in models], [m.field_of_view for m in models])
        self._limits = np.array([limits(model.validity) for model in models])
        self._streams = [Streams(rng) for rng in rngs]
        parts = [_running(model, of) for model, of in zip(models, self._streams, strict=True)]
        localising, self._changing = (
            {b: own for b, of in enumerate(parts) if (own := [part for part in of if _does(part, what)])}
            for what in ("localise", "change")
        )
        plain = {
            b: own for b, (own, *more) in localising.items() if type(own) is PerceivedEgoState and not more
        }
        self._with_errors = np.array([*plain], dtype=np.intp)
        self._own_errors = EgoErrors([*plain.values()]) if plain else None
        self._localising = {b: own for b, own in localising.items() if b not in plain}
        timing = [of.of("update") for of in self._streams]
        self._clocks = clocks([model.update for model in models], timing)
        self._t, self._all = -math.inf, np.ones(runs, dtype=bool)
        self._names: list[str] = []
        self._ids: Strings | None = None
        self._rows, self._keys = RandomRows(runs), Keys(runs)
        self.shown, self.outside = np.zeros(runs, dtype=np.intp), np.zeros(runs, dtype=np.intp)

    def perceive(self, worlds: Worlds) -> PerceivedBatch:
        """Give what is perceived of the worlds; called with times that increase."""
        step = self._take_in(worlds)
        own = self._localised(worlds.ego, step)
        due = [clock for clock in self._clocks if clock.is_due(worlds.t)]
        seen = self._list(worlds, own, due)
        changed = self._changed(seen, worlds, due)
        for clock in self._clocks if len(due) < len(self._clocks) else ():
            for b in clock.rows.tolist() if clock not in due else ():
                changed[b] = clock.held(b).seen(worlds.t, seen.of(b).ego)
        if changed:
            lists = [changed[b] if b in changed else seen.of(b) for b in range(len(own))]
            seen = stacked(lists, [self._keys.of_list(b, one.ids) for b, one in enumerate(lists)])
        for clock in due:
            clock.hold(seen)
        return seen

    def _take_in(self, worlds: Worlds) -> float:
        """Remember the truth; gives the time [s] since the last."""
        history, t = self._history, worlds.t
        if worlds.ids is not self._ids:
            self._regroup(worlds)
        if self._t == -math.inf:
            history.begin(worlds)
            step = math.inf
        else:
            step = t - self._t
            history.append(worlds, step)
        for heights in self._heights.values():
            heights.append(worlds)
        self._t = t
        return step

    def _regroup(self, worlds: Worlds) -> None:
        """Let objects come and go."""
        names = worlds.ids.tolist()
        self._ids = worlds.ids
        if names == self._names and self._t > -math.inf:
            return
        column = {name: n for n, name in enumerate(self._names)}
        kept = np.array([n for n, name in enumerate(names) if name in column], dtype=np.intp)
        before = np.array([column[name] for name in names if name in column], dtype=np.intp)
        new = np.array([n for n, name in enumerate(names) if name not in column], dtype=np.intp)
        if self._t > -math.inf:
            self._history.regroup(worlds, kept, before, new)
        came = {n: [ObjectStreams.of(of, names[n]) for of in self._streams] for n in new.tolist()}
        known = dict(zip(self._names, self._rows.streams, strict=True))
        errors = {n: [of.errors for of in streams] for n, streams in came.items()}
        self._errors.regroup(kept, before, errors, len(names))
        self._sight.regroup(kept, before, len(names))
        streams = [came[n] if n in came else known[name] for n, name in enumerate(names)]
        self._rows.regroup(streams, kept, before, new)
        self._names, self._key = names, self._keys.of_traffic(worlds.ids)
        shape = (len(worlds.ego), len(names))
        columns = (constant(self._key), worlds.ids, worlds.kind)
        self._whole = tuple(np.broadcast_to(column, shape) for column in columns)

    def _localised(self, ego: Floats, step: float) -> Floats:
        """The EGOs' states (B, 6) as they have them, a step [s] after the last; infinite for the first."""
        if self._own_errors is None and not self._localising:
            return ego
        own = ego.copy()
        if self._own_errors is not None:
            self._own_errors.localise(own, self._with_errors, step)
        for b, parts in self._localising.items():
            state = EgoState(*own[b].tolist())
            for part in parts:
                state = part.localise(state, step)
            own[b] = state
        return constant(own)

    def _list(self, worlds: Worlds, own: Floats, due: list[Clock]) -> PerceivedBatch:
        """Make the lists that are due: the objects as they were, with errors, as far as they are detected."""
        history, errors, sight, listed = self._history, self._errors, self._sight, self._all
        if len(due) < len(self._clocks):
            listed = np.zeros(len(own), dtype=bool)
            listed[[b for clock in due for b in clock.rows.tolist()]] = True
        for clock in due:
            self._rows.take(clock.rows, clock.count)
            for b in clock.rows.tolist() if clock.tick(worlds.t) else ():
                errors.step(b, clock.since)
                sight.step(b, clock.since)
        look, runs, n = history.lookups(), len(own), len(self._names)
        table, who = np.empty((runs, Q, n)), np.zeros((runs, n), dtype=np.intp)
        counts = np.zeros((2, runs), dtype=np.intp)
        found = perceive(
            history.past, history.maneuver, history.end, look.weights, look.span, look.settled, history.direction,
            self._set_of, worlds.ego, listed, worlds.length, worlds.width, self._rows.rows, self._rows.row,
            errors.all, errors.least_size, errors.drift, sight.edges, sight.detected, sight.bins,
            sight.state, sight.reach, sight.opening, self._limits, table, who, counts,
        )  # fmt: skip
        count, beyond = counts
        self.shown += count
        self.outside += beyond
        key, ids, kind = self._whole
        z_ego = self._z_ego(worlds)
        if found < runs * n:
            key, ids, kind = (constant(c[who]) for c in (self._key, worlds.ids, worlds.kind))
            z_ego = constant(np.take_along_axis(z_ego, who, axis=1))
        x, y, v, heading, length, width = constant(table).transpose(1, 0, 2)
        return PerceivedBatch(
            worlds.t, own, constant(count), key, ids, kind, x, y, heading, v, length, width, z_ego
        )

    def _z_ego(self, worlds: Worlds) -> Floats:
        """Heights (B, N) [m] that the objects had as each sensor tells them, above that of the EGO now."""
        if worlds.z is None:
            return z_above(worlds)
        then = {lag: heights.z(worlds) for lag, heights in self._heights.items()}
        return constant(np.array([then[lag] for lag in self._lags]) - worlds.ego_z[:, None])

    def _changed(self, lists: PerceivedBatch, worlds: Worlds, due: list[Clock]) -> dict[int, Perceived]:
        """The lists that are due of the runs with parts that change lists, as they are after these."""
        out = {}
        for clock in due if self._changing else ():
            for b in clock.rows.tolist():
                if parts := self._changing.get(b):
                    seen, world = lists.of(b), worlds.of(b)
                    for part in parts:
                        seen = part.change(seen, world, clock.exactly)
                    out[b] = seen
        return out


def _set_of(model: PerceptionModel) -> list[int]:
    """Which of its sets of parameters each of MANEUVERS has, the pooled ones first."""
    own = list(model.maneuvers)
    return [own.index(m) + 1 if m in own else 0 for m in MANEUVERS]


def _running(model: PerceptionModel, streams: Streams) -> list[RunningPart]:
    """The parts of a model that do anything, in order."""
    known = ((part, getattr(model, part.name)) for part in PARTS)
    made = (part.make(of, PartStreams(streams, part.name)) for part, of in known if of is not None)
    return [part for part in made if part is not None]


def _does(part: RunningPart, what: str) -> bool:
    """Whether a part has a method of its own."""
    return getattr(type(part), what) is not getattr(RunningPart, what)
