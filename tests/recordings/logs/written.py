"""A known drive as logs of messages: Autoware's object lists and EGO state, protobuf, JSON and signals."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

ORIGIN = 1_714_550_400_123_456_789
"""ns, when the drive begins."""
DELAY = 87_654_321
"""ns from a message's stamp to its recording."""
LABELS = {
    "unknown": 0,
    "car": 1,
    "truck": 2,
    "bus": 3,
    "trailer": 4,
    "motorcycle": 5,
    "bicycle": 6,
    "pedestrian": 7,
}
EGO_TOPIC, OBJECTS = "/localization/kinematic_state", "/perception/object_recognition/tracking/objects"
REAR_AXLE, OVERHANG = 1.4, 0.9
"""m, from the box's centre of the EGO (4.6 m long) back to its axle, and from there to the rear."""
TRACKED, PREDICTED, DETECTED = (
    f"autoware_perception_msgs/msg/{kind}Objects" for kind in ("Tracked", "Predicted", "Detected")
)


def store() -> Any:
    """The types of ROS and Autoware, as rosbags reads them."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    made = get_typestore(Stores.ROS2_HUMBLE)
    text = (resources.files("resim.recordings.logs") / "autoware.msg").read_text("utf-8")
    types: dict = {}
    for part in text.split("=" * 80 + "\n")[1:]:
        head, _, body = part.partition("\n")
        types |= get_types_from_msg(body, head.removeprefix("MSG: "))
    made.register(types)
    return made


def stamp_ns(t: float) -> int:
    return ORIGIN + round(t * 1e9)


class Ros:
    """Messages of ROS 2."""

    def __init__(self) -> None:
        self.store = store()
        self.types = self.store.types

    def make(self, name: str, **fields: object) -> Any:
        """A message; fields that are not given are 0, "" or empty."""
        own: dict[str, Any] = {}
        for field, told in self.store.fielddefs[name][1]:
            own[field] = fields[field] if field in fields else self._empty(told)
        return self.types[name](**own)

    def _empty(self, told: Any) -> Any:
        kind, inner = told
        if kind.name == "BASE":
            return {"string": "", "bool": False}.get(inner[0], 0.0 if inner[0].startswith("float") else 0)
        if kind.name == "NAME":
            return self.make(inner)
        (of, base), count = inner
        if of.name == "BASE":
            return np.zeros(count if kind.name == "ARRAY" else 0, dtype=np.dtype(base[0]))
        return [self._empty((of, base)) for _ in range(count)] if kind.name == "ARRAY" else []

    def time(self, ns: int) -> Any:
        return self.make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)

    def header(self, ns: int, frame: str = "map") -> Any:
        return self.make("std_msgs/msg/Header", stamp=self.time(ns), frame_id=frame)

    def pose(self, x: float, y: float, yaw: float, roll: float = 0.0) -> Any:
        half, lean = 0.5 * yaw, 0.5 * roll
        turn = {
            "x": np.cos(half) * np.sin(lean),
            "y": np.sin(half) * np.sin(lean),
            "z": np.sin(half) * np.cos(lean),
            "w": np.cos(half) * np.cos(lean),
        }
        place = self.make("geometry_msgs/msg/Point", x=x, y=y, z=0.7)
        orientation = self.make("geometry_msgs/msg/Quaternion", **turn)
        pose = self.make("geometry_msgs/msg/Pose", position=place, orientation=orientation)
        return self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose)

    def twist(self, v: float) -> Any:
        twist = self.make("geometry_msgs/msg/Twist", linear=self.make("geometry_msgs/msg/Vector3", x=v))
        return self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist)

    def odometry(self, row: Any, axle: float = REAR_AXLE) -> Any:
        pose = self.pose(row.x - axle * np.cos(row.heading), row.y - axle * np.sin(row.heading), row.heading)
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp_ns(row.t)),
            child_frame_id="base_link",
            pose=pose,
            twist=self.twist(row.v),
        )

    def objects(self, kind: str, t: float, rows: Any) -> Any:
        """Autoware's list of tracked, predicted or detected objects."""
        package, _, name = kind.rpartition("/")
        own = [self._object(package, name.removesuffix("Objects"), row) for row in rows]
        return self.make(kind, header=self.header(stamp_ns(t)), objects=own)

    def _object(self, package: str, name: str, row: Any) -> Any:
        first = "initial_" if name == "Predicted" else ""
        fields = {
            f"{first}pose_with_covariance": self.pose(row.x, row.y, row.heading),
            f"{first}twist_with_covariance": self.twist(row.v),
        }
        if name == "Predicted":
            path = [self.pose(row.x + k, row.y, 0.0).pose for k in range(7)]
            fields["predicted_paths"] = [self.make(f"{package}/PredictedPath", path=path, confidence=0.5)] * 2
        kinds = [(LABELS["unknown"], 0.1), (LABELS[row.kind], 0.7), (LABELS["bus"], 0.2)]
        told: dict[str, Any] = (
            {}
            if name == "Detected"
            else {"object_id": self.make("unique_identifier_msgs/msg/UUID", uuid=uuid(row.id))}
        )
        size = self.make("geometry_msgs/msg/Vector3", x=row.length, y=row.width, z=1.5)
        return self.make(
            f"{package}/{name}Object", **told,
            existence_probability=0.75,
            classification=[self.make(f"{package}/ObjectClassification", label=a, probability=b) for a, b in kinds],
            kinematics=self.make(f"{package}/{name}ObjectKinematics", **fields),
            shape=self.make(f"{package}/Shape", dimensions=size),
        )  # fmt: skip

    def bytes_of(self, message: Any, *, little_endian: bool = True) -> bytes:
        return bytes(self.store.serialize_cdr(message, message.__msgtype__, little_endian=little_endian))

    def definition(self, kind: str) -> str:
        text, _ = self.store.generate_msgdef(kind, ros_version=2)
        return text


