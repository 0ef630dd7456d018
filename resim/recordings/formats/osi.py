"""Traces of OSI: GroundTruth or SensorView are the ground truth, SensorData the sensor data.

Source: ASAM OSI 3.8. What a sensor detects is relative to its mounting position, which counts from the middle of the
host vehicle's rear axle, and to the host's velocity.
"""

from __future__ import annotations

import hashlib
import importlib.util
import math
import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.errors import InputError
from resim.core.files import cache_folder
from resim.core.geometry import Floats
from resim.core.osi import RECORDING, REFERENCE
from resim.core.schema import EXISTENCE, GT_ID, OPTIONAL_COLUMNS
from resim.recordings.formats.osi_files import REMEDY, held_map, is_mcap, sensed, worlds
from resim.recordings.formats.registry import FORMATS, FormatOption, RecordingFormat
from resim.recordings.present import existing_map
from resim.recordings.settings import Settings
from resim.recordings.source import RecordingTables
from resim.recordings.tables import MOST_TURNED
from resim.recordings.window import asked_window, beyond_ego, times_of

_VEHICLES = {
    2: "car", 3: "car", 4: "car", 5: "car", 6: "van", 7: "truck", 8: "trailer", 9: "trailer", 10: "motorcycle",
    11: "bicycle", 12: "bus", 16: "truck",
}  # fmt: skip
"""Kinds of VehicleClassification.Type; a tram, train, wheelchair or scooter is "unknown"."""
_VEHICLE, _PEDESTRIAN = 2, 3
_SECOND = 10**9


def read_osi(
    trace: Path, *, map: Path | None = None, ego: str | None = None, start: float | None = None,
    end: float | None = None, sd: Path | None = None,
) -> RecordingTables:  # fmt: skip
    """Give what happened around the moving object `ego` as ground truth, and what its sensors saw as sensor data.

    map: without it, that in the trace, in whose frame it is. ego: id; without it the host vehicle. start, end [s] count
    from the first message; without them nothing is cut. sd: trace with SensorData; without it that of the
    trace, if it is MCAP and has any. Stationary objects are left out. Raises InputError.
    """
    if importlib.util.find_spec("osi3") is None:
        raise InputError(
            trace, "traces of OSI need osi-python", "In resim's own folder: pip install '.[osi]'"
        )
    truth = _truth(trace)
    ego = ego or truth.host
    if ego is None:
        known = ", ".join(dict.fromkeys(row["id"] for row in truth.rows[:200]))
        raise InputError(
            trace, f"names no host vehicle; its moving objects are {known}", "Name one by --ego."
        )
    gt = pd.DataFrame(truth.rows)
    low, high = asked_window(gt, trace, ego=ego, start=start, end=end)
    gt = gt[gt["t"].between(low, high)]
    origin = float(gt["t"].min())
    beyond = beyond_ego(times_of(gt, trace, ego), gt)
    gt = gt.assign(t=np.round(gt["t"] - origin, 9))
    gt = gt.drop(columns=[c for c in OPTIONAL_COLUMNS if c in truth.derived or gt[c].isna().all()])
    told = {
        "source": trace.name, "format": f"OSI {truth.message}",
        "first_message": f"{truth.first // _SECOND}.{truth.first % _SECOND:09d} s",
        "original_start": f"{origin:.9g} s",
    }  # fmt: skip
    if beyond:
        told["without_ego"] = beyond
    seen = sensed(sd) if sd is not None else sensed(trace) if is_mcap(trace) else None
    frame, lost = (None, "") if seen is None else _detections(sd or trace, seen, truth, ego)
    if lost:
        told["sensor_data_left_out"] = lost
    if frame is not None:
        inside = frame["t"].between(low, high).to_numpy()
        frame = frame[inside].assign(t=np.round(frame["t"][inside] - origin, 9))
        told["sensor_data"] = f"{(sd or trace).name}: {frame['id'].nunique()} objects"
    return RecordingTables(
        settings=Settings(name=f"{trace.name.partition('.')[0]}_{ego}", map="map", ego=ego, provenance=told),
        map=_map(trace, map), gt=_by_time(gt), sd=None if frame is None else _by_time(frame), plan=None, folder=None,
        gt_file=trace, sd_file=sd or trace,
    )  # fmt: skip


