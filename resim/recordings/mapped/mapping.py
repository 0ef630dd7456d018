"""The mapping file: what the columns of somebody's tables mean, as TOML."""

from __future__ import annotations

import re
from collections.abc import Mapping as Dict
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, ValidationError, model_validator
from pydantic_core import CoreSchema

from resim.core import faults
from resim.core.errors import InputError
from resim.core.files import parse_toml, read_file
from resim.core.spec import Strict
from resim.core.tracks import ObjectKind
from resim.recordings.logs.definitions import Distribution
from resim.recordings.mapped.units import (
    AccelerationUnit,
    AngleUnit,
    LengthUnit,
    PlaceUnit,
    ShareUnit,
    SpeedUnit,
    TimeUnit,
    YawRateUnit,
)

EXAMPLE = "An example stands in docs/formats/mapping.md; `resim import guess FILE` writes a first one."

LEAST_RATE, MOST_RATE = 1e-3, 1e6
"""Least and largest rate of frames [Hz]."""

Reference = Literal[
    "center", "front", "rear", "rear axle", "front left", "front right", "rear left", "rear right"
]


class Column(Strict):
    """Where a value stands: the column's name alone, or a table with its unit; or one value for all rows."""

    column: str | None = Field(default=None, min_length=1)

    @model_validator(mode="before")
    @classmethod
    def _named(cls, told: Any) -> Any:
        """A text is the column's name."""
        return {"column": told} if isinstance(told, str) else told

    @model_validator(mode="after")
    def _one(self) -> Self:
        ways = [self.column, getattr(self, "value", None), getattr(self, "quaternion", None)]
        if sum(way is not None for way in ways) != 1:
            raise ValueError("expected a column, or { value = ... } for one value in all rows")
        return self

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """A text or the table."""
        return {"anyOf": [{"type": "string", "minLength": 1}, handler(core)]}


class NameColumn(Column):
    """A column of names, or one name for all rows."""

    value: str | None = Field(default=None, min_length=1)


class KindColumn(Column):
    """A column of kinds; names: which kind a value of it is, beside the kinds themselves in any case."""

    value: ObjectKind | None = None
    names: dict[str, ObjectKind] = Field(default_factory=dict)


class TimeColumn(Column):
    """A column of times. unit "frames" needs their rate [Hz]; "iso" is ISO 8601, UTC where it names no zone."""

    column: str = Field(min_length=1)
    unit: TimeUnit = "s"
    rate: float | None = Field(default=None, ge=LEAST_RATE, le=MOST_RATE)


class CoordinateColumn(Column):
    """A coordinate; without a unit m, of latitude and longitude deg."""

    value: float | None = None
    unit: PlaceUnit | None = None


class HeightColumn(Column):
    """A height."""

    value: float | None = None
    unit: LengthUnit = "m"


class LengthColumn(Column):
    """A length."""

    value: float | None = Field(default=None, gt=0.0)
    unit: LengthUnit = "m"


class HeadingColumn(Column):
    """A heading: from where it counts ("x": the table's x axis, "north"), and which way, seen from above.

    Attributes:
        quaternion: In place of a column: the path of x, y, z and w of a rotation, or those four columns.
    """

    value: float | None = None
    quaternion: Annotated[str, Field(min_length=1)] | tuple[str, str, str, str] | None = None
    unit: AngleUnit = "rad"
    zero: Literal["x", "north"] = "x"
    clockwise: bool = False

    @property
    def parts(self) -> tuple[str, ...]:
        """The columns x, y, z and w of the quaternion, () where there is none."""
        if isinstance(self.quaternion, str):
            return tuple(f"{self.quaternion}.{part}" for part in "xyzw")
        return self.quaternion or ()

    @model_validator(mode="after")
    def _radians(self) -> Self:
        if self.quaternion is not None and self.unit != "rad":
            raise ValueError("a quaternion has no unit")
        return self


class SpeedColumn(Column):
    """A speed. relative: the EGO's velocity is still to be added."""

    value: float | None = None
    unit: SpeedUnit = "m/s"
    relative: bool = False


class YawRateColumn(Column):
    """A yaw rate."""

    value: float | None = None
    unit: YawRateUnit = "rad/s"
    clockwise: bool = False


class AccelerationColumn(Column):
    """An acceleration along the heading."""

    value: float | None = None
    unit: AccelerationUnit = "m/s2"


class ProbabilityColumn(Column):
    """A probability."""

    value: float | None = Field(default=None, ge=0.0, le=100.0)
    unit: ShareUnit = "1"


Pose = tuple[float, float, float]


