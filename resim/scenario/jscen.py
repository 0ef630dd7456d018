"""JSCEN files: read and write (Wagner 2021, Section 5.2.2.2 and Appendix A.1).

Version 0.9 is the format as published. Version 0.10, which is written here, adds what a re-simulation
needs and the published format does not say: the boxes' length and width, and an id and model of the EGO. Version 0.11,
written where heights are known, adds these.
Polynomials are highest power first, in the time since the segment's `startTime`.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)
from scipy.interpolate import PPoly

from resim.core import faults
from resim.core.errors import InputError
from resim.core.files import read_file
from resim.core.json_text import json_text
from resim.core.tracks import KINDS
from resim.scenario.scenario import SIZES, RoadPosition, Scenario, ScenarioObject

VERSION, WITH_HEIGHTS = (0, 10), (0, 11)
_CONTINUOUS = 1e-6  # s; a segment starts where the one before it ends


class _JscenPart(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


_Number = Annotated[float, Field(ge=-1e12, le=1e12)]
_LONGEST = 86_400.0  # s; a trace is integrated in steps of 0.02 s


class _Segment(_JscenPart):
    startTime: _Number
    endTime: _Number
    polynomParameter: list[_Number] = Field(min_length=4, max_length=4)

    @model_validator(mode="after")
    def _forwards(self) -> _Segment:
        if self.endTime <= self.startTime:
            raise ValueError(f"endTime {self.endTime:g} is not after startTime {self.startTime:g}")
        return self


class _Height(_JscenPart):
    startTime: _Number
    endTime: _Number
    polynomParameter: list[_Number] = Field(min_length=2, max_length=2)


_Piece = TypeVar("_Piece", _Segment, _Height)


class _ReferenceObject(_JscenPart):
    odrLane: int = Field(ge=-1_000_000, le=1_000_000)
    odrRoad: int | str


class _StartPosition(_JscenPart):
    tOffset: _Number
    referenceObj: _ReferenceObject
    sOffset: _Number


class _Maneuver(_JscenPart):
    startPosition: _StartPosition
    velocity: list[_Segment] = Field(min_length=1)
    heading: list[_Segment] = Field(min_length=1)
    height: list[_Height] | None = Field(default=None, min_length=1)

    @model_serializer(mode="wrap")
    def _without_nothing(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Files of objects without a height are those of version 0.10."""
        told: dict[str, Any] = handler(self)
        return {name: value for name, value in told.items() if name != "height" or value is not None}

    @field_validator("height")
    @classmethod
    def _climbs(cls, pieces: list[_Height] | None) -> list[_Height] | None:
        for i, one in enumerate(pieces or ()):
            if one.endTime <= one.startTime:
                raise ValueError(f"height: endTime {one.endTime:g} is not after startTime {one.startTime:g}")
            if i and pieces and abs(pieces[i - 1].endTime - one.startTime) > _CONTINUOUS:
                raise ValueError(f"height: piece {i + 1} does not start where piece {i} ends")
        return pieces

    @field_validator("velocity", "heading")
    @classmethod
    def _joined(cls, segments: list[_Segment]) -> list[_Segment]:
        for i, (one, two) in enumerate(pairwise(segments)):
            if abs(one.endTime - two.startTime) > _CONTINUOUS:
                raise ValueError(
                    f"segment {i + 1} starts at {two.startTime:g} s, but segment {i} ends at {one.endTime:g} s"
                )
        return segments

    @model_validator(mode="after")
    def _together(self) -> _Maneuver:
        for name, end in (("start", 0), ("end", -1)):
            v, h = (getattr(s[end], f"{name}Time") for s in (self.velocity, self.heading))
            if abs(v - h) > _CONTINUOUS:
                raise ValueError(f"velocity and heading must {name} together: {v:g} s and {h:g} s")
        span = self.velocity[-1].endTime - self.velocity[0].startTime
        if span > _LONGEST:
            raise ValueError(f"the trace lasts {span:g} s, expected at most {_LONGEST:g} s")
        return self


class _JscenModel(_JscenPart):
    color: str = "#000000"
    type: str = "Unknown"
    length: float | None = Field(default=None, gt=0, le=1e12)
    width: float | None = Field(default=None, gt=0, le=1e12)

    @field_validator("type")
    @classmethod
    def _known(cls, value: str) -> str:
        if value.lower() not in KINDS:
            raise ValueError(f"type {value!r} is none of {', '.join(k.capitalize() for k in KINDS)}")
        return value


class _Vehicle(_JscenPart):
    maneuver: _Maneuver
    model: _JscenModel = Field(default_factory=_JscenModel)
    spawningTime: float
    description: str = ""
    objectId: int | str

    @model_validator(mode="after")
    def _spawns(self) -> _Vehicle:
        start = self.maneuver.velocity[0].startTime
        if abs(self.spawningTime - start) > _CONTINUOUS:
            raise ValueError(
                f"spawningTime {self.spawningTime:g} s is not the start of its trace, {start:g} s"
            )
        return self


class _Ego(_JscenPart):
    maneuver: _Maneuver
    model: _JscenModel = Field(default_factory=_JscenModel)
    objectId: int | str = "ego"


class _ObjectPool(_JscenPart):
    vehicles: list[_Vehicle]
    ego: _Ego

    @model_validator(mode="after")
    def _distinct(self) -> _ObjectPool:
        ids = [str(self.ego.objectId), *(str(vehicle.objectId) for vehicle in self.vehicles)]
        if twice := sorted(i for i, count in Counter(ids).items() if count > 1):
            raise ValueError(f"objectId {', '.join(twice)} stands more than once")
        return self


class _Version(_JscenPart):
    major: Literal[0]
    minor: Literal[9, 10, 11]