def uuid(name: str) -> np.ndarray:
    return np.array([int(name) if name.isdigit() else 255, *range(15)], dtype=np.uint8)


Sent = tuple[str, str, int, Any]
"""Topic, type, log time [ns] and message."""


def sent(
    ros: Ros, truth: pd.DataFrame, kind: str = TRACKED, topic: str = OBJECTS, axle: float = REAR_AXLE
) -> Iterator[Sent]:
    """What Autoware sends of a drive."""
    for t, rows in truth.groupby("t"):
        now = stamp_ns(float(t))
        every = list(rows.itertuples(index=False))
        own = next(row for row in every if row.id == "ego")
        yield EGO_TOPIC, "nav_msgs/msg/Odometry", now + 1_000_000, ros.odometry(own, axle)
        yield topic, kind, now + DELAY, ros.objects(kind, float(t), [row for row in every if row.id != "ego"])


def detections(ros: Ros, truth: pd.DataFrame, kind: str, axle: float = REAR_AXLE) -> Iterator[Sent]:
    """What Autoware detects, as seen from the EGO's rear axle."""
    for t, rows in truth.groupby("t"):
        every = list(rows.itertuples(index=False))
        own = next(row for row in every if row.id == "ego")
        turn = np.exp(-1j * own.heading)
        seen = []
        for row in every:
            place = (row.x - own.x + 1j * (row.y - own.y)) * turn + axle
            seen.append(row._replace(x=place.real, y=place.imag, heading=row.heading - own.heading))
        seen = [row for row in seen if row.id != "ego"]
        message = ros.objects(kind, float(t), seen)
        yield "/perception/object_recognition/detection/objects", kind, stamp_ns(float(t)) + DELAY, message