class TableMapping(Strict):
    """One table: which file and rows, in which frame, and what its columns mean.

    Attributes:
        file: Of the table, relative to the mapping; without it the file that the command names.
        topic: In a log (MCAP, rosbag2, MDF4): whose messages are the rows; of MDF4 the channel group (name or number).
        list: Path of the list in the topic's messages whose elements are the rows; without it each message is one.
        ros: ROS distribution whose message definitions are taken, where a rosbag2 brings none and does not say which it
            is of; else humble.
        separator: Between values of a CSV: one ASCII character.
        decimal: What stands before the decimals.
        only: Rows that are read: those with this value, or one of these, in each of these columns.
        without: Rows that are left out: those with this value, or one of these, in one of these columns.
        crs: Coordinate system of x and y (or lat and lon), as pyproj knows it, such as EPSG:4326 or EPSG:25832; they
            are turned into the map's by its geoReference.
        frame: What x and y count from, where no crs is given: the map, the EGO or its sensor (x ahead, y to the left).
        mounting: Pose of the sensor on the EGO, from its box's centre [m m rad]; needed with frame = "sensor".
        offset: Pose of the table's axes in the map [m m rad], with frame = "map".
        mirrored: Whether y points to the right, or down.
        reference: Which point of the box x and y are of.
        rear_overhang: From the rear axle to the rear bumper [m]; needed with reference = "rear axle".
        id: The object's name; in sd without it: objects are followed from list to list.
        t: The time.
        x: Of the position; with a crs easting or longitude.
        y: Of the position; with a crs northing or latitude.
        lat: Latitude, in place of y.
        lon: Longitude, in place of x.
        heading: Of the object; without it from vx and vy, or from the positions.
        v: Speed along the heading; without it, and without vx and vy, from the positions.
        vx: Velocity along the table's x (with a crs to the east), in place of v.
        vy: Velocity along the table's y (with a crs to the north).
        length: Of the box; without it assumed by kind.
        width: Of the box; without it assumed by kind.
        kind: What the object is; without it unknown.
        yaw_rate: Of the object.
        a: Acceleration along the heading.
        z: Height of the road under the object, over sea or ellipsoid (altitude), whatever crs and frame are: as the map
            has it, or all off by one amount.
        existence: Probability that there is such an object.
        gt_id: In sd: the same object's id in gt.
    """

    file: str | None = Field(default=None, min_length=1)
    topic: str | None = Field(default=None, min_length=1)
    list: str | None = Field(default=None, min_length=1)
    ros: Distribution | None = None
    separator: str = Field(default=",", min_length=1, max_length=1)
    decimal: Literal[".", ","] = "."
    only: dict[str, str | tuple[str, ...]] = Field(default_factory=dict)
    without: dict[str, str | tuple[str, ...]] = Field(default_factory=dict)
    crs: str | None = Field(default=None, min_length=1)
    frame: Literal["map", "ego", "sensor"] = "map"
    mounting: Pose | None = None
    offset: Pose | None = None
    mirrored: bool = False
    reference: Reference = "center"
    rear_overhang: float | None = Field(default=None, ge=0.0, le=10.0)
    id: NameColumn | None = None
    t: TimeColumn
    x: CoordinateColumn | None = None
    y: CoordinateColumn | None = None
    lat: CoordinateColumn | None = None
    lon: CoordinateColumn | None = None
    heading: HeadingColumn | None = None
    v: SpeedColumn | None = None
    vx: SpeedColumn | None = None
    vy: SpeedColumn | None = None
    length: LengthColumn | None = None
    width: LengthColumn | None = None
    kind: KindColumn | None = None
    yaw_rate: YawRateColumn | None = None
    a: AccelerationColumn | None = None
    z: HeightColumn | None = None
    existence: ProbabilityColumn | None = None
    gt_id: NameColumn | None = None

    @property
    def places(self) -> tuple[tuple[str, CoordinateColumn], tuple[str, CoordinateColumn]]:
        """The coordinates to the east (or ahead) and to the north (or to the left), each with its name."""
        found = [
            next((name, own) for name in names if (own := getattr(self, name)) is not None)
            for names in (("x", "lon"), ("y", "lat"))
        ]
        return found[0], found[1]

    @property
    def columns(self) -> dict[str, str]:
        """Every column that is named, each with the field that names it."""
        found: dict[str, str] = {}
        for name in type(self).model_fields:
            told = getattr(self, name)
            if isinstance(told, HeadingColumn):
                found |= dict.fromkeys(told.parts, f"{name}.quaternion")
            if isinstance(told, Column) and told.column is not None:
                found[told.column] = name
        return dict.fromkeys(self.only, "only") | dict.fromkeys(self.without, "without") | found

    @model_validator(mode="after")
    def _fits(self) -> Self:
        """What is given goes together."""
        for problem, wrong in _CONTRADICTIONS.items():
            if wrong(self):
                raise ValueError(problem)
        return self


