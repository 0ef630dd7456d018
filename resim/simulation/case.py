"""What a simulated drive follows from, and what it gives."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from resim.core.files import file_hash
from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork
from resim.scenario.jscen import jscen
from resim.scenario.scenario import Scenario
from resim.simulation.function.batch import PerceivedLists
from resim.simulation.function.conversation import Exchange
from resim.simulation.function.interface import Build
from resim.simulation.perception import IdealPerception, Perception
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.model import VehicleModel

if TYPE_CHECKING:
    from resim.simulation.engine import Engine

End = Literal["duration", "collision", "off_road", "function_failed"]
LEAD_IN = 3.0
"""Length of the lead-in [s] ("a few seconds", Wagner 2021, Section 5.2.3)."""
STEP = 0.04
"""Step [s] of a simulation, where nobody says another."""


@dataclass(frozen=True, eq=False)
class Case:
    """Everything that a simulated drive follows from.

    Attributes:
        scenario: Start and trace of the EGO and of every object.
        network: The roads.
        build: The AD function.
        engine: The simulator.
        perception: What the function sees of the truth; begins anew in every drive.
        vehicle: Vehicle model of the EGO.
        traffic: When traffic objects leave their traces for the EGO's sake; None for never.
        step: s, whole milliseconds, of which the build's cycle time is a multiple.
        lead_in: s before the scenario's start.
        seed: Of every random draw.
        stop_at_collision: Whether a collision of the EGO ends the drive.
        open_loop: Whether the function's answers are kept but move nothing; the EGO goes as the scenario says.
        record: Whether the conversation with a process is kept.
    """

    scenario: Scenario
    network: RoadNetwork
    build: Build
    engine: Engine
    perception: Perception = field(default_factory=IdealPerception)
    vehicle: VehicleModel = field(default_factory=Kinematic)
    traffic: ReactiveSettings | None = None
    step: float = STEP
    lead_in: float = LEAD_IN
    seed: int = 0
    stop_at_collision: bool = True
    open_loop: bool = False
    record: bool = False

    def drive(self, *, window: bool = False) -> SimulatedDrive:
        """Simulate it (`Engine.drive`).

        Args:
            window: Whether the simulator shows its window.
        """
        return self.engine.drive([self], window=window)[0]

    @cached_property
    def hash(self) -> str:
        """SHA-256 over all that decides: two drives of one hash, by one version of resim, are the same drive.

        The engine does not: with traffic on its traces it only repeats what it is told.
        """
        told = {
            "scenario": _scenario_hash(self.scenario),
            "map": _map_hash(self.network),
            "build": [self.build.hash, self.build.parameters, self.build.cycle_time],
            "perception": self.perception.hash,
            "vehicle": [self.vehicle.name, asdict(self.vehicle.vehicle)],
            "traffic": "traces" if self.traffic is None else self.traffic.model_dump(),
            "step": self.step,
            "lead_in": self.lead_in,
            "seed": self.seed,
            "stop_at_collision": self.stop_at_collision,
            "open_loop": self.open_loop,
        }
        return hashlib.sha256(json.dumps(told, sort_keys=True, default=repr).encode()).hexdigest()


@lru_cache(maxsize=64)
def _scenario_hash(scenario: Scenario) -> str:
    return hashlib.sha256(json.dumps(jscen(scenario).model_dump()).encode()).hexdigest()


@lru_cache(maxsize=64)
def _map_hash(network: RoadNetwork) -> str:
    return file_hash(network.path)


@dataclass(frozen=True)
class Collision:
    """The EGO's box first overlaps the object's at time t [s]."""

    t: float
    id: str


@dataclass(frozen=True)
class LaneChange:
    """A traffic object's driver begins to change lanes at t [s], to that side."""

    t: float
    side: Literal["left", "right"]


@dataclass(frozen=True)
class HandedOver:
    """A traffic object that left its trace at t [s].

    Attributes:
        id: The object.
        t: When [s] it was handed over to a driver.
        why: What for, in words.
        back: When [s] it was back on its trace, None where it was not.
        farthest: How far [m] it was behind its trace at most.
        hardest: Its hardest braking [m/s²].
        lane_changes: Where its driver changed lanes, in the order of time.
    """

    id: str
    t: float
    why: str
    back: float | None
    farthest: float
    hardest: float
    lane_changes: tuple[LaneChange, ...] = ()


