"""Positions of OpenSCENARIO as places on the map.

Source: ASAM OpenSCENARIO XML 1.3, "Position". The map frame is that of the OpenDRIVE file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

from resim.core.errors import InputError
from resim.recordings.storyboard.document import ScenarioElement
from resim.recordings.tables import MOST_TURNED
from resim.road.links import Graph, lane_graph
from resim.road.opendrive import RoadNetwork

_OVER = 1e-3
"""m by which s may be beyond a road's end."""
_SAME = 1e-6
"""m by which a lane's distance from the reference line may differ between two places."""
READ = ("WorldPosition", "LanePosition", "RoadPosition")
RELATIVE = ("RelativeLanePosition", "RelativeObjectPosition", "RelativeRoadPosition")
"""Read at the start, where the entity that they name is put by another action of Init."""
_OTHERS = f"Positions that are read are {', '.join(READ)}."


@dataclass(frozen=True)
class ScenarioPlace:
    """Where a reference point is.

    Attributes:
        x: m, map frame.
        y: m, map frame.
        heading: rad as the file says it, None where it does not.
        usual: rad where the file says none: along the lane or road; east at a WorldPosition.
        spot: Road, lane and s [m], where the file gives it on a lane.
    """

    x: float
    y: float
    heading: float | None
    usual: float
    spot: tuple[str, int, float] | None = None

    @property
    def faced(self) -> float:
        """Heading [rad] of who is put there."""
        return self.usual if self.heading is None else self.heading


