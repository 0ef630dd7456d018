"""A drive as rosbag2 for ROS 2: the EGO's odometry, objects in Autoware's messages, plans, boxes for RViz, verdicts.

Beside the bag lies the mapping by which `resim import table` reads it. The frame of the map is `map`; an odometry is
that of the middle of the EGO's rear axle, as Autoware's.
"""

from __future__ import annotations

import heapq
import json
import math
import re
from collections.abc import Iterator
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from resim.core.spec import to_json
from resim.exports.mcap_checksums import add_checksums
from resim.exports.states import (
    SECOND,
    ExportedState,
    derived,
    first_second,
    first_time,
    nanoseconds,
    numbers,
    states,
)
from resim.report.player import PlayedDrive
from resim.report.player.colors import layer_colors
from resim.report.player.drive import Layer
from resim.scenario.openscenario import REAR_AXLE

BAG, MAPPING = "bag", "mapping.toml"
MAP_FRAME = "map"
LABELS = {
    "unknown": 0, "car": 1, "van": 1, "truck": 2, "bus": 3, "trailer": 4, "motorcycle": 5, "bicycle": 6,
    "pedestrian": 7,
}  # fmt: skip
"""Autoware's classes; a van is a car there."""
_PERCEPTION = "autoware_perception_msgs/msg"
_CUBE, _TEXT, _DELETE_ALL = 1, 9, 3


class _Sent(NamedTuple):
    """A message: its time [ns], topic, type, and what it says by field."""

    t: int
    topic: str
    kind: str
    fields: dict[str, Any]