FORMATS.add(
    RecordingFormat(
        name="osi",
        source="a trace of OSI",
        file="trace",
        file_help="GroundTruth or SensorView messages, as .osi or .mcap.",
        reader=read_osi,
        options=(
            FormatOption(
                "sd",
                Path,
                "Trace of SensorData, where it is not in the first.",
                "FILE",
                patterns=("*.osi", "*.mcap"),
            ),
        ),
        works_out=("ego", "map"),
        patterns=("*.osi", "*.mcap"),
    )
)


@dataclass
class _Truth:
    """What a trace says of everybody: rows, times from the first message; the host's id, if it is named; the first
    time [ns]; the message's name; ids by number; where the rear axle is before the middle of the host's box."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    host: str | None = None
    first: int = 0
    message: str = ""
    derived: tuple[str, ...] = ()
    names: dict[int, str] = field(default_factory=dict)
    rear: dict[str, float] = field(default_factory=dict)


def _truth(trace: Path) -> _Truth:
    messages, name, derived = worlds(trace)
    found, last, count = _Truth(message=name, derived=derived), -1, 0
    host: int | None = None
    for count, told in enumerate(messages, start=1):
        truth = told.global_ground_truth if name == "SensorView" else told
        now = truth.timestamp.seconds * _SECOND + truth.timestamp.nanos
        if count == 1:
            found.first = now
        elif now <= last:
            begin, end = ((one - found.first) / _SECOND for one in (now, last))
            problem = f"message {count} is of {begin:.3f} s, not after {end:.3f} s of the one before"
            raise InputError(trace, problem, "Its times have to increase.")
        last = now
        for one in (truth, told):
            if host is None and one.HasField("host_vehicle_id") and one.host_vehicle_id.HasField("value"):
                host = one.host_vehicle_id.value
        _take(trace, f"message {count}", (now - found.first) / _SECOND, truth.moving_object, found)
    if not found.rows:
        raise InputError(
            trace, "has no moving object in any message", "Give GroundTruth or SensorView messages."
        )
    found.host = None if host is None else found.names.get(host, str(host))
    return found


def _take(trace: Path, where: str, t: float, objects: Any, found: _Truth) -> None:
    """Add the rows of one message."""
    seen = set[str]()
    for one in objects:
        name = next(
            (str(s.identifier[0]) for s in one.source_reference
             if s.reference == REFERENCE and s.type == RECORDING and len(s.identifier) == 1),
            str(one.id.value),
        )  # fmt: skip
        if name in seen:
            raise InputError(trace, f"{where} has the moving object {name} twice", REMEDY)
        seen.add(name)
        found.names[one.id.value] = name
        if one.vehicle_attributes.HasField("bbcenter_to_rear"):
            found.rear.setdefault(name, float(one.vehicle_attributes.bbcenter_to_rear.x))
        found.rows.append({"t": t, "id": name, **_row(trace, f"{where}, moving object {name}", one)})


def _row(trace: Path, place: str, one: Any) -> dict[str, Any]:
    """What is measured of a moving object; speed, acceleration, yaw rate, height are NaN where they are not said."""
    base = one.base
    x, y, heading, length, width = _box(trace, place, base)
    c, s = math.cos(heading), math.sin(heading)
    vx, vy = _velocity(trace, place, base)
    a = base.acceleration.x * c + base.acceleration.y * s if base.HasField("acceleration") else math.nan
    tall = base.dimension.height if base.dimension.HasField("height") else math.nan
    return {
        "kind": _kind(one), "x": x, "y": y, "heading": _wrapped(heading), "v": vx * c + vy * s,
        "a": a, "yaw_rate": base.orientation_rate.yaw if base.orientation_rate.HasField("yaw") else math.nan,
        "length": length, "width": width,
        "z": base.position.z - 0.5 * tall if base.position.HasField("z") else math.nan,
    }  # fmt: skip


def _box(trace: Path, place: str, base: Any) -> tuple[float, float, float, float, float]:
    """x, y, heading, length, width; heading NaN where no orientation is said."""
    x, y = (_number(trace, f"{place}: base.position.{axis}", base.position, axis) for axis in "xy")
    heading = math.nan
    if base.HasField("orientation"):  # what is 0 may be left out within it
        heading = _number(trace, f"{place}: base.orientation.yaw", base.orientation, "yaw", 0.0)
        if abs(heading) > MOST_TURNED:
            problem = f"{place}: base.orientation.yaw is {heading:g}, expected radians up to {MOST_TURNED:g}"
            raise InputError(trace, problem, REMEDY)
    length, width = (
        _number(trace, f"{place}: base.dimension.{name}", base.dimension, name)
        for name in ("length", "width")
    )
    return x, y, heading, length, width


def _velocity(trace: Path, place: str, base: Any) -> tuple[float, float]:
    """vx, vy; NaN where it is not said."""
    if not base.HasField("velocity"):
        return math.nan, math.nan
    vx, vy = (_number(trace, f"{place}: base.velocity.{axis}", base.velocity, axis, 0.0) for axis in "xy")
    return vx, vy


def _kind(told: Any) -> str:
    """The kind of a moving object, or of what a detected one may be."""
    if told.type == _PEDESTRIAN:
        return "pedestrian"
    return _VEHICLES.get(told.vehicle_classification.type, "unknown") if told.type == _VEHICLE else "unknown"


def _number(trace: Path, where: str, of: Any, field: str, default: float | None = None) -> float:
    value = float(getattr(of, field)) if of.HasField(field) else default
    if value is None or not math.isfinite(value):
        found = "missing" if value is None else repr(value)
        raise InputError(trace, f"{where} is {found}, expected a finite number", REMEDY)
    return value


def _detections(
    trace: Path, messages: Iterator[Any], truth: _Truth, ego: str
) -> tuple[pd.DataFrame | None, str]:
    """Rows of sensor data: objects as detected, and the EGO where a message says where it takes itself to be; and what
    was left out, in words. Raises InputError where nothing is left."""
    host, rows = _HostPoses(truth, ego), list[dict[str, Any]]()
    true: dict[str, Counter[str]] = {}
    last, number, nowhere = -(2**63), 0, list[float]()
    for number, told in enumerate(messages, start=1):
        where, now = f"SensorData {number}", told.timestamp.seconds * _SECOND + told.timestamp.nanos
        if now <= last:
            raise InputError(trace, f"{where} is not after the one before", "Its times have to increase.")
        last, t = now, (now - truth.first) / _SECOND
        own = None
        if told.HasField("host_vehicle_location"):
            own = _own(trace, where, told.host_vehicle_location, host, ego)
            rows.append({"t": t, GT_ID: ego, **own})
        pose = host.at(t) if own is None else np.array([own[c] for c in ("x", "y", "heading", "v")])
        if pose is None:
            nowhere += [t] * len(told.moving_object)
            continue
        for one in told.moving_object:
            row = _detected(
                trace, where, one, _mounted(trace, where, pose, told.mounting_position, host.rear), truth
            )
            rows.append({"t": t, **row})
            true.setdefault(row["id"], Counter())[row[GT_ID]] += 1
    if not number:
        raise InputError(trace, "has no message of SensorData", "Give the trace of the sensor.")
    if nowhere and not rows:
        problem = (
            f"SensorData is of {min(nowhere):.9g} to {max(nowhere):.9g} s, in which the host vehicle is nowhere: it is "
            f"known from {host.t.min():.9g} to {host.t.max():.9g} s of the ground truth"
        )
        raise InputError(
            trace, problem, "Write both with one clock, or host_vehicle_location into the messages."
        )
    lost = f"{len(nowhere)} objects at times at which the host vehicle is nowhere" if nowhere else ""
    if not rows:
        return None, lost
    frame = pd.DataFrame(rows)
    named = zip(frame["id"], frame[GT_ID], strict=True)
    frame[GT_ID] = [true[i].most_common(1)[0][0] if i in true else g for i, g in named]
    return frame.drop(columns=EXISTENCE) if frame[EXISTENCE].isna().all() else frame, lost


class _HostPoses:
    """Where the EGO is by the ground truth: x, y, heading, v, straight between messages."""

    def __init__(self, truth: _Truth, ego: str) -> None:
        own = [row for row in truth.rows if row["id"] == ego]
        self.t = np.array([row["t"] for row in own])
        self.columns = np.array(
            [[row[c] for c in ("x", "y", "heading", "v")] for row in own], dtype=float
        ).reshape(-1, 4)
        self.columns[:, 2] = np.unwrap(self.columns[:, 2])
        self.step = float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0
        self.rear = truth.rear.get(ego, 0.0)
        self.box = {c: own[0][c] for c in ("kind", "length", "width")} if own else {}

    def at(self, t: float) -> Floats | None:
        """Give the pose at a time [s]; None before its first and after its last sample, and where both around are more
        than two usual steps apart."""
        if not len(self.t) or not self.t[0] - TICK <= t <= self.t[-1] + TICK:
            return None
        after = min(int(np.searchsorted(self.t, t - TICK)), len(self.t) - 1)
        if after and self.t[after] - t > TICK and self.t[after] - self.t[after - 1] > 2.0 * self.step + TICK:
            return None
        return np.array([np.interp(t, self.t, column) for column in self.columns.T])


def _own(trace: Path, where: str, base: Any, host: _HostPoses, ego: str) -> dict[str, Any]:
    """The EGO's row, where it takes itself to be; its kind is that of the ground truth, its box too if none is said."""
    place = f"{where}, host_vehicle_location"
    x, y = (_number(trace, f"{place}: position.{axis}", base.position, axis) for axis in "xy")
    heading = _number(trace, f"{place}: orientation.yaw", base.orientation, "yaw", 0.0)
    vx, vy = _velocity(trace, place, base)
    v = vx * math.cos(heading) + vy * math.sin(heading)
    box = {c: getattr(base.dimension, c) for c in ("length", "width") if base.dimension.HasField(c)}
    return {
        "id": ego, **host.box, **box, "x": x, "y": y, "heading": _wrapped(heading), "v": v,
        EXISTENCE: math.nan,
    }  # fmt: skip


