"""Which objects are seen: the chain of detection, and the field of view."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.perception.chance import SIGHT
from resim.perception.model import Detection, FieldOfView
from resim.perception.tables import ABSOLUTE, FRESH, DetectionTables
from resim.perception.world import occlusion
from resim.sim.perception import World

LOOK = 0.2
"""s; so often it is looked again in which bin of detection objects are, and who hides whom."""
_SAME = 1e-9  # s


class Sight:
    """Which of N objects are seen; remembers which were detected last."""

    def __init__(self, detection: Detection, view: FieldOfView) -> None:
        self.tables = DetectionTables(detection)
        self.reach, self.opening = (None if c is None else np.array(c) for c in (view.range, view.bearing))
        self.any = self.tables.any or view != FieldOfView()
        self.clear()

    def clear(self) -> None:
        """Forget all objects."""
        self.state = np.zeros(0, dtype=np.intp)
        self.regroup(np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), 0)

    def regroup(self, kept: NDArray[np.intp], before: NDArray[np.intp], n: int) -> None:
        """Change to n columns: those `before` go to `kept`, and the others are new."""
        old, self.state = self.state, np.full(n, FRESH * self.tables.bins)
        self.state[kept] = old[before]
        self.look = self.step = -math.inf
        self.detected, self.seen = b"", b""

    def look_at(
        self, world: World, row: Floats, x: Floats, y: Floats, turned: Floats, step: float
    ) -> Bools | None:
        """Say which objects are seen `step` [s] after the last time, None for all; `columns` has their columns then.

        row: conditions and chances. x, y [m]: in the EGO's frame. turned [rad]: pi less the relative heading.
        """
        keep: Bools | None = None
        if self.tables.any:
            if world.t >= self.look - _SAME:
                self.find(world, row, x, y, turned)
            keep = self.chain(row[SIGHT], step)
        if self.reach is not None:
            near = row[1] <= self.reach
            keep = near if keep is None else keep & near
        if self.opening is not None:
            ahead = row[ABSOLUTE.start] <= self.opening
            keep = ahead if keep is None else keep & ahead
        if keep is None or b"\0" not in (key := keep.tobytes()):
            return None
        if key != self.seen:
            self.seen, self.columns = key, keep.nonzero()[0]
        return keep

    def find(self, world: World, row: Floats, x: Floats, y: Floats, turned: Floats) -> None:
        """Find in which bins the objects are."""
        hidden = None
        if self.tables.hides:
            hidden = occlusion(x, y, math.pi - turned, world.length, world.width)
        self.cell = self.tables.cells(row[1], row[ABSOLUTE.start], hidden)
        self.look, self.detected = world.t + LOOK, b""

    def chain(self, uniform: Floats, step: float) -> Bools:
        """Go on by `step` [s]; gives who is detected now. Probabilities stay until states, bins or the step change."""
        if not abs(step - self.step) < _SAME:
            self.step, self.detected = step, b""
        if not self.detected:
            self.chance = self.tables.probabilities(step).take(self.cell + self.state)
        keep: Bools = uniform < self.chance
        if (key := keep.tobytes()) != self.detected:
            self.state, self.detected = keep * self.tables.bins, key
            self.chance = self.tables.probabilities(step).take(self.cell + self.state)
        return keep
