"""How near somebody can be in scenes in which he is there, and nobody sees him."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.metrics.doubts.reach import Reach, Then
from resim.metrics.measures import Pairs, motion
from resim.metrics.measures.contact import Rows
from resim.metrics.measures.horizon import LookAhead
from resim.metrics.measures.inputs import MeasureInputs

METRES = 2.0
"""Steps [m] in which the way ahead is looked along."""


@dataclass(frozen=True, eq=False)
class AbsentObject:
    """An absent object beside the EGO in the P scenes `at` of a drive, looked for as far as `seen`.

    What `MeasureDefinition.unseen` is told by: results are (P,), for the worst that the object can do there.
    """

    inputs: MeasureInputs
    at: Rows
    reach: Reach
    seen: LookAhead

    @cached_property
    def pairs(self) -> Pairs:
        """The EGO, as far ahead as is looked."""
        return self.inputs.looking(self.seen).pairs

    @property
    def v(self) -> Floats:
        """The EGO's speed (P,) [m/s]."""
        return np.asarray(self.inputs.drive.scenes.plan[self.at, 0, 3])

    @property
    def step(self) -> float:
        """The time [s] between scenes; 0 for one alone."""
        t = self.inputs.drive.t
        return float(np.median(np.diff(t))) if len(t) > 1 else 0.0

    def touches(self, then: Then, *, steady: bool = False, strays: float = 0.0) -> Floats:
        """Give when (P,) [s] the boxes can touch first, along the EGO's plan or steadily; inf for not at all."""
        pairs = self.pairs
        way = (pairs.steady if steady else pairs.going)[self.at]
        ahead = np.linspace(0.0, pairs.span, way.shape[1])
        gap = self.reach.clearance(way, ahead, pairs.ego_size[self.at], then, strays)
        return _first(gap <= 0.0, ahead)

    def time(self, then: Then, *, steady: bool = False, strays: float = 0.0) -> Floats:
        """Give the same, NaN for not at all."""
        at = self.touches(then, steady=steady, strays=strays)
        return np.where(np.isfinite(at), at, np.nan)

    def apart(self) -> Floats:
        """Give how far (P,) [m] the boxes are apart at least over the horizon, whatever he does."""
        pairs = self.inputs.pairs
        ahead = np.linspace(0.0, pairs.span, pairs.plan.shape[1])
        gap = self.reach.clearance(pairs.plan[self.at], ahead, pairs.ego_size[self.at], "anything")
        return np.asarray(np.maximum(gap.min(axis=1), 0.0))

    def now(self) -> Floats:
        """Give how far (P,) [m] the boxes are apart at least in the scene."""
        pairs = self.inputs.pairs
        way = pairs.plan[self.at, :1]
        return np.asarray(self.reach.clearance(way, np.zeros(1), pairs.ego_size[self.at], "stays")[:, 0])

    def gap(self) -> Floats:
        """Give the least way (P,) [m] along the EGO's path to his box, inf for none as far as is looked."""
        pairs, s = self.inputs.pairs, np.arange(0.0, self.seen.reach + METRES, METRES)
        ways = np.broadcast_to(s, (len(self.at), len(s)))
        way = motion.along(pairs.plan[self.at], ways, np.ones(ways.shape))
        return _first(self.reach.clearance(way, s, pairs.ego_size[self.at], "stays") <= 0.0, s)

    def at_worst(self, value: float, can: Bools) -> Floats:
        """Give this value where it can (P,), else NaN."""
        return np.where(can, value, np.nan)

    def contact(self, value: float) -> Floats:
        """Give this value where boxes can touch within the horizon: where nothing sharper is known."""
        return self.at_worst(value, np.isfinite(self.touches("anything")))


def _first(can: Bools, at: Floats) -> Floats:
    """The first of `at` (N,) less half a step where it can (P, N), inf where it cannot."""
    half = 0.5 * float(at[1] - at[0])
    return np.where(can.any(axis=1), np.maximum(at[can.argmax(axis=1)] - half, 0.0), np.inf)