class ScenarioPlaces:
    """Reads positions; the map is loaded when the first of them needs it."""

    def __init__(self, load: Callable[[], RoadNetwork]) -> None:
        self._load = load

    @cached_property
    def network(self) -> RoadNetwork:
        """The map."""
        return self._load()

    @cached_property
    def lanes(self) -> Graph:
        """Which lane of the map goes on into which."""
        return lane_graph(self.network)

    def of(
        self, position: ScenarioElement, placed: Mapping[str, ScenarioPlace] = MappingProxyType({})
    ) -> ScenarioPlace:
        """Give the place of a Position.

        placed: Where entities are at that moment, by their names.

        Raises:
            InputError: It is of another kind than READ, or of RELATIVE to one of these, or not on the map.
        """
        told = position.only()
        reference = placed.get(told.text("entityRef")) if told.tag in RELATIVE else None
        if told.tag not in READ and reference is None:
            raise told.refused("is not read: it depends on something else than the map", _OTHERS)
        try:
            if reference is not None:
                return getattr(self, f"_of_{told.tag}")(told, reference)  # type: ignore[no-any-return]
            return getattr(self, f"_of_{told.tag}")(told)  # type: ignore[no-any-return]
        except InputError as e:
            if e.source == str(told.file):
                raise
            raise told.refused(f"is not on the map {e.source}: {e.problem}", e.remedy) from None

    def _of_WorldPosition(self, told: ScenarioElement) -> ScenarioPlace:  # noqa: N802  the element's name
        heading = None if told.get("h") is None else _angle(told)
        return ScenarioPlace(told.number("x"), told.number("y"), heading, 0.0)

    def _of_LanePosition(self, told: ScenarioElement) -> ScenarioPlace:  # noqa: N802
        road, s = self._on_road(told)
        text = told.text("laneId")
        try:
            lane = int(text)
        except ValueError:
            raise told.refused(f"laneId is {text[:40]!r}, expected a whole number") from None
        return self._on_lane(told, road, lane, s)

    def _on_lane(self, told: ScenarioElement, road: str, lane: int, s: float) -> ScenarioPlace:
        if not self.network.has_lane(road, lane, s):
            raise told.refused(f"names lane {lane} of road {road} at s {s:g} m, which is not there")
        x, y = self.network.to_xy(road, lane, s, told.number("offset", 0.0))
        along = float(self.network.lane_heading(road, lane, s))
        return ScenarioPlace(float(x), float(y), _oriented(told, along), along, (road, lane, s))

    def _of_RoadPosition(self, told: ScenarioElement) -> ScenarioPlace:  # noqa: N802
        return self._beside(told, *self._on_road(told), told.number("t"))

    def _beside(self, told: ScenarioElement, road: str, s: float, t: float) -> ScenarioPlace:
        """The place at s and t [m] of a road."""
        x, y, along = (float(value) for value in self.network.reference_line(road, s))
        x, y = x - t * math.sin(along), y + t * math.cos(along)
        return ScenarioPlace(x, y, _oriented(told, along), along)

    def _of_RelativeLanePosition(  # noqa: N802
        self, told: ScenarioElement, reference: ScenarioPlace
    ) -> ScenarioPlace:
        """So many lanes to the left, and metres of the road ahead, where all readings of the standard agree: on the
        right side of the road, where to the left is up and ahead is along s."""
        change = told.number("dLane")
        if told.get("ds") is None:
            raise told.refused("is not read: it has no ds", "Give ds, or a LanePosition.")
        return self._on_lane(told, *self._ahead(told, reference, change))

    def _of_RelativeRoadPosition(  # noqa: N802
        self, told: ScenarioElement, reference: ScenarioPlace
    ) -> ScenarioPlace:
        """So many metres of s and t on, on the right side of the road, and where the lane that the entity is on keeps
        its distance from the reference line: a player such as esmini goes ds along the lane, and then aside."""
        road, lane, s = self._ahead(told, reference, 0.0)
        if not self.network.has_lane(road, lane, s):
            raise told.refused(f"names lane {lane} of road {road} at s {s:g} m, which is not there")
        assert reference.spot is not None
        centre, ahead = (
            self._t(road, at, *(float(c) for c in self.network.to_xy(road, lane, at, 0.0)))
            for at in (reference.spot[2], s)
        )
        if abs(ahead - centre) > _SAME:
            raise told.refused(
                f"is not read: players differ where the lane's distance from the reference line changes, as that of "
                f"lane {lane} of road {road} from {centre:g} to {ahead:g} m", _OTHERS,
            )  # fmt: skip
        t = self._t(road, reference.spot[2], reference.x, reference.y) + told.number("dt")
        return self._beside(told, road, s, t)

    def _t(self, road: str, s: float, x: float, y: float) -> float:
        """How far [m] a place is to the left of the reference line, at its s."""
        x_line, y_line, along = (float(value) for value in self.network.reference_line(road, s))
        return (y - y_line) * math.cos(along) - (x - x_line) * math.sin(along)

    def _ahead(
        self, told: ScenarioElement, reference: ScenarioPlace, change: float
    ) -> tuple[str, int, float]:
        """Road, lane and s [m], ds ahead of an entity that is on a lane below 0, and so many lanes to the left."""
        if reference.spot is None or reference.spot[1] >= 0 or change != round(change):
            raise told.refused(
                "is not read: players differ where the entity that it names is not put on a lane with an id below 0",
                _OTHERS,
            )
        road, lane, s = (
            reference.spot[0],
            reference.spot[1] + int(change),
            reference.spot[2] + told.number("ds"),
        )
        length = self.network.roads[road].length
        if lane >= 0 or not 0.0 <= s <= length:
            raise told.refused(
                f"leads to lane {lane} of road {road} at s {s:g} m: only lanes below 0 of the same road, which has "
                f"{length:g} m, are read", _OTHERS,
            )  # fmt: skip
        return road, lane, s

    def _of_RelativeObjectPosition(  # noqa: N802
        self, told: ScenarioElement, reference: ScenarioPlace
    ) -> ScenarioPlace:
        dx, dy, along = told.number("dx"), told.number("dy"), reference.faced
        x = reference.x + dx * math.cos(along) - dy * math.sin(along)
        y = reference.y + dx * math.sin(along) + dy * math.cos(along)
        return ScenarioPlace(x, y, _oriented(told, along), along)

    def _on_road(self, told: ScenarioElement) -> tuple[str, float]:
        """Road and s [m] of a position."""
        road, s = told.text("roadId"), told.number("s")
        if road not in self.network.roads:
            some = ", ".join([*self.network.roads][:8])
            raise told.refused(f"names road {road!r}, which is not on the map", f"Its roads are {some}.")
        length = self.network.roads[road].length
        if not -_OVER <= s <= length + _OVER:
            raise told.refused(f"s is {s:g} m, road {road} has {length:g} m")
        return road, min(max(s, 0.0), length)


def _oriented(told: ScenarioElement, along: float) -> float | None:
    """The heading [rad] that a position says, None for none; one that is relative counts from the lane or road."""
    orientation = told.child("Orientation")
    if orientation is None or orientation.get("h") is None:
        return None
    h = _angle(orientation)
    return along + h if orientation.get("type", "absolute") == "relative" else h


def _angle(told: ScenarioElement) -> float:
    h = told.number("h")
    if abs(h) > MOST_TURNED:
        raise told.refused(f"h is {h:g}, expected radians up to {MOST_TURNED:g}")
    return h
