"""An object that a driver drives: where it is on its line, how fast it is, and what is told of it afterwards."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from resim.core.clock import TICK
from resim.simulation.case import HandedOver, LaneChange
from resim.simulation.reactive.aside import Aside
from resim.simulation.reactive.ways import Line


@dataclass(eq=False)
class Handed:
    """One object that a driver drives: s [m] on its line, v and what it does now [m/s²], and what it wants later.

    passes: row of the stage of whom its change of lanes gets it by, -1 for nobody. look: when [s] its driver looks for
    another lane next. behind: when [s] how far [m] it was behind its trace, and what it did [m/s²].
    """

    since: float
    why: str
    line: Line
    s: float
    v: float
    a: float
    later: deque[float]
    look: float
    back: float | None = None
    passes: int = -1
    behind: list[tuple[float, float, float]] = field(default_factory=list)
    changes: list[LaneChange] = field(default_factory=list)

    @property
    def station(self) -> float:
        """How far [m] along its measured way it is."""
        return self.line.station_at(self.s)

    @property
    def changing(self) -> bool:
        """Whether it is on its way from one lane to another."""
        return self.s < self.line.done

    @property
    def aside(self) -> bool:
        """Whether it is not on its measured way, or not yet."""
        return isinstance(self.line, Aside)

    @property
    def returned(self) -> bool:
        """Whether its line has come back to its measured way."""
        return isinstance(self.line, Aside) and self.line.returns and not self.changing

    def take(self, line: Line) -> None:
        """Go on along another line, from the same place."""
        self.s = line.s_at(self.station)
        self.line = line

    def told(self, name: str, t: float) -> HandedOver:
        """Give what is told of the object of this name up to a time [s]."""
        until = [part for part in self.behind if part[0] <= t + TICK]
        farthest = max((part[1] for part in until), default=0.0)
        hardest = max((-part[2] for part in until), default=0.0)
        back = self.back if self.back is not None and self.back <= t + TICK else None
        changes = tuple(one for one in self.changes if one.t <= t + TICK)
        return HandedOver(name, self.since, self.why, back, farthest, max(hardest, 0.0), changes)
