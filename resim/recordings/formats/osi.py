"""Traces of OSI: messages GroundTruth or SensorView, one after the other in a .osi file, or in an MCAP file.

Source: ASAM OSI 3.8, "OSI trace file formats".
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.files import open_file
from resim.core.geometry import wrap_angle
from resim.core.tracks import Tracks
from resim.recordings.formats.registry import FORMATS, RecordingFormat
from resim.recordings.present import existing_map
from resim.recordings.recording import Recording, sample_rate
from resim.recordings.window import cut_window

LONGEST = 1 << 28
"""Bytes of a message; one that claims more is none."""
MESSAGES = ("GroundTruth", "SensorView")
_MCAP = b"\x89MCAP0\r\n"
_ENDINGS = (".osi", ".mcap")
_VEHICLES = {
    2: "car", 3: "car", 4: "car", 5: "car", 6: "van", 7: "truck", 8: "trailer", 9: "trailer", 10: "motorcycle",
    11: "bicycle", 12: "bus", 16: "truck",
}  # fmt: skip
"""Kinds of VehicleClassification.Type; a tram, train, wheelchair or scooter is "unknown"."""
_VEHICLE, _PEDESTRIAN = 2, 3
_EXPORT = "Write the trace with its tool again."


def read_osi(
    trace: Path, *, map: Path, ego: str | None = None, start: float | None = None, end: float | None = None
) -> Recording:
    """Give what happened around the moving object `ego` as ground truth.

    ego: its id; without it the host vehicle. start, end [s] count from the first message; without them the window is
    the EGO's own. Stationary objects are left out. The map is in the trace's frame. Raises InputError.
    """
    if importlib.util.find_spec("osi3") is None:
        raise InputError(
            trace, "traces of OSI need osi-python", "In resim's own folder: pip install '.[osi]'"
        )
    rows, host, first, message = _rows(trace)
    ego = ego or host
    if ego is None:
        known = ", ".join(dict.fromkeys(row["id"] for row in rows[:200]))
        raise InputError(
            trace, f"names no host vehicle; its moving objects are {known}", "Name one by --ego."
        )
    frame, origin = cut_window(pd.DataFrame(rows), trace, ego=ego, start=start, end=end)
    measured = frame.dropna(axis="columns", how="all").sort_values("t", kind="stable")
    gt = Tracks.from_frame(measured)
    provenance = {
        "source": trace.name, "format": f"OSI {message}",
        "first_message": f"{first // 10**9}.{first % 10**9:09d} s", "original_start": f"{origin:.9g} s",
    }  # fmt: skip
    return Recording(
        name=f"{trace.name.partition('.')[0]}_{ego}", map=existing_map(map, map), ego=ego, gt=gt,
        gt_rate=sample_rate(trace, gt), provenance=provenance,
    )  # fmt: skip


FORMATS.add(
    RecordingFormat(
        name="osi",
        source="a trace of OSI",
        file="trace",
        file_help="GroundTruth or SensorView messages, as .osi or .mcap.",
        reader=read_osi,
        works_out=("ego",),
    )
)


def _rows(trace: Path) -> tuple[list[dict[str, Any]], str | None, int, str]:
    """A row for each moving object of each message, times from the first; the host, the first time [ns], its name."""
    rows: list[dict[str, Any]] = []
    host: str | None = None
    first, last, name = None, -1, ""
    for number, (truth, view, kind) in enumerate(_messages(trace)):
        where = f"message {number + 1}"
        now = truth.timestamp.seconds * 10**9 + truth.timestamp.nanos
        first = now if first is None else first
        if number and now <= last:
            problem = (
                f"{where} is of {_seconds(now - first)}, not after {_seconds(last - first)} of the one before"
            )
            raise InputError(trace, problem, "Its times have to increase.")
        last, name = now, kind
        told = (
            truth.host_vehicle_id
            if truth.HasField("host_vehicle_id")
            else getattr(view, "host_vehicle_id", None)
        )
        if told is not None and told.HasField("value"):
            host = host or str(told.value)
        seen = set[int]()
        for one in truth.moving_object:
            if one.id.value in seen:
                raise InputError(trace, f"{where} has the moving object {one.id.value} twice", _EXPORT)
            seen.add(one.id.value)
            rows.append({"t": (now - first) * 1e-9, **_row(trace, where, one)})
    if first is None or not rows:
        raise InputError(
            trace, "has no moving object in any message", "Give GroundTruth or SensorView messages."
        )
    return rows, host, first, name


def _row(trace: Path, where: str, one: Any) -> dict[str, Any]:
    """What is measured of a moving object; acceleration, yaw rate and height are NaN where they are not said."""
    base, place = one.base, f"{where}, moving object {one.id.value}"
    x, y = (_number(trace, f"{place}: base.position.{axis}", base.position, axis) for axis in "xy")
    heading = _number(trace, f"{place}: base.orientation.yaw", base.orientation, "yaw", 0.0)
    length, width = (
        _number(trace, f"{place}: base.dimension.{name}", base.dimension, name)
        for name in ("length", "width")
    )
    c, s = math.cos(heading), math.sin(heading)
    vx, vy = (_number(trace, f"{place}: base.velocity.{axis}", base.velocity, axis, 0.0) for axis in "xy")
    if not base.HasField("velocity"):
        raise InputError(trace, f"{place}: base.velocity is missing, expected the speed over ground", _EXPORT)
    a = base.acceleration.x * c + base.acceleration.y * s if base.HasField("acceleration") else math.nan
    kind = "unknown"
    if one.type == _PEDESTRIAN:
        kind = "pedestrian"
    elif one.type == _VEHICLE:
        kind = _VEHICLES.get(one.vehicle_classification.type, "unknown")
    tall = base.dimension.height if base.dimension.HasField("height") else math.nan
    return {
        "id": str(one.id.value), "kind": kind, "x": x, "y": y, "heading": float(wrap_angle(np.array(heading))),
        "v": vx * c + vy * s, "a": a,
        "yaw_rate": base.orientation_rate.yaw if base.orientation_rate.HasField("yaw") else math.nan,
        "length": length, "width": width,
        "z": base.position.z - 0.5 * tall if base.position.HasField("z") else math.nan,
    }  # fmt: skip


def _number(trace: Path, where: str, of: Any, field: str, default: float | None = None) -> float:
    value = float(getattr(of, field)) if of.HasField(field) else default
    if value is None or not math.isfinite(value):
        found = "missing" if value is None else repr(value)
        raise InputError(trace, f"{where} is {found}, expected a finite number", _EXPORT)
    return value


def _messages(trace: Path) -> Iterator[tuple[Any, Any, str]]:
    """GroundTruth, SensorView that it is of or None, and the message's name, of each message in their order."""
    from google.protobuf.message import DecodeError
    from osi3.osi_groundtruth_pb2 import GroundTruth
    from osi3.osi_sensorview_pb2 import SensorView

    name = ""
    for number, (body, schema) in enumerate(_bodies(trace)):
        try:
            if not name:
                name = schema or _name(body, GroundTruth, SensorView)
            told = (SensorView if name == "SensorView" else GroundTruth).FromString(body)
        except DecodeError as e:
            raise InputError(trace, f"message {number + 1} is no {name or 'message'} of OSI", _EXPORT) from e
        yield (told.global_ground_truth, told, name) if name == "SensorView" else (told, None, name)


