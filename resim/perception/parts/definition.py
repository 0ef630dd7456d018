"""What a part of perception is: its parameters, its random numbers, and what it does in a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from resim.perception.runtime.streams import PartStreams

if TYPE_CHECKING:
    from resim.simulation.function.interface import EgoState, Perceived
    from resim.simulation.perception import World


class RunningPart:
    """A part in one run. What a part does not override, it leaves as it is."""

    def localise(self, ego: EgoState, step: float) -> EgoState:
        """Give the EGO's state as the EGO has it; step: s since the last time, infinite for the first."""
        return ego

    def change(self, seen: Perceived, world: World, step: float) -> Perceived:
        """Give a list as it is after this part; step: s since the last list, 0 for the first.

        seen: as the parts before have left it. world: the truth of now.
        """
        return seen


@dataclass(frozen=True, eq=False, kw_only=True)
class PerceptionPart:
    """A part as it is registered.

    name: of its parameters in a model, and of its random streams, which no other part draws from. parameters: the type
    of its parameters. units: theirs, by name. make: gives the part of a run from its parameters and its streams; None
    where it does nothing.
    """

    name: str
    parameters: Any
    make: Callable[[Any, PartStreams], RunningPart | None]
    units: Mapping[str, str] = field(default_factory=dict)
