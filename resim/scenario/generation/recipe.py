"""The file of `resim generate`: a map, and objects with their routes, speeds and maneuvers."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from resim.core.files import joined
from resim.core.spec import Strict, TextPattern, read_strict
from resim.core.tracks import PART, ObjectKind
from resim.scenario.scenario import SIZES

REMEDY = "docs/guides/generate.md shows one."
Number = Annotated[float, Field(strict=True)]
NotNegative = Annotated[float, Field(strict=True, ge=0.0)]
Positive = Annotated[float, Field(strict=True, gt=0.0)]
Speed = Annotated[float, Field(strict=True, ge=0.0, le=100.0)]
Name = Annotated[str, Field(min_length=1)]
Color = Annotated[str, TextPattern(r"^#[0-9a-fA-F]{6}$", "a colour such as #1f77b4")]
Point = tuple[Number, Number]


class PlaceSpec(Strict):
    """A place on a lane.

    Attributes:
        road: OpenDRIVE id.
        lane: OpenDRIVE id; right lanes are negative.
        s: m along the road.
        offset: m left of the lane's centre, as traffic drives there.
    """

    road: Name
    lane: int
    s: NotNegative
    offset: Number = 0.0


class LaneRoute(PlaceSpec):
    """A route by lanes: from a place on, along the lane and what it goes on into.

    Attributes:
        against: Whether it leads against the lane's direction.
        via: Roads of junctions that it takes where a lane leads to several.
    """

    against: bool = False
    via: tuple[Name, ...] = ()


class PointRoute(Strict):
    """A route by points: the cubic spline through at least four of them, in the map frame or on lanes.

    Attributes:
        points: x, y [m].
        places: Places on lanes.
    """

    points: tuple[Point, ...] = ()
    places: tuple[PlaceSpec, ...] = ()

    @model_validator(mode="after")
    def _one(self) -> PointRoute:
        if bool(self.points) == bool(self.places):
            raise ValueError("a route by points has either points or places")
        if len(self.points or self.places) < 4:
            raise ValueError("expected 4 or more points, as a cubic spline needs them")
        return self


class SpeedOverTimeSpec(Strict):
    """Speeds at times, monotone cubics between.

    Attributes:
        times: s of the recording.
        values: m/s.
    """

    times: tuple[NotNegative, ...]
    values: tuple[Speed, ...]


class SpeedOverWaySpec(Strict):
    """Speeds at places along the route, constant acceleration between.

    Attributes:
        ways: m from the route's start.
        values: m/s.
    """

    ways: tuple[NotNegative, ...]
    values: tuple[Speed, ...]


class ChangeSpec(Strict):
    """A lane change, or with `offset` alone a shift within the lane.

    Attributes:
        to: To which side.
        lanes: How many lanes.
        offset: m left of the new lane's centre where it ends.
        at: Where it begins: m along the route from its start.
        t: When it begins: s of the recording.
        seconds: How long it takes.
        metres: Over how much of the way it goes.
    """

    to: Literal["left", "right"] | None = None
    lanes: Annotated[int, Field(strict=True, ge=1, le=10)] = 1
    offset: Number = 0.0
    at: NotNegative | None = None
    t: NotNegative | None = None
    seconds: Positive | None = None
    metres: Positive | None = None

    @model_validator(mode="after")
    def _says(self) -> ChangeSpec:
        if (self.at is None) == (self.t is None):
            raise ValueError("say either where the change begins (at, m along the route) or when (t, s)")
        if (self.seconds is None) == (self.metres is None):
            raise ValueError("say how long the change is, either in seconds or in metres")
        return self


class SlipSpec(Strict):
    """By how much a box is turned to the left of its motion, as of who skids; smooth steps between, steady beyond.

    Attributes:
        times: s of the recording.
        values: rad.
    """

    times: tuple[NotNegative, ...]
    values: tuple[Annotated[float, Field(strict=True, gt=-3.15, lt=3.15)], ...]

    @model_validator(mode="after")
    def _in_order(self) -> SlipSpec:
        if len(self.times) < 2 or len(self.times) != len(self.values):
            raise ValueError(
                f"expected two or more times and as many values, found {len(self.times)} and {len(self.values)}"
            )
        if any(b <= a for a, b in pairwise(self.times)):
            raise ValueError("times: expected each later than the one before")
        return self


class ManeuverSpec(Strict):
    """A maneuver that the author planted, for the table of truth.

    Attributes:
        label: Its name.
        start: s.
        end: s.
        t: The moment that defines it [s].
        partner: Id of the other object, "" for none.
    """

    label: Name
    start: NotNegative
    end: NotNegative
    t: NotNegative
    partner: str = ""

    @model_validator(mode="after")
    def _in_order(self) -> ManeuverSpec:
        if not self.start <= self.t <= self.end:
            raise ValueError(f"expected start <= t <= end, found {self.start:g}, {self.t:g}, {self.end:g}")
        return self


class ObjectSpec(Strict):
    """An object.

    Attributes:
        id: Its id in the recording.
        kind: Its kind.
        length: m; without it, the usual of its kind.
        width: m; without it, the usual of its kind.
        color: As in JSCEN, such as #1f77b4.
        appears: When it appears [s].
        leaves: When it leaves [s]; without it, it stays until the end, or until its route ends.
        reverse: Whether it drives backwards along its route.
        route: By lanes or by points.
        speed: m/s, or speeds at times or places.
        change: Lane changes, on a route by lanes.
        slip: How it is turned against its motion; without it, it is headed as it moves.
        maneuver: What else it does, for the table of truth.
    """

    id: Name
    kind: ObjectKind = "car"
    length: Positive | None = None
    width: Positive | None = None
    color: Color = "#000000"
    appears: NotNegative = 0.0
    leaves: Positive | None = None
    reverse: bool = False
    route: LaneRoute | PointRoute
    speed: Speed | SpeedOverTimeSpec | SpeedOverWaySpec
    change: tuple[ChangeSpec, ...] = ()
    slip: SlipSpec | None = None
    maneuver: tuple[ManeuverSpec, ...] = ()

    @property
    def size(self) -> tuple[float, float]:
        """Length and width [m]."""
        length, width = SIZES[self.kind]
        return self.length or length, self.width or width

    @model_validator(mode="after")
    def _agrees(self) -> ObjectSpec:
        if self.change and isinstance(self.route, PointRoute):
            raise ValueError(
                "change: a route by points has no lanes to change; put the change into the points"
            )
        if self.leaves is not None and self.leaves <= self.appears:
            raise ValueError(
                f"leaves: expected more than appears ({self.appears:g} s), found {self.leaves:g}"
            )
        return self


class Recipe(Strict):
    """A drive to generate.

    Attributes:
        description: What happens.
        map: OpenDRIVE file, as seen from the recipe.
        ego: Id of the object that is the EGO.
        duration: s.
        rate: Samples a second [Hz].
        kinds: Rows of a scenario catalog that it is an example of.
        accept: Codes of `resim check` that are asked for, such as WRONG_WAY.
        overlaps: Pairs of objects that may overlap, as in an accident.
        environment: In JSCEN's terms.
        object: The objects.
    """

    description: str = ""
    map: Name
    ego: Name = "ego"
    duration: Annotated[float, Field(strict=True, gt=0.0, le=3600.0)]
    rate: Annotated[float, Field(strict=True, ge=1.0, le=1000.0)] = 25.0
    kinds: tuple[Name, ...] = ()
    accept: tuple[Name, ...] = ()
    overlaps: tuple[tuple[Name, Name], ...] = ()
    environment: Mapping[Literal["fogDensity", "precipitationDensity", "dateTime"], str] = Field(
        default_factory=dict
    )
    object: Annotated[tuple[ObjectSpec, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _names(self) -> Recipe:
        ids = [one.id for one in self.object]
        if doubles := sorted({name for name in ids if ids.count(name) > 1}):
            raise ValueError(f"object: the id {doubles[0]!r} is a duplicate")
        known = set(ids)
        if self.ego not in known:
            raise ValueError(f"ego: {self.ego!r} was not found among the objects {', '.join(ids)}")
        named = [(name, "overlaps") for pair in self.overlaps for name in pair]
        named += [(m.partner, "maneuver.partner") for one in self.object for m in one.maneuver if m.partner]
        for name, field in named:
            if name not in known:
                raise ValueError(f"{field}: {name!r} was not found among the objects {', '.join(ids)}")
        if whole := [name for name in ids if PART in name]:
            raise ValueError(
                f"object: the id {whole[0]!r} holds {PART!r}, which parts of tracks are named with"
            )
        return self

    def map_file(self, recipe: Path) -> Path:
        """Give the map of the recipe at this path."""
        return joined(recipe, self.map)


def read_recipe(path: Path) -> Recipe:
    """Read a recipe. Raises InputError naming every fault."""
    return read_strict(path, Recipe, REMEDY)
