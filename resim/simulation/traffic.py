"""The guided traffic as the loop needs it: everything known beforehand is laid out before the first step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, constant
from resim.core.tracks import Strings
from resim.road.driven_route import Route, driven_route
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario, ScenarioObject
from resim.simulation.function.interface import unknown_heights
from resim.simulation.guide import Guide, guide
from resim.simulation.perception import Worlds
from resim.simulation.surface import Surface

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Phase:
    """Steps first <= k < after, in which the same n traffic objects are there.

    shown: whether a simulator sees them; of the lead-in it is told nothing. rows: (n,) of the guide. truth: per step,
    t [s], and of the objects position (n,) x + iy [m], heading (n,) [rad], v (n,) [m/s]. z: per step, of the objects
    (n,) [m], None where no height is known. The rest: (n,).
    """

    first: int
    after: int
    shown: bool
    rows: Rows
    truth: list[tuple[float, NDArray[np.complex128], Floats, Floats]]
    ids: Strings
    kind: Strings
    length: Floats
    width: Floats
    z: Floats | None = None

    def worlds(self, k: int, ego: Floats, ego_z: Floats | None) -> Worlds:
        """Give the truth at step k: where the objects were commanded to be; ego (B, 6), ego_z (B,) m or None."""
        t, position, heading, v = self.truth[k - self.first]
        z = None if self.z is None else self.z[k - self.first]
        under = unknown_heights(len(ego)) if ego_z is None else ego_z
        return Worlds(t, ego, self.ids, self.kind, position, heading, v, self.length, self.width, z, under)


@dataclass(frozen=True, eq=False)
class Stage:
    """What every run of one scenario shares: the guided motion, its phases, where the EGO may be, which way it went."""

    members: tuple[ScenarioObject, ...]
    plan: Guide
    phases: tuple[Phase, ...]
    surface: Surface
    route: Route

    @cached_property
    def length(self) -> Floats:
        """Lengths (N,) [m], EGO first."""
        return constant(np.array([m.length for m in self.members]))

    @cached_property
    def width(self) -> Floats:
        """Widths (N,) [m], EGO first."""
        return constant(np.array([m.width for m in self.members]))

    @property
    def shown(self) -> tuple[Phase, ...]:
        """The phases that a simulator sees."""
        return tuple(phase for phase in self.phases if phase.shown)


@lru_cache(maxsize=8)
def staged(scenario: Scenario, network: RoadNetwork, step: float, lead_in: float) -> Stage:
    """Lay out the scenario for its runs at this step [s] with this lead-in [s]; kept for the next run."""
    plan = guide(scenario, network, step=step, lead_in=lead_in)
    members = (scenario.ego, *scenario.objects)
    own = slice(plan.begin, None)
    measured = (c[0, own][plan.present[0, own]] for c in (plan.x, plan.y, plan.heading))
    z = None if plan.z is None else plan.z[0, own][plan.present[0, own]]
    route = driven_route(network, *measured, z=z)
    return Stage(members, plan, tuple(phases(plan, members)), Surface(network, plan), route)


def phases(plan: Guide, members: Sequence[ScenarioObject]) -> Iterator[Phase]:
    """Cut the run where traffic objects come or go, and at the start; members: the EGO, then the traffic objects."""
    length, width = (np.array([getattr(m, name) for m in members]) for name in ("length", "width"))
    ids, kind = (np.array([getattr(m, name) for m in members], dtype=str) for name in ("id", "kind"))
    changes = np.flatnonzero((plan.present[1:, 1:] != plan.present[1:, :-1]).any(axis=0)) + 1
    borders = sorted({0, plan.begin, *changes.tolist(), len(plan.t)})
    for first, after in pairwise(borders):
        rows, shown = 1 + np.flatnonzero(plan.present[1:, first]), first >= plan.begin
        x, y, heading, v = (c[rows, first:after].T.copy() for c in (plan.x, plan.y, plan.heading, plan.v))
        position, heading, v = constant(x + 1j * y), constant(heading), constant(v)  # every run sees these
        who = [constant(column[rows]) for column in (ids, kind, length, width)]
        yield Phase(
            first=first,
            after=after,
            shown=shown,
            rows=rows,
            truth=list(zip(plan.t[first:after].tolist(), position, heading, v, strict=True)),
            ids=who[0],
            kind=who[1],
            length=who[2],
            width=who[3],
            z=None if plan.z is None else constant(plan.z[rows, first:after].T.copy()),
        )
