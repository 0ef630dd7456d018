"""What a simulation gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.sim.adfunction import Perceived

End = Literal["duration", "collision", "off_road", "function_failed"]


def why_not_whole(end: End, failure: str, t: float) -> str:
    """Say why a run that ended so at t [s] tells nothing of the rest of its scenario, "" for one that lasted."""
    if failure:
        return f"the function failed: {failure}"
    if end == "duration":
        return ""
    what = {"collision": "a collision", "off_road": "leaving the road"}.get(end, end)
    return f"the run ended at {t:.2f} s by {what}: what would have come is not known"


@dataclass(frozen=True)
class Collision:
    """The EGO's box first overlaps the object's at time t [s]."""

    t: float
    id: str


@dataclass(frozen=True, eq=False)
class Run:
    """What one simulation gave, from the scenario's start on.

    truth: EGO first, then the traffic objects, as read back from SUMO. perceived: one per cycle of the
    function. commands: (T, 2) acceleration [m/s²] and curvature [1/m] that act on the step from each time
    on, NaN where there is none. plans: when [s] each was made, and the plan (see `Command`). failure: why the
    function failed, or "". control_error: the largest distance [m] between where a vehicle was commanded to
    be and where SUMO had it.
    """

    truth: Tracks
    perceived: tuple[Perceived, ...]
    commands: Floats
    plans: tuple[tuple[float, Floats], ...]
    collisions: tuple[Collision, ...]
    end: End
    failure: str
    seed: int
    control_error: float