def _mounted(
    trace: Path, where: str, pose: Floats, mounting: Any, rear: float
) -> tuple[float, float, float, complex]:
    """x, y, heading of a sensor in the map's frame, and the host's velocity.

    rear: how far [m] its rear axle is before the middle of its box.
    """
    x, y, heading, v = pose.tolist()
    told = (mounting.position.x, mounting.position.y, mounting.orientation.yaw)
    if not all(map(math.isfinite, told)):
        raise InputError(trace, f"{where}: mounting_position is not finite: {told}", REMEDY)
    along = complex(math.cos(heading), math.sin(heading))
    place = complex(x, y) + along * (rear + complex(mounting.position.x, mounting.position.y))
    return place.real, place.imag, heading + mounting.orientation.yaw, v * along


def _detected(
    trace: Path, where: str, one: Any, sensor: tuple[float, float, float, complex], truth: _Truth
) -> dict[str, Any]:
    """What a sensor says of an object, in the map's frame."""
    place = f"{where}, tracking_id {one.header.tracking_id.value}"
    x, y, heading, length, width = _box(trace, place, one.base)
    sx, sy, turned, moving = sensor
    along = complex(math.cos(turned), math.sin(turned))
    at = complex(sx, sy) + along * complex(x, y)
    heading = heading + turned
    velocity = moving + along * complex(*_velocity(trace, place, one.base))
    true = [truth.names[g.value] for g in one.header.ground_truth_id if g.value in truth.names]
    number = one.header.tracking_id.value
    likely = max(one.candidate, key=lambda c: c.probability, default=None)
    known = one.header.HasField("existence_probability")
    return {
        "id": truth.names[number] if true == [truth.names.get(number)] else _free(str(number), truth),
        GT_ID: true[0] if len(true) == 1 else "", "kind": "unknown" if likely is None else _kind(likely),
        "x": at.real, "y": at.imag, "heading": _wrapped(heading),
        "v": velocity.real * math.cos(heading) + velocity.imag * math.sin(heading), "length": length, "width": width,
        EXISTENCE: one.header.existence_probability if known else math.nan,
    }  # fmt: skip