def _name(body: bytes, truth: Any, view: Any) -> str:
    """What a message without a name is: a SensorView if it has a ground truth with something in it."""
    from google.protobuf.message import DecodeError

    try:
        return (
            "SensorView" if view.FromString(body).global_ground_truth.HasField("timestamp") else "GroundTruth"
        )
    except DecodeError:
        return "GroundTruth" if truth.FromString(body) is not None else ""


def _bodies(trace: Path) -> Iterator[tuple[bytes, str]]:
    """The bytes of each message, and its name where the file says it."""
    with open_file(trace, "Check the path") as file:
        begin = file.read(len(_MCAP))
        file.seek(0)
        if begin == _MCAP:
            yield from _of_mcap(trace, file)
            return
        if trace.suffix.lower() not in _ENDINGS:
            raise InputError(trace, "is neither an .osi nor an MCAP file", "Give a trace of OSI.")
        number = 0
        while head := file.read(4):
            number += 1
            size = int.from_bytes(head, "little")
            body = file.read(size) if len(head) == 4 and size <= LONGEST else b""
            if len(body) != size or not size:
                problem = f"message {number} claims {size} bytes, of which {len(body)} are there"
                raise InputError(trace, problem, _EXPORT)
            yield body, ""


def _of_mcap(trace: Path, file: Any) -> Iterator[tuple[bytes, str]]:
    """The messages of the one topic with ground truth, by time."""
    from mcap.reader import make_reader

    try:
        reader = make_reader(file)
        summary = reader.get_summary()
        if summary is None:
            raise InputError(trace, "has no index: it was not written to its end", _EXPORT)
        if (large := max((one.uncompressed_size for one in summary.chunk_indexes), default=0)) > LONGEST:
            raise InputError(trace, f"has a chunk of {large} bytes, expected up to {LONGEST}", _EXPORT)
        names = {
            channel.topic: summary.schemas[channel.schema_id].name.removeprefix("osi3.")
            for channel in summary.channels.values()
            if channel.schema_id in summary.schemas and channel.message_encoding == "protobuf"
        }
        topics = sorted(topic for topic, name in names.items() if name in MESSAGES)
        if len(topics) != 1:
            there = ", ".join(f"{topic} ({name})" for topic, name in sorted(names.items())) or "none"
            problem = (
                f"has {len(topics)} topics of {' or '.join(MESSAGES)}, expected one; its topics are: {there}"
            )
            raise InputError(trace, problem, "Write a trace with one of them.")
        for _, _, message in reader.iter_messages(topics=topics):
            yield message.data, names[topics[0]]
    except InputError:
        raise
    except Exception as e:  # of damaged files mcap raises what its parts do: struct, lz4, zstandard
        raise InputError(trace, f"is no whole MCAP file ({type(e).__name__}: {e})", _EXPORT) from e


def _seconds(nanos: int) -> str:
    return f"{nanos * 1e-9:.3f} s"