def sent_with_tf(ros: Ros, truth: pd.DataFrame, polygon: str) -> Iterator[Sent]:
    """The same with the EGO as transforms, among others, and one object whose shape is a polygon."""
    for topic, kind, time, message in sent(ros, truth):
        if topic != EGO_TOPIC:
            for one in message.objects:
                one.shape.type = 2 if one.object_id.uuid[0] == int(polygon) else 0
                one.shape.dimensions.x *= one.shape.type == 0
            yield topic, kind, time, message
            continue
        pose = message.pose.pose
        place = ros.make("geometry_msgs/msg/Vector3", x=pose.position.x, y=pose.position.y)
        moved = ros.make("geometry_msgs/msg/Transform", translation=place, rotation=pose.orientation)
        still = ros.make("geometry_msgs/msg/Transform", rotation=ros.pose(0.0, 0.0, 0.0).pose.orientation)
        transforms = [
            ros.make(
                "geometry_msgs/msg/TransformStamped",
                header=message.header,
                child_frame_id=child,
                transform=transform,
            )
            for child, transform in (("lidar", still), ("base_link", moved))
        ]
        yield "/tf", "tf2_msgs/msg/TFMessage", time, ros.make("tf2_msgs/msg/TFMessage", transforms=transforms)


def to_mcap(
    ros: Ros,
    messages: Iterator[Sent],
    path: Path,
    *,
    defined: bool = True,
    little_endian: bool = True,
    **options: object,
) -> Path:
    """An MCAP file as rosbag2 writes it."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4096, **options)  # type: ignore[arg-type]
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for n, (topic, kind, time, message) in enumerate(messages):
            if topic not in channels:
                text = ros.definition(kind).encode() if defined else b""
                schema = writer.register_schema(kind, "ros2msg" if defined else "", text)
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            body = ros.bytes_of(message, little_endian=little_endian)
            writer.add_message(channels[topic], time, body, time, n)
        writer.finish()
    return path


def to_bag(
    ros: Ros, messages: Iterator[Sent], folder: Path, *, version: int = 8, compressed: bool = False
) -> Path:
    """A rosbag2 folder with SQLite."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Writer

    writer = Writer(folder, version=version)
    if compressed:
        writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, time, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=ros.store)
            writer.write(connections[topic], time, ros.bytes_of(message))
    return folder


def autoware_mapping(kind: str = TRACKED, topic: str = OBJECTS, more: str = "") -> str:
    """A mapping of what `sent` gives."""
    first = "initial_" if "Predicted" in kind else ""
    ids = "" if "Detected" in kind else 'id = "object_id.uuid"'
    return f"""
ego = "ego"

[[gt]]
topic = "{EGO_TOPIC}"
reference = "rear axle"
rear_overhang = {OVERHANG}
id = {{ value = "ego" }}
t = {{ column = "header.stamp", unit = "ns" }}
x = "pose.pose.position.x"
y = "pose.pose.position.y"
heading = {{ quaternion = "pose.pose.orientation" }}
v = "twist.twist.linear.x"
length = {{ value = 4.6 }}
width = {{ value = 1.8 }}
kind = {{ value = "car" }}

[{"[gt]" if ids else "sd"}]
topic = "{topic}"
list = "objects"
{ids}
t = {{ column = "header.stamp", unit = "ns" }}
x = "kinematics.{first}pose_with_covariance.pose.position.x"
y = "kinematics.{first}pose_with_covariance.pose.position.y"
heading = {{ quaternion = "kinematics.{first}pose_with_covariance.pose.orientation" }}
v = "kinematics.{first}twist_with_covariance.twist.linear.x"
length = "shape.dimensions.x"
width = "shape.dimensions.y"
kind = {{ column = "classification.label", names = {{ "1" = "car", "2" = "truck" }} }}
{more}
"""


