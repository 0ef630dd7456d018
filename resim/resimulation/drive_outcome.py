"""What one drive came to, measured or simulated: all that a verification compares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

KpiOutcome = Literal["PASS", "FAIL", "INVALID"]

Rms = Mapping[str, Mapping[str, Mapping[str, float | None]]]
"""Root mean square errors by step, "ego" or "to", and quantity (d [m], v [m/s], heading [rad]); None where none."""


@dataclass(frozen=True)
class Kpi:
    """The KPI of one criterion: its outcome, worst value in `unit`, when [s], because of which object, and why."""

    outcome: KpiOutcome
    value: float | None
    unit: str
    t: float | None
    object: str
    weight: float
    reason: str


@dataclass(frozen=True)
class BadEnd:
    """How an EGO came to grief: by "collision" or "off_road", when [s], and with which closing speed [m/s].

    speed: of a simulated EGO and whom it hits, None off the road or where it is not known. object: whom it hits.
    """

    by: str
    t: float
    speed: float | None = None
    object: str | None = None


@dataclass(frozen=True)
class DriveOutcome:
    """One drive: KPIs by criterion, what the EGO did and when [s], and how dangerous and comfortable it was.

    reaction: first braking [s]. risk: the largest accident risk. comfort: the largest of each of COMFORT. end: how
    a simulation ended, "" for a measured drive. clear: whether it is shown that the EGO collides with nobody to the
    end. failure: why the function failed, or "". errors: of this drive alone, the pipeline's of a simulated one.
    reaction_spread [s]: how far first braking may be off, of a measured one. asked: what code under test, the
    function's or own measures', asked that its hash does not know. bad: the first collision, or where a simulated
    EGO left the road.
    """

    kpis: Mapping[str, Kpi]
    events: tuple[tuple[float, str], ...]
    reaction: float | None
    risk: float | None
    comfort: Mapping[str, float | None]
    collision: bool
    end: str = ""
    failure: str = ""
    errors: Mapping[str, float | None] | None = None
    reaction_spread: float | None = None
    asked: tuple[str, ...] = ()
    clear: bool = False
    bad: BadEnd | None = None

    @property
    def decision(self) -> list[str]:
        """What the EGO did, in order of time."""
        return [name for _, name in self.events]

    @property
    def whole(self) -> bool:
        """Whether it lasted to the scenario's end."""
        return self.end in ("", "duration")


COMFORT: Mapping[str, str] = {
    "longitudinal acceleration": "low",
    "lateral acceleration": "both",
    "longitudinal jerk": "both",
}
"""Measures that say how comfortable a drive was, and which way is uncomfortable."""