@dataclass(frozen=True, eq=False)
class SimulatedDrive:
    """What one simulation gave, from the scenario's start on.

    Attributes:
        case: What it followed from.
        truth: EGO first, then the traffic objects, where they were commanded to be.
        perceived: What the function was shown, one per cycle.
        commands: (T, 2) acceleration [m/s²] and curvature [1/m] that act from each time on, NaN where there is none.
        plans: When [s] each plan was made, and the plan (see `Command`).
        collisions: With whom the EGO collided, and when.
        handed_over: Which traffic objects left their traces, and when.
        end: What ended it.
        failure: Why the function failed, or "".
        left_route: When [s] the EGO left the measured route (`resim.road.driven_route`), None where it did not.
        traceback: Where it raised what it failed by, a line for each call, the innermost last.
        last_words: The end of what the failed call wrote to the standard error, or a process that it started; or "".
        said: What the code under test, or its process, wrote to the standard error; "" where nobody listens.
        exchanges: The conversation with a process, if it was to be kept (`Case.record`).
        unpinned: What the code under test asked that its hash does not know, in words; "" for nothing.
        control_error: Largest distance [m] between where a vehicle was commanded to be and where the engine had it.
        shown: Objects on all lists that the function was shown.
        outside: How many of them were outside of what the perception model was trained for.
        time: Wall clock [s] that it took.
    """

    case: Case
    truth: Tracks
    perceived: PerceivedLists
    commands: Floats
    plans: tuple[tuple[float, Floats], ...]
    collisions: tuple[Collision, ...]
    handed_over: tuple[HandedOver, ...]
    end: End
    failure: str
    left_route: float | None
    traceback: tuple[str, ...]
    last_words: str
    said: str
    exchanges: tuple[Exchange, ...]
    unpinned: str
    control_error: float
    shown: int
    outside: int
    time: float

    def fingerprint(self) -> dict[str, str]:
        """Give a checksum of each field: two drives with the same ones are the same to the byte.

        How long it took, where an engine says that it had somebody, and what the code asked, is not of the drive; nor
        are the words of a failure, which may hold addresses.
        """
        left = (
            "time",
            "control_error",
            "traceback",
            "last_words",
            "said",
            "exchanges",
            "failure",
            "unpinned",
        )
        values = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in left}
        values |= {"case": self.case.hash, "failed": bool(self.failure), "perceived": tuple(self.perceived)}
        return {name: _checksum(value).hexdigest()[:16] for name, value in values.items()}

    def blame(self) -> tuple[str, ...]:
        """Give what helps to find the fault of a function that failed: where it raised, a line a call; last words."""
        words = (f"last words: {self.last_words}",) if self.last_words else ()
        return (*(f"raised at {line}" for line in self.traceback), *words)

    @property
    def flaw(self) -> str:
        """Why the drive tells nothing of the rest of its scenario, "" for one that lasted."""
        return why_not_whole(self.end, self.failure, float(self.truth.t[-1]))


def _checksum(value: Any) -> hashlib._Hash:
    """Checksum of numbers, texts, arrays, and tuples and dataclasses of them. Raises TypeError for others."""
    if isinstance(value, np.ndarray):
        plain = value.astype(str) if value.dtype == object else value
        return hashlib.sha256(f"{plain.dtype.str}{plain.shape}".encode() + plain.tobytes())
    if is_dataclass(value):
        value = tuple(getattr(value, one.name) for one in fields(value))
    if isinstance(value, tuple):
        return hashlib.sha256(b"".join(_checksum(one).digest() for one in value))
    if value is None or isinstance(value, str | int | float | np.generic):
        return hashlib.sha256(f"{type(value).__name__} {value!r}".encode())
    raise TypeError(f"no checksum of {type(value).__name__}")


def why_not_whole(end: End, failure: str, t: float) -> str:
    """Say why a drive that ended so at t [s] tells nothing of the rest of its scenario, "" for one that lasted."""
    if failure:
        return f"the function failed: {failure}"
    if end == "duration":
        return ""
    what = {"collision": "a collision", "off_road": "leaving the road"}.get(end, end)
    return f"the run ended at {t:.2f} s by {what}: what would have come is not known"