def schema_of(kind: str, fields: dict[str, list[tuple[str, str]]]) -> tuple[bytes, Callable[[], Any]]:
    """A FileDescriptorSet of protobuf messages by their fields (name, type), and what makes the message `kind`."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message_factory import GetMessageClass

    files = FileDescriptorSet()
    file = files.file.add(name="drive.proto", package="drive", syntax="proto3")
    for name, own in fields.items():
        message = file.message_type.add(name=name)
        for number, (field, told) in enumerate(own, start=1):
            many = told.endswith("[]")
            scalar = getattr(FieldDescriptorProto, f"TYPE_{told.removesuffix('[]').upper()}", None)
            made = message.field.add(name=field, number=number, label=3 if many else 1)
            made.type = scalar or FieldDescriptorProto.TYPE_MESSAGE
            if scalar is None:
                made.type_name = f".drive.{told.removesuffix('[]')}"
    pool = DescriptorPool()
    pool.Add(file)
    return files.SerializeToString(), GetMessageClass(pool.FindMessageTypeByName(f"drive.{kind}"))


SCENE: dict[str, list[tuple[str, str]]] = {
    "Stamp": [("seconds", "int64"), ("nanos", "int32")],
    "Place": [("x", "double"), ("y", "double")],
    "Box": [
        ("name", "string"),
        ("place", "Place"),
        ("yaw", "double"),
        ("speed", "double"),
        ("size", "double[]"),
    ],
    "Scene": [("stamp", "Stamp"), ("boxes", "Box[]")],
}
SCENE_MAPPING = """
ego = "ego"
[gt]
topic = "scene"
list = "boxes"
id = "name"
t = { column = "stamp", unit = "ns" }
x = "place.x"
y = "place.y"
heading = "yaw"
v = "speed"
length = "size.0"
width = "size.1"
"""


def scenes(truth: pd.DataFrame) -> Iterator[tuple[int, dict[str, Any]]]:
    """Log times [ns] and messages of a drive, as JSON has them."""
    for t, rows in truth.groupby("t"):
        ns = stamp_ns(float(t))
        boxes = [
            {
                "name": r.id,
                "place": {"x": r.x, "y": r.y},
                "yaw": r.heading,
                "speed": r.v,
                "size": [r.length, r.width],
            }
            for r in rows.itertuples(index=False)
        ]
        yield ns, {"stamp": {"seconds": ns // 10**9, "nanos": ns % 10**9}, "boxes": boxes}


def to_scene_mcap(truth: pd.DataFrame, path: Path, encoding: str, **options: object) -> Path:
    """An MCAP file with scenes, as "json" or "protobuf"."""
    from google.protobuf.json_format import ParseDict
    from mcap.writer import Writer

    schema, make = schema_of("Scene", SCENE)
    with path.open("wb") as file:
        writer = Writer(file, **options)  # type: ignore[arg-type]
        writer.start()
        of = writer.register_schema("drive.Scene", "protobuf", schema) if encoding == "protobuf" else 0
        channel = writer.register_channel("scene", encoding, of)
        for n, (time, told) in enumerate(scenes(truth)):
            body = (
                json.dumps(told).encode()
                if encoding == "json"
                else ParseDict(told, make()).SerializeToString()
            )
            writer.add_message(channel, time, body, time, n)
        writer.finish()
    return path


def _array(values: np.ndarray, name: str) -> np.ndarray:
    """Values of a channel; several each as asammdf wants them."""
    if values.ndim == 1:
        return values
    return np.ascontiguousarray(values).view([(name, values.dtype, values.shape[1:])]).ravel()


def _text_of(values: np.ndarray) -> dict[str, str]:
    return {"encoding": "utf-8"} if values.dtype.kind == "S" else {}


def to_mdf(
    groups: dict[str, dict[str, np.ndarray]],
    path: Path,
    start_ns: int = ORIGIN,
    invalid: np.ndarray | None = None,
) -> Path:
    """An MDF4 file: by the groups' names their channels, of which `time` [s] is the master.

    invalid: samples that the file says are not valid.
    """
    from asammdf import MDF, Signal

    with MDF(version="4.10") as made:
        made.header.abs_time = start_ns
        for name, channels in groups.items():
            times = channels["time"]
            signals = [
                Signal(_array(v, c), times, name=c, invalidation_bits=invalid, **_text_of(v))
                for c, v in channels.items()
                if c != "time"
            ]
            made.append(signals, acq_name=name)
        made.save(path, overwrite=True)
    return path