class JscenFile(_JscenPart):
    """The file's structure; its JSON Schema is published as `jscen.schema.json` beside this module."""

    map: str
    description: str = ""
    environment: dict[str, str] = Field(default_factory=dict)
    objectPool: _ObjectPool
    duration: float = Field(gt=0, le=_LONGEST)
    fileVersion: _Version

    @field_validator("map")
    @classmethod
    def _inside(cls, value: str) -> str:
        path = PurePosixPath(value.replace("\\", "/"))
        if not value or path.is_absolute() or ".." in path.parts or ":" in value:
            raise ValueError(
                f"map {value!r} must be a file in the folder of the JSCEN file; copy the map there"
            )
        return value


def schema() -> dict[str, Any]:
    """Give the JSON Schema of a JSCEN file."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **JscenFile.model_json_schema()}


def read_jscen(path: Path) -> Scenario:
    """Read a JSCEN file of version 0.9 to 0.11; every fault in it is named in one InputError."""
    try:
        text = read_file(path, "Check the path of the scenario").decode("utf-8")
    except UnicodeDecodeError as e:
        raise InputError(path, f"is not UTF-8 text (byte {e.start})") from e
    try:
        data = json.loads(text)
    except json.JSONDecodeError as e:
        raise InputError(path, f"is not JSON: {e.msg} at line {e.lineno}, column {e.colno}") from e
    except (ValueError, RecursionError) as e:
        raise InputError(path, f"is JSON that cannot be read: {e}") from e
    try:
        return _scenario(JscenFile.model_validate(data))
    except ValidationError as e:
        remedy = "The format is in resim/scenario/jscen.schema.json."
        raise InputError(path, faults.describe(e.errors(), JscenFile), remedy) from e


def _scenario(file: JscenFile) -> Scenario:
    pool = file.objectPool
    return Scenario(
        map=file.map,
        duration=file.duration,
        ego=_object(pool.ego.objectId, pool.ego.maneuver, pool.ego.model, ""),
        objects=tuple(_object(v.objectId, v.maneuver, v.model, v.description) for v in pool.vehicles),
        description=file.description,
        environment=file.environment,
    )


def _object(
    object_id: int | str, maneuver: _Maneuver, model: _JscenModel, description: str
) -> ScenarioObject:
    kind, start = model.type.lower(), maneuver.startPosition
    at = start.referenceObj
    return ScenarioObject(
        id=str(object_id),
        kind=kind,
        length=model.length or SIZES[kind][0],
        width=model.width or SIZES[kind][1],
        start=RoadPosition(str(at.odrRoad), at.odrLane, start.sOffset, start.tOffset),
        v=_polynomials(maneuver.velocity),
        heading=_polynomials(maneuver.heading),
        color=model.color,
        description=description,
        z=None if maneuver.height is None else _polynomials(maneuver.height),
    )


def _polynomials(segments: Sequence[_Segment] | Sequence[_Height]) -> PPoly:
    breaks = np.array([s.startTime for s in segments] + [segments[-1].endTime])
    return PPoly(np.array([s.polynomParameter for s in segments]).T, breaks)


def write_jscen(scenario: Scenario, path: Path) -> None:
    """Write a JSCEN file of version 0.10, or with heights 0.11, whole or not at all.

    Raises InputError for what the format cannot hold.
    """
    data = jscen(scenario).model_dump()
    try:
        JscenFile.model_validate(data)
    except ValidationError as e:
        raise InputError(
            path, f"this scenario cannot be written: {faults.describe(e.errors(), JscenFile)}"
        ) from e
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(json_text(data), encoding="utf-8")
    beside.replace(path)


def jscen(scenario: Scenario) -> JscenFile:
    """Give what a JSCEN file of version 0.10, or with heights 0.11, holds of a scenario; not validated."""
    ego = scenario.ego
    version = WITH_HEIGHTS if any(o.z is not None for o in (ego, *scenario.objects)) else VERSION
    pool = _ObjectPool.model_construct(
        vehicles=[
            _Vehicle.model_construct(
                maneuver=_maneuver(o),
                model=_model(o),
                spawningTime=o.spawn_time,
                description=o.description,
                objectId=_number(o.id),
            )
            for o in scenario.objects
        ],
        ego=_Ego.model_construct(maneuver=_maneuver(ego), model=_model(ego), objectId=_number(ego.id)),
    )
    return JscenFile.model_construct(
        map=scenario.map,
        description=scenario.description,
        environment=dict(scenario.environment),
        objectPool=pool,
        duration=scenario.duration,
        fileVersion=_Version.model_construct(major=version[0], minor=version[1]),
    )


def _maneuver(member: ScenarioObject) -> _Maneuver:
    start = member.start
    place = _ReferenceObject.model_construct(odrLane=start.lane, odrRoad=_number(start.road))
    return _Maneuver.model_construct(
        startPosition=_StartPosition.model_construct(tOffset=start.t, referenceObj=place, sOffset=start.s),
        velocity=_segments(_Segment, member.v),
        heading=_segments(_Segment, member.heading),
        height=None if member.z is None else _segments(_Height, member.z),
    )


def _model(member: ScenarioObject) -> _JscenModel:
    return _JscenModel.model_construct(
        color=member.color, type=member.kind.capitalize(), length=member.length, width=member.width
    )


def _segments(kind: type[_Piece], spline: PPoly) -> list[_Piece]:
    return [
        kind.model_construct(startTime=start, endTime=end, polynomParameter=c)
        for start, end, c in zip(
            spline.x[:-1].tolist(), spline.x[1:].tolist(), spline.c.T.tolist(), strict=True
        )
    ]


def _number(name: str) -> int | str:
    """An id as an integer where that says the same, as the published format has it."""
    return int(name) if name.isascii() and name.isdigit() and str(int(name)) == name else name
