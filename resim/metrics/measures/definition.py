"""What a measure is: name, unit, source, how it is computed, and what a criterion on it has to know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from resim.core.geometry import Floats
from resim.metrics.kinds import MeasureKind, WorstEnd
from resim.metrics.measures.values import MeasureValues, StateArray

if TYPE_CHECKING:
    from resim.core.tracks import Tracks
    from resim.metrics.doubts.absent import AbsentObject
    from resim.metrics.drive import DriveScenes
    from resim.metrics.measures.horizon import LookAhead
    from resim.metrics.measures.inputs import MeasureInputs
    from resim.metrics.risk import Risk
    from resim.road.opendrive import RoadNetwork

KINDS: tuple[MeasureKind, ...] = ("quantitative", "legal", "functional")
"""In the order of tables."""


class DriveDangers(Protocol):
    """A drive, its accident risk, and when [s] the EGO's box touches whose."""

    @property
    def drive(self) -> DriveScenes:
        """The drive scene by scene."""

    @property
    def risk(self) -> Risk:
        """The accident risk of each scene."""

    @property
    def contacts(self) -> tuple[tuple[float, str], ...]:
        """When [s] the EGO's box touches whose."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasureDefinition:
    """A measure as it is registered, in the module of its function.

    worst: which end is the worse one. source: paper and equation or section, or the rule. meaning: what it is, in a
    few words. of: gives its values, (S,) of the EGO or the whole scene, or (S, K) of the EGO with each object; or own:
    gives (N, T) of the tracks of N EGOs, where nothing else is asked for. by_scene: what it is in a scene follows from
    the `Scenes` of that scene alone. Both can be computed for several drives at once. made_of: measures that it asks
    for.

    The rest is for criteria. alone: it is of the EGO alone, whatever else is there. needs: how far ahead a limit asks
    to look, None where that is never farther than usual. open_beyond: how bad (S, 1) it can still be where there is
    NO_CONFLICT as far as was looked (`MeasureInputs.seen`); None: not at all. unseen: how bad (P,) it can be in scenes
    in which an object is there but was not seen, NaN where not at all; None: as bad as can be where boxes can touch.
    whom: because of which object the value of a whole scene is what it is, "" for none.
    """

    name: str
    unit: str
    worst: WorstEnd
    kind: MeasureKind
    source: str
    meaning: str
    of: Callable[[MeasureInputs], MeasureValues] | None = None
    own: Callable[[Tracks, RoadNetwork], MeasureValues] | None = None
    by_scene: bool = False
    made_of: tuple[str, ...] = ()
    alone: bool = False
    needs: Callable[[MeasureInputs, float], LookAhead] | None = None
    open_beyond: Callable[[MeasureInputs], Floats] | None = None
    unseen: Callable[[AbsentObject], Floats] | None = None
    whom: Callable[[DriveDangers, int], str] | None = None

    def compute(self, inputs: MeasureInputs) -> MeasureValues:
        """Give its values in a drive."""
        if self.own is not None:
            return self.own(inputs.drive.own, inputs.network).track()
        assert self.of is not None
        return self.of(inputs)

    def values(self, value: Floats, state: StateArray) -> MeasureValues:
        """Give values of this measure, of any shape; state: see `State`."""
        return MeasureValues(self.name, self.unit, value, state, self.worst)

    def ahead(self, inputs: MeasureInputs, side: str, limit: float) -> LookAhead:
        """Give how far it has to look ahead for a limit on this side; no less than it always does."""
        if self.needs is None or (side == "below") != (self.worst == "low"):
            return inputs.usual
        return self.needs(inputs, limit)