def _wrapped(heading: float) -> float:
    return math.remainder(heading, math.tau) if math.isfinite(heading) else math.nan


def _free(name: str, truth: _Truth) -> str:
    """A name of something detected that is no true object's."""
    return f"detected {name}" if name in truth.names.values() else name


def _by_time(frame: pd.DataFrame) -> pd.DataFrame:
    """The rows by time, numbered as in a file with a heading."""
    return frame.sort_values("t", kind="stable").set_axis(pd.RangeIndex(2, len(frame) + 2))


def _map(trace: Path, given: Path | None) -> Path:
    """The map that is given, or else that in the trace, kept among resim's own files."""
    if given is not None:
        return existing_map(given, given)
    held = held_map(trace)
    if held is None:
        raise InputError(trace, "holds no map, and --map is missing", "Name its OpenDRIVE file by --map.")
    name, text = held
    raw = text.encode("utf-8")
    folder = cache_folder("maps") / hashlib.sha256(raw).hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    stem = re.sub(r"[^\w.-]", "_", Path(name).stem)[:80] or "map"
    file = folder / f"{stem}.xodr"
    if not file.is_file() or file.read_bytes() != raw:
        beside = folder / f".{os.getpid()}.new"
        beside.write_bytes(raw)
        beside.replace(file)
    return file