_CONTRADICTIONS: Dict[str, Any] = {
    "separator is none: expected one printable ASCII character, or a tab, and neither a quote nor a line break": (
        lambda m: m.separator != "\t" and (not " " <= m.separator <= "~" or m.separator == '"')
    ),
    "list and ros need a topic": lambda m: m.topic is None and (m.list is not None or m.ros is not None),
    "needs x and y, or lat and lon": lambda m: (
        [m.x is None, m.y is None, m.lat is None, m.lon is None]
        not in ([False, False, True, True], [True, True, False, False])
    ),
    'lat and lon need a crs, such as crs = "EPSG:4326"': lambda m: m.lat is not None and m.crs is None,
    "crs and frame exclude each other: give one": lambda m: m.crs is not None and m.frame != "map",
    "crs excludes offset and mirrored": lambda m: m.crs is not None and (m.offset is not None or m.mirrored),
    'offset goes with frame = "map"': lambda m: m.offset is not None and m.frame != "map",
    'frame = "sensor" needs mounting = [x, y, heading], from the centre of the EGO\'s box [m m rad]': lambda m: (
        m.frame == "sensor" and m.mounting is None
    ),
    'mounting goes with frame = "sensor"': lambda m: m.mounting is not None and m.frame != "sensor",
    'reference = "rear axle" needs rear_overhang [m]': lambda m: (
        m.reference == "rear axle" and m.rear_overhang is None
    ),
    'rear_overhang goes with reference = "rear axle"': lambda m: (
        m.rear_overhang is not None and m.reference != "rear axle"
    ),
    "v excludes vx and vy: give one": lambda m: m.v is not None and (m.vx is not None or m.vy is not None),
    "vx and vy go together; for one that is 0 give { value = 0.0 }": lambda m: (m.vx is None) != (m.vy is None),
    "relative goes with vx and vy": lambda m: m.v is not None and m.v.relative,
    "vx and vy are both relative, or none is": lambda m: (
        m.vx is not None and m.vy is not None and m.vx.relative != m.vy.relative
    ),
}  # fmt: skip
"""What is wrong with a table, and when it is."""


class Match(Strict):
    """Which SD object is which GT object.

    Attributes:
        by: "column": as the column gt_id of sd says; "id": both have the same ids; "nearest": by assignment of those
            nearest to each other.
        gate: Farthest [m] that an SD object may be from its GT, with "nearest".
    """

    by: Literal["column", "id", "nearest"]
    gate: float = Field(default=3.0, gt=0.0, le=100.0)


def _listed(told: Any) -> Any:
    """One table is a list of one."""
    return [told] if isinstance(told, dict) else told


_Tables = Annotated[
    list[TableMapping],
    BeforeValidator(_listed),
    Field(json_schema_extra=lambda schema: schema.update(_one_or_many(schema))),
]


def _one_or_many(schema: dict[str, Any]) -> dict[str, Any]:
    many = {key: schema.pop(key) for key in ("type", "items", "minItems") if key in schema}
    return {"anyOf": [many["items"], many]}


class Mapping(Strict):
    """What the columns of tables mean.

    Attributes:
        ego: Id of the EGO in gt; --ego overrides it.
        gt: The table, or tables, of the ground truth.
        sd: The table, or tables, of the sensor data.
        match: Which SD object is which GT object; without it as gt_id says, else by "nearest".
    """

    ego: str | None = Field(default=None, min_length=1)
    gt: _Tables = Field(min_length=1)
    sd: _Tables = Field(default_factory=list)
    match: Match | None = None

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if self.match is not None and not self.sd:
            raise ValueError("match is given, but there is no table sd")
        if self.match is not None and self.match.by == "column" and any(m.gt_id is None for m in self.sd):
            raise ValueError('match.by = "column" needs gt_id in sd')
        if any(m.id is None for m in self.gt):
            raise ValueError(
                'gt.id is missing: the column of ids, or { value = "ego" } for a table of one object'
            )
        if any(m.id is None and m.gt_id is not None for m in self.sd):
            raise ValueError("gt_id in sd needs id")
        if len(self.sd) > 1 and any(m.id is None for m in self.sd):
            raise ValueError("of several tables in sd each needs id")
        if self.match is not None and self.match.by == "id" and any(m.id is None for m in self.sd):
            raise ValueError('match.by = "id" needs id in sd')
        if any(m.gt_id is not None for m in self.gt):
            raise ValueError("gt_id goes in sd")
        if all(m.frame != "map" for m in self.gt):
            raise ValueError("the EGO itself needs a table in gt with a crs, or in the map's frame")
        return self

    @property
    def matching(self) -> Match:
        """How SD is matched with GT."""
        named = bool(self.sd) and all(m.gt_id is not None for m in self.sd)
        return self.match or Match(by="column" if named else "nearest")


def read_mapping(path: Path) -> Mapping:
    """Read a mapping file. Raises InputError naming every fault."""
    told = parse_toml(read_file(path, EXAMPLE), path, EXAMPLE)
    try:
        return Mapping.model_validate(told)
    except ValidationError as e:
        text = faults.describe(e.errors(), Mapping)
        for name in ("gt", "sd"):
            if isinstance(told.get(name), dict):
                text = re.sub(rf"\b{name}\.0(?=[.:])", name, text)
        raise InputError(path, text, EXAMPLE) from e