def write(drive: PlayedDrive, folder: Path) -> dict[str, str]:
    """Write the bag and its mapping. Gives the file of each source: all are in the bag."""
    first, ros = first_second(drive), _types()
    every = [_judged(drive, first), *(_sent(layer, drive, first) for layer in drive.layers)]
    with Writer(folder / BAG, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        known: dict[str, Any] = {}
        for one in heapq.merge(*every, key=lambda sent: sent.t):
            if one.topic not in known:
                known[one.topic] = writer.add_connection(one.topic, one.kind, typestore=ros)
            message = _made(one.kind, one.fields)
            writer.write(known[one.topic], one.t, ros.serialize_cdr(message, one.kind))
    for file in (folder / BAG).glob("*.mcap"):
        add_checksums(file)
    (folder / MAPPING).write_text(mapping(drive), encoding="utf-8")
    return dict.fromkeys((layer.name for layer in drive.layers), BAG)


def _topic(source: str) -> str:
    """A source's name as names of ROS allow it: letters, digits and underscores."""
    return re.sub(r"\W", "_", source, flags=re.ASCII)


def mapping(drive: PlayedDrive) -> str:
    """Give the mapping of ground truth, or of the scenario of a JSCEN file, and sensor data."""
    parts = [
        f"# {drive.name}, written by resim: resim import table {BAG} --columns {MAPPING} --map "
        f"{drive.network.path.name} --out my_drive",
        f"ego = {json.dumps(drive.ego, ensure_ascii=False)}",
    ]
    for layer in drive.layers:
        if layer.name in ("GT", "JSCEN", "SD"):
            parts += _mapped(layer, drive, "sd" if layer.name == "SD" else "gt")
    if any(layer.name == "SD" for layer in drive.layers):
        parts.append(
            '[match]\nby = "id"                            # ids of the sensor data are those of true objects\n'
        )
    return "\n".join(parts) + "\n"


def _mapped(layer: Layer, drive: PlayedDrive, source: str) -> Iterator[str]:
    topic, lost = _topic(layer.name), derived(layer)
    if drive.ego in layer.tracks.ids:
        turns = "" if "yaw_rate" in lost else 'yaw_rate = "twist.twist.angular.z"\n'
        row = layer.tracks.index(drive.ego)
        length, width = (float(c[row]) for c in (layer.tracks.length, layer.tracks.width))
        yield f"""
[[{source}]]
topic = "/{topic}/ego"
reference = "rear axle"
rear_overhang = {(0.5 - REAR_AXLE) * length!r}
length = {{ value = {length!r} }}
width = {{ value = {width!r} }}
kind = {{ value = "{layer.tracks.kind[row]}" }}
id = {{ value = {json.dumps(drive.ego, ensure_ascii=False)} }}
t = {{ column = "header.stamp", unit = "ns" }}
x = "pose.pose.position.x"
y = "pose.pose.position.y"
heading = {{ quaternion = "pose.pose.orientation" }}
v = "twist.twist.linear.x"
{turns}"""
    pose = "kinematics.pose_with_covariance.pose"
    turns = "" if "yaw_rate" in lost else 'yaw_rate = "kinematics.twist_with_covariance.twist.angular.z"\n'
    names = ", ".join(f'"{label}" = "{kind}"' for kind, label in LABELS.items() if kind != "van")
    if (layer.tracks.ids != drive.ego).any():
        yield f"""
[[{source}]]
topic = "/{topic}/objects"
list = "objects"
id = "object_id.uuid"
t = {{ column = "header.stamp", unit = "ns" }}
x = "{pose}.position.x"
y = "{pose}.position.y"
heading = {{ quaternion = "{pose}.orientation" }}
v = "kinematics.twist_with_covariance.twist.linear.x"
{turns}length = "shape.dimensions.x"
width = "shape.dimensions.y"
kind = {{ column = "classification.label", names = {{ {names} }} }}
"""


def _judged(drive: PlayedDrive, first: int) -> Iterator[_Sent]:
    """The verdict on the drive, if it was judged."""
    if drive.judged is not None:
        text = json.dumps(to_json(drive.judged), ensure_ascii=False)
        yield _Sent(first_time(drive, first), "/verdicts", "std_msgs/msg/String", {"data": text})


def _sent(layer: Layer, drive: PlayedDrive, first: int) -> Iterator[_Sent]:
    """All messages of a source, by time."""
    topic, known = _topic(layer.name), numbers(drive)
    plans = [(nanoseconds(t, first), plan) for t, plan in layer.plans]
    if layer.assessed is not None and layer.assessed.verdict is not None and len(layer.tracks.t):
        told = {"verdict": layer.assessed.verdict, "criteria": to_json(layer.assessed.criteria)}
        begin = nanoseconds(float(layer.tracks.t[0]), first)
        yield _Sent(
            begin, f"/{topic}/verdicts", "std_msgs/msg/String", {"data": json.dumps(told, ensure_ascii=False)}
        )
    for t, everyone in states(layer, drive.network):
        now = nanoseconds(t, first)
        while plans and plans[0][0] <= now:
            yield _path(topic, *plans.pop(0), next((one.z for one in everyone if one.id == drive.ego), 0.0))
        own = [one for one in everyone if one.id == drive.ego]
        for one in own:
            yield _odometry(topic, now, one)
        others = [_object(one, known[one.id]) for one in everyone if one.id != drive.ego]
        kind = f"{_PERCEPTION}/TrackedObjects"
        yield _Sent(now, f"/{topic}/objects", kind, {"header": _header(now), "objects": others})
        yield _markers(topic, layer, now, everyone, known, drive.ego)


def _odometry(topic: str, now: int, one: ExportedState) -> _Sent:
    back = REAR_AXLE * one.length
    x, y = one.x - back * math.cos(one.heading), one.y - back * math.sin(one.heading)
    twist = {"linear": {"x": one.v}, "angular": {"z": one.yaw_rate}}
    fields = {
        "header": _header(now), "child_frame_id": f"{topic}/base_link",
        "pose": {"pose": _pose(x, y, one.z, one.heading)}, "twist": {"twist": twist},
    }  # fmt: skip
    return _Sent(now, f"/{topic}/ego", "nav_msgs/msg/Odometry", fields)


def _object(one: ExportedState, number: int) -> dict[str, Any]:
    """An object as Autoware tracks it; its id is the number of `numbers`."""
    return {
        "object_id": {"uuid": np.frombuffer(number.to_bytes(16, "big"), dtype=np.uint8)},
        "existence_probability": 1.0,
        "classification": [{"label": LABELS[one.kind], "probability": 1.0}],
        "kinematics": {
            "pose_with_covariance": {"pose": _pose(one.x, one.y, one.z + 0.5 * one.height, one.heading)},
            "twist_with_covariance": {"twist": {"linear": {"x": one.v}, "angular": {"z": one.yaw_rate}}},
            "acceleration_with_covariance": {"accel": {"linear": {"x": one.a}}},
            "orientation_availability": 2,
        },
        "shape": {"type": 0, "dimensions": {"x": one.length, "y": one.width, "z": one.height}},
    }  # fmt: skip


def _path(topic: str, now: int, plan: Any, z: float) -> _Sent:
    known = plan[np.isfinite(plan[:, :3]).all(axis=1)]
    poses = [{"header": _header(now), "pose": _pose(x, y, z, 0.0)} for x, y in known[:, 1:3].tolist()]
    return _Sent(now, f"/{topic}/plan", "nav_msgs/msg/Path", {"header": _header(now), "poses": poses})


def _markers(
    topic: str, layer: Layer, now: int, everyone: list[ExportedState], known: dict[str, int], ego: str
) -> _Sent:
    """Boxes and names for RViz; those of the time before are deleted first."""
    colors, header = layer_colors(layer.name), _header(now)
    markers: list[dict[str, Any]] = [{"header": header, "action": _DELETE_ALL}]
    for row, one in enumerate(everyone):
        own = one.id == ego
        r, g, b = (int((colors.ego if own else colors.other)[0][k : k + 2], 16) / 255.0 for k in (1, 3, 5))
        common = {"header": header, "ns": layer.name, "action": 0}
        markers.append(
            {
                **common, "id": 2 * row, "type": _CUBE, "color": {"r": r, "g": g, "b": b, "a": 0.7},
                "pose": _pose(one.x, one.y, one.z + 0.5 * one.height, one.heading),
                "scale": {"x": one.length, "y": one.width, "z": one.height},
            }
        )  # fmt: skip
        markers.append(
            {
                **common, "id": 2 * row + 1, "type": _TEXT, "color": {"r": r, "g": g, "b": b, "a": 1.0},
                "pose": _pose(one.x, one.y, one.z + one.height + 0.8, 0.0), "scale": {"z": 0.8},
                "text": f"EGO {layer.name}" if own else one.id,
            }
        )  # fmt: skip
    return _Sent(now, f"/{topic}/markers", "visualization_msgs/msg/MarkerArray", {"markers": markers})


def _header(now: int) -> dict[str, Any]:
    seconds, nanos = divmod(now, SECOND)
    return {"stamp": {"sec": seconds, "nanosec": nanos}, "frame_id": MAP_FRAME}


def _pose(x: float, y: float, z: float, heading: float) -> dict[str, Any]:
    turned = {"x": 0.0, "y": 0.0, "z": math.sin(0.5 * heading), "w": math.cos(0.5 * heading)}
    return {"position": {"x": x, "y": y, "z": z}, "orientation": turned}


@cache
def _types() -> Any:
    """The types of ROS 2 and Autoware."""
    made = get_typestore(Stores.ROS2_HUMBLE)
    text = (resources.files("resim.recordings.logs") / "autoware.msg").read_text("utf-8")
    types: dict[str, Any] = {}
    for part in text.split("=" * 80 + "\n")[1:]:
        head, _, body = part.partition("\n")
        types |= get_types_from_msg(body, head.removeprefix("MSG: "))
    made.register(types)
    return made


def _made(kind: str, fields: dict[str, Any]) -> Any:
    """A message of a type; what is not given is 0, empty or false."""
    told = {name: _field(of, fields.get(name)) for name, of in _types().fielddefs[kind][1]}
    return _types().types[kind](**told)


def _field(of: Any, value: Any) -> Any:
    """A field as rosbags takes it."""
    kind, inner = of
    if kind.name == "BASE":
        name = inner[0]
        empty: Any = "" if name == "string" else False if name == "bool" else 0.0 if "float" in name else 0
        return empty if value is None else value
    if kind.name == "NAME":
        return _made(inner, value or {})
    (of_kind, base), count = inner
    if of_kind.name == "NAME":
        return [_made(base, one) for one in value or ()]
    if base[0] == "string":
        return list(value or ())
    return np.zeros(count, dtype=base[0]) if value is None else np.asarray(value, dtype=base[0])
