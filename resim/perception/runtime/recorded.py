"""What was recorded as perceived, shown again: each object as far off as the sensors had it at that time."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from resim.core.clock import TICK
from resim.core.geometry import Floats, from_frame, to_frame, wrap_angle
from resim.core.tracks import Tracks, whole_id
from resim.simulation.function.interface import EgoState, Perceived
from resim.simulation.perception import OneRun, Perception, PerceptionBatch, World


class RecordedPerception:
    """Shows the objects of sensor data, with the errors that they have there (a `simulation.perception.Perception`).

    gt, sd: tracks with the same ids, EGO included. senses_ego: whether sd has the EGO's own state, and not the ground
    truth's. An error is that of the last list before; before the first list, of that one. Errors of position are in
    the EGO's frame, so that an EGO that drives otherwise sees objects as far off.
    """

    def __init__(self, gt: Tracks, sd: Tracks, *, ego: str, senses_ego: bool) -> None:
        true = gt.at(sd.t)
        common = [i for i in sd.ids.tolist() if i != ego and i in set(gt.ids.tolist())]
        seen, there = sd.select(common), true.select(common)
        row, own = sd.index(ego), true.index(ego)
        x, y = to_frame(seen.x, seen.y, sd.x[row], sd.y[row], sd.heading[row])
        x0, y0 = to_frame(there.x, there.y, true.x[own], true.y[own], true.heading[own])
        turned = wrap_angle((seen.heading - sd.heading[row]) - (there.heading - true.heading[own]))
        self.t, self.row = sd.t, {name: k for k, name in enumerate(common)}
        self.off = np.stack([x - x0, y - y0, turned, seen.v - there.v])
        self.length, self.width = seen.length, seen.width
        ahead, left = to_frame(sd.x[row], sd.y[row], true.x[own], true.y[own], true.heading[own])
        self.own = np.stack(
            [ahead, left, wrap_angle(sd.heading[row] - true.heading[own]), sd.v[row] - true.v[own]]
        )
        if not senses_ego:
            self.own = np.zeros_like(self.own)

    @cached_property
    def hash(self) -> str:
        """Of what is shown, and of the errors that it has."""
        told = hashlib.sha256(json.dumps(self.row).encode())
        for column in (self.t, self.off, self.length, self.width, self.own):
            told.update(np.ascontiguousarray(column).tobytes())
        return told.hexdigest()

    def together(
        self, others: Sequence[Perception], rngs: Sequence[np.random.Generator]
    ) -> PerceptionBatch | None:
        """Give that of one run; nothing is drawn."""
        return None if others else OneRun(self.perceive)

    def perceive(self, world: World) -> Perceived:
        """Give the objects that were on the list of this time."""
        k = max(int(np.searchsorted(self.t, world.t + TICK, side="right")) - 1, 0)
        known = np.array(
            [self.row.get(whole_id(name, self.row), -1) for name in world.ids.tolist()], dtype=np.intp
        )
        off = np.full((len(self.off), len(known)), np.nan)
        off[:, known >= 0] = self.off[:, known[known >= 0], k]
        on = np.isfinite(off).all(axis=0)
        ego = world.ego
        x, y = to_frame(world.position.real[on], world.position.imag[on], ego.x, ego.y, ego.heading)
        dx, dy, turned, dv = off[:, on]
        heading = wrap_angle(world.heading[on] - ego.heading + turned)
        v: Floats = world.v[on] + dv
        kept = known[on]
        return Perceived(
            world.t, self._localised(ego, k), world.ids[on], world.kind[on], x + dx, y + dy, heading, v,
            self.length[kept], self.width[kept], world.z_ego[on],
        )  # fmt: skip

    def _localised(self, ego: EgoState, k: int) -> EgoState:
        """The EGO's state as its own sensors had it."""
        ahead, left, turned, faster = self.own[:, k].tolist()
        if not np.isfinite(self.own[:, k]).all():
            return ego
        x, y = from_frame(ahead, left, ego.x, ego.y, ego.heading)
        return EgoState(float(x), float(y), ego.heading + turned, ego.v + faster, ego.a, ego.yaw_rate)
