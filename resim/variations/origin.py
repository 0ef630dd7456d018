"""The drive that is varied: its maneuvers, and where they lie among the components of their kernels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.mining.own_labels import MiningRules
from resim.mining.study import mine_recording
from resim.recordings import Recording
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario, ScenarioObject
from resim.variations.features import SAME, feature_vector
from resim.variations.kernels import MANEUVERS, KernelFile, ManeuverKernel
from resim.variations.lane_motion import LaneMotion, motion_of
from resim.variations.training import SHORTEST, equal_parts


@dataclass(frozen=True)
class NamedManeuver:
    """A maneuver of an object: its label, first and last moment [s]."""

    object: str
    label: str
    start: float
    end: float

    def __str__(self) -> str:
        return f"{self.object}:{self.label}@{self.start:.2f}"


@dataclass(frozen=True, eq=False)
class OriginManeuver:
    """A maneuver that is varied, beside its kernel.

    Attributes:
        of: Which.
        kernel: Of its kind.
        components: (C,) of the original.
    """

    of: NamedManeuver
    kernel: ManeuverKernel
    components: Floats


@dataclass(frozen=True, eq=False)
class VariedOrigin:
    """A drive and what of it is varied.

    Attributes:
        scenario: As described on GT.
        network: Its map.
        maneuvers: In order of object and time; each has as many dimensions as its kernel has components.
        motions: By object, in its lane.
    """

    scenario: Scenario
    network: RoadNetwork
    maneuvers: tuple[OriginManeuver, ...]
    motions: Mapping[str, LaneMotion]

    @property
    def dimensions(self) -> int:
        """How many components are varied."""
        return sum(one.kernel.count for one in self.maneuvers)


def varied_maneuvers(recording: Recording, kernels: KernelFile, scenario: Scenario) -> list[NamedManeuver]:
    """Give all maneuvers of traffic objects that there is a kernel for, by object and time, none at the same time.

    They are those that `resim mine` labels, as far as the object's trace reaches. Raises InputError where nobody is on
    the map.
    """
    mined = mine_recording(recording, MiningRules())
    t, ids = mined.features.samples.t, recording.gt.ids
    found = [
        NamedManeuver(str(ids[m.object]), m.label, float(t[m.start]), float(t[m.end]))
        for m in mined.maneuvers
    ]
    out: list[NamedManeuver] = []
    for one in scenario.objects:
        own = [m for m in found if m.object == one.id and m.label in kernels.kernels]
        span = one.spawn_time, float(one.v.x[-1])
        out += sorted(_apart(own, span, kernels.longest), key=lambda m: m.start)
    return out


def _apart(
    found: Sequence[NamedManeuver], span: tuple[float, float], longest: float
) -> Iterator[NamedManeuver]:
    """Maneuvers of one object without those parts that more special ones have, in parts up to `longest` [s]."""
    taken: list[tuple[float, float]] = []
    for m in sorted(found, key=lambda m: (MANEUVERS.index(m.label), m.start)):
        for start, end in _free(max(m.start, span[0]), min(m.end, span[1]), taken):
            if end - start < SHORTEST:
                continue
            taken.append((start, end))
            for first, last in equal_parts(start, end, longest):
                yield NamedManeuver(m.object, m.label, first, last)


def _free(start: float, end: float, taken: Iterable[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """What is left of a stretch."""
    for low, high in sorted(taken):
        if high <= start or low >= end:
            continue
        if low > start:
            yield start, low
        start = high
    if end > start:
        yield start, end


def the_origin(
    scenario: Scenario, network: RoadNetwork, kernels: KernelFile, wanted: Sequence[NamedManeuver]
) -> VariedOrigin:
    """Give a drive with these maneuvers to vary. Raises ResimError for an object or kernel that there is not."""
    motions: dict[str, LaneMotion] = {}
    maneuvers = []
    for m in wanted:
        if m.label not in kernels.kernels:
            why = kernels.not_made.get(m.label, "")
            raise ResimError(f"there is no kernel of {m.label}{': ' if why else ''}{why}")
        if m.object not in motions:
            motions[m.object] = _motion(scenario, network, m.object)
        motion, kernel = motions[m.object], kernels.kernels[m.label]
        if m.start < motion.t[0] - SAME or m.end > motion.t[-1] + SAME or m.end - m.start < SHORTEST:
            raise ResimError(f"object {m.object!r} has no trace from {m.start:g} to {m.end:g} s")
        features = feature_vector(motion, m.start, m.end, kernels.points)
        maneuvers.append(OriginManeuver(m, kernel, kernel.components(features)))
    return VariedOrigin(scenario, network, tuple(maneuvers), motions)


def _motion(scenario: Scenario, network: RoadNetwork, name: str) -> LaneMotion:
    one = object_of(scenario, name)
    trace = scenario.traces(network)[1 + scenario.objects.index(one)]
    z = None if one.z is None or one.z.x[0] > trace.start + SAME else one.z(one.z.x[:1])
    return motion_of(trace, network, None if z is None else np.asarray(z, dtype=float))


def object_of(scenario: Scenario, name: str) -> ScenarioObject:
    """Give a traffic object. Raises ResimError where there is none of this id."""
    found = next((one for one in scenario.objects if one.id == name), None)
    if found is None:
        told = ", ".join(one.id for one in scenario.objects[:20]) or "none"
        raise ResimError(f"there is no traffic object {name!r} to vary; there is {told}")
    return found
