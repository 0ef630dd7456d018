"""Variations in the order of the Halton sequence: what a process does for a stretch of it, and who of them is kept.

Point n of the sequence is the same however many are asked for and whoever looks at it, so that 500 variations begin
with the same 100 as 100, and workers change nothing. A point whose variation is rejected is left out; the next that is
not takes its place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.core.halton import halton
from resim.recordings import Recording
from resim.recordings.checked import load_checked
from resim.recordings.content import refuse_changed
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.augmentation.augment import environment_of
from resim.scenario.augmentation.settings import VehicleType, Weather
from resim.scenario.scenario import Scenario
from resim.variations.candidate import VariedDrive, offsets, varied_drive, with_sizes
from resim.variations.kernels import KernelFile
from resim.variations.origin import NamedManeuver, VariedOrigin, object_of, the_origin
from resim.variations.rejection import VariedAgainst, reason
from resim.variations.settings import VariationSettings

CHUNK = 10
"""Points that a process looks at at once."""
Option = TypeVar("Option", VehicleType, Weather)


@dataclass(frozen=True, eq=False)
class VariationPlan:
    """All that variations follow from.

    Attributes:
        folder: Of the recording.
        hash: Of its content.
        accept: Codes of findings to continue despite.
        scenario: The recording, as described on GT.
        kernels: The kernels.
        kernels_hash: Of their file.
        maneuvers: Which maneuvers are varied.
        settings: By how much, and what they may do.
    """

    folder: Path
    hash: str
    accept: tuple[str, ...]
    scenario: Scenario
    kernels: KernelFile
    kernels_hash: str
    maneuvers: tuple[NamedManeuver, ...]
    settings: VariationSettings = field(default_factory=VariationSettings)

    @property
    def varied(self) -> tuple[str, ...]:
        """Ids of the objects that are varied."""
        return tuple(dict.fromkeys(one.object for one in self.maneuvers))

    @property
    def _key(self) -> tuple[object, ...]:
        """What tells plans apart."""
        return self.folder, self.hash, self.accept, self.kernels_hash, self.maneuvers, self.settings

    def __eq__(self, other: object) -> bool:
        return isinstance(other, VariationPlan) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@dataclass(frozen=True, eq=False)
class VariationTask:
    """A stretch of the sequence: `count` points from the `first` on."""

    plan: VariationPlan
    first: int
    count: int


@dataclass(frozen=True, eq=False)
class FoundVariation:
    """What came of one point.

    Attributes:
        index: Which point of the sequence.
        point: (D + discrete,) the point.
        drive: What it gives; None where time turns back.
        rejected: Why it is left out, "" where it is not.
        sizes: Id, kind, length, width [m] of objects that have another type.
        environment: What of it differs.
    """

    index: int
    point: Floats
    drive: VariedDrive | None
    rejected: str
    sizes: tuple[tuple[str, str, float, float], ...] = ()
    environment: tuple[tuple[str, str], ...] = ()


def look(task: VariationTask) -> list[FoundVariation]:
    """Give what comes of a stretch of points, in their order."""
    there = ready(task.plan)
    return [_found(task.plan, there, n) for n in range(task.first, task.first + task.count)]


@dataclass(frozen=True, eq=False)
class PlannedSearch:
    """What all points of a plan share.

    Attributes:
        origin: The drive that is varied.
        against: What its variations are held against.
    """

    origin: VariedOrigin
    against: VariedAgainst


@lru_cache(maxsize=4)
def _loaded(folder: Path, digest: str, accept: tuple[str, ...]) -> tuple[Recording, RoadNetwork]:
    refuse_changed(folder, digest)
    recording = load_checked(folder, accept=accept)
    return recording, load(recording.map)


@lru_cache(maxsize=4)
def ready(plan: VariationPlan) -> PlannedSearch:
    """Give what all points of a plan share; kept for the next stretch, whose task holds an equal copy of the plan."""
    recording, network = _loaded(plan.folder, plan.hash, plan.accept)
    origin = the_origin(plan.scenario, network, plan.kernels, plan.maneuvers)
    against = VariedAgainst(recording, network, plan.scenario, plan.varied, plan.settings)
    return PlannedSearch(origin, against)


def dimensions(plan: VariationPlan) -> tuple[int, int]:
    """Give how many dimensions are components, and how many are discrete."""
    discrete = (len(plan.varied) if plan.settings.vehicle else 0) + (1 if plan.settings.weather else 0)
    return sum(plan.kernels.kernels[one.label].count for one in plan.maneuvers), discrete


def _found(plan: VariationPlan, there: PlannedSearch, index: int) -> FoundVariation:
    count, discrete = dimensions(plan)
    point = halton(index, 1, count + discrete)[0]
    sizes, environment = _discrete(plan, point[count:])
    try:
        drive = varied_drive(there.origin, offsets(there.origin, point[None, :count], plan.settings.box)[0])
    except ResimError:
        return FoundVariation(index, point, None, "time", sizes, environment)
    return _judged(FoundVariation(index, point, drive, "", sizes, environment), there.against)


def _judged(found: FoundVariation, against: VariedAgainst) -> FoundVariation:
    assert found.drive is not None
    scenario = with_sizes(found.drive.scenario, found.sizes)
    scenario = replace(scenario, environment={**scenario.environment, **dict(found.environment)})
    drive = replace(found.drive, scenario=scenario)
    return replace(found, drive=drive, rejected=reason(scenario, drive.off, against))


def _discrete(
    plan: VariationPlan, point: Floats
) -> tuple[tuple[tuple[str, str, float, float], ...], tuple[tuple[str, str], ...]]:
    """The types and the environment that a point has."""
    sizes, shares = [], point.tolist()
    for name in plan.varied if plan.settings.vehicle else ():
        chosen = _chosen(plan.settings.vehicle, shares.pop(0))
        if chosen is not None:
            one = object_of(plan.scenario, name)
            sizes.append((one.id, chosen.kind, chosen.length, chosen.width))
    environment: tuple[tuple[str, str], ...] = ()
    if plan.settings.weather and (weather := _chosen(plan.settings.weather, shares.pop(0))) is not None:
        environment = tuple(sorted(environment_of(weather).items()))
    return tuple(sizes), environment


def _chosen(options: Sequence[Option], share: float) -> Option | None:
    """What a share of the unit interval chooses: the first part is the original's own, with the weight 1."""
    weights = np.cumsum([1.0, *(one.weight for one in options)])
    place = int(np.searchsorted(weights / weights[-1], share, side="right"))
    return None if place == 0 else options[place - 1]


Look = Callable[[Sequence[VariationTask]], Iterable[list[FoundVariation]]]
"""Does tasks, by however many workers, and gives their results in the tasks' order."""


def search(plan: VariationPlan, count: int, do: Look, most: int) -> Iterator[FoundVariation]:
    """Give the points in order until `count` of them are kept, or `most` were looked at."""
    kept, first = 0, 1
    while kept < count and first <= most:
        share = max(kept / (first - 1), 0.05) if first > 1 else 1.0
        wanted = min(max(int(np.ceil((count - kept) / share)), CHUNK), most - first + 1)
        tasks = [
            VariationTask(plan, n, min(CHUNK, first + wanted - n))
            for n in range(first, first + wanted, CHUNK)
        ]
        for found in do(tasks):
            for one in found:
                yield one
                kept += not one.rejected
                if kept == count:
                    return
        first += wanted
