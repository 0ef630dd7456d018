"""Sources of a drive as messages of OSI: GroundTruth, TrafficUpdate of a simulated one, SensorData of a measured one.

Source: ASAM OSI 3.8. Ids are those of the recording where all of them are numbers; else they are counted, and stand as
`source_reference` (or, in what a sensor detects, beside its `tracking_id`) in the messages.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_sensordata_pb2 import DetectedEntityHeader, SensorData
from osi3.osi_trafficupdate_pb2 import TrafficUpdate

from resim.core.osi import RECORDING, REFERENCE
from resim.exports.states import (
    SECOND,
    ExportedState,
    TimedMessage,
    first_second,
    nanoseconds,
    numbers,
    states,
    topic_of,
)
from resim.function.osmp import VEHICLES, VERSION
from resim.report.player import PlayedDrive
from resim.report.player.drive import Layer
from resim.road.opendrive import RoadNetwork
from resim.scenario.openscenario import REAR_AXLE

_WHEEL = 0.3
"""m from the road to the rear axle."""
_CIVIL = MovingObject.VehicleClassification.ROLE_CIVIL


def write(drive: PlayedDrive, folder: Path) -> dict[str, str]:
    """Write each source as a file of messages, each after its length. Gives the file of each source.

    What is simulated is a GroundTruth of a world of its own; sensor data and perceived objects are SensorData.
    """
    first, files = first_second(drive), {}
    for layer in drive.layers:
        files[layer.name] = f"{topic_of(layer.name)}.osi"
        with (folder / files[layer.name]).open("wb") as stream:
            for message in (sensor_data if layer.is_sensed else ground_truths)(layer, drive, first):
                stream.write(len(message.body).to_bytes(4, "little") + message.body)
    return files


def ground_truths(layer: Layer, drive: PlayedDrive, first: int) -> Iterator[TimedMessage]:
    """Give a source as GroundTruth: everybody in the map's frame, the EGO as host vehicle.

    first: second that times count from.
    """
    known = numbers(drive)
    for t, everyone in states(layer, drive.network):
        told = GroundTruth(version=VERSION, map_reference=drive.network.path.name)
        told.host_vehicle_id.value = known[drive.ego]
        _set_frame(told, drive.network)
        now = _set_time(told, t, first)
        _add(told.moving_object, everyone, known, drive.ego)
        yield TimedMessage(now, _bytes(told))


def traffic_updates(layer: Layer, drive: PlayedDrive, first: int) -> Iterator[TimedMessage]:
    """Give a simulated source as TrafficUpdate: everybody in the map's frame."""
    known = numbers(drive)
    for t, everyone in states(layer, drive.network):
        told = TrafficUpdate(version=VERSION)
        now = _set_time(told, t, first)
        _add(told.update, everyone, known, drive.ego)
        yield TimedMessage(now, _bytes(told))


def sensor_data(layer: Layer, drive: PlayedDrive, first: int) -> Iterator[TimedMessage]:
    """Give a measured source as SensorData: objects as seen from the middle of the EGO's rear axle.

    `host_vehicle_location` says where the EGO takes itself to be, in the map's frame, where the source says that: in SD
    by its own rows; what was perceived in a simulated drive is seen from where the EGO is there. Else objects are as
    seen from where the first source has the EGO; a list at a time at which none has it is left out.
    """
    of_sd = layer.name == "SD"
    known, host = numbers(drive), _Host(drive, "" if of_sd else layer.name.removeprefix("perceived "))
    true = set(drive.layers[0].tracks.ids.tolist())
    for t, everyone in states(layer, drive.network):
        said = next((one for one in everyone if one.id == drive.ego), None)
        own = said or host.at(t)
        if own is None:
            continue
        told = SensorData(version=VERSION)
        now = _set_time(told, t, first)
        told.last_measurement_time.CopyFrom(told.timestamp)
        told.sensor_id.value = 1
        told.mounting_position.position.SetInParent()
        told.mounting_position.orientation.SetInParent()
        if said or not of_sd:
            _set_base(told.host_vehicle_location, own)
        told.moving_object_header.data_qualifier = DetectedEntityHeader.DATA_QUALIFIER_AVAILABLE
        for one in everyone:
            if one.id != drive.ego:
                _detect(told.moving_object.add(), one, own, host.back, known[one.id], one.id in true)
        yield TimedMessage(now, _bytes(told))


class _Host:
    """Where the EGO is by a source of a drive, or else the first that has it, straight between its samples."""

    def __init__(self, drive: PlayedDrive, source: str) -> None:
        having = [one for one in drive.layers if drive.ego in one.tracks.ids]
        layer = next((one for one in having if one.name == source), next(iter(having), None))
        self.back = 0.0
        if having:  # one vehicle, whatever its sensors take its length for
            true = having[0].tracks
            self.back = REAR_AXLE * float(true.length[true.index(drive.ego)])
        self._at: list[tuple[float, ExportedState]] = []
        if layer is not None:
            self._at = [(t, one) for t, every in states(layer, drive.network, drive.ego) for one in every]

        steps = np.diff([t for t, _ in self._at])
        self._step = float(np.median(steps)) if len(steps) else 0.0

    def at(self, t: float) -> ExportedState | None:
        """Give its state at a time [s]; None before its first and after its last sample, and where both around are more
        than two usual steps apart."""
        after = bisect_left(self._at, t, key=lambda sample: sample[0])
        if after == len(self._at) or (after == 0 and self._at[0][0] > t):
            return None
        end, two = self._at[after]
        begin, one = self._at[max(after - 1, 0)]
        if t < end and end - begin > 2.0 * self._step + 1e-6:
            return None
        share = (t - begin) / (end - begin) if end > begin else 1.0
        turned = math.remainder(two.heading - one.heading, math.tau)
        between = {
            name: getattr(one, name) + share * (getattr(two, name) - getattr(one, name))
            for name in ("x", "y", "z", "v", "a", "yaw_rate")
        }
        heading = math.remainder(one.heading + share * turned, math.tau)
        return ExportedState(
            one.id, one.kind, one.length, one.width, one.height, between["x"], between["y"], between["z"], heading,
            between["v"], between["a"], between["yaw_rate"],
        )  # fmt: skip


def _set_frame(told: GroundTruth, network: RoadNetwork) -> None:
    if network.geo_reference is None:
        return
    told.proj_string = network.geo_reference
    x, y, turned = network.header.offset
    told.proj_frame_offset.position.x, told.proj_frame_offset.position.y = x, y
    told.proj_frame_offset.position.z = 0.0
    told.proj_frame_offset.yaw = turned


def _set_time(told: Any, t: float, first: int) -> int:
    now = nanoseconds(t, first)
    told.timestamp.seconds, told.timestamp.nanos = divmod(now, SECOND)
    return now


def _add(to: Any, everyone: Iterable[ExportedState], known: dict[str, int], ego: str) -> None:
    """Add a moving object for each."""
    for one in everyone:
        told = to.add()
        told.id.value = known[one.id]
        _set_base(told.base, one)
        _set_kind(told, one.kind)
        if one.kind in VEHICLES:
            told.vehicle_classification.role = _CIVIL
        if one.id == ego:
            rear = told.vehicle_attributes.bbcenter_to_rear
            rear.x, rear.y, rear.z = -REAR_AXLE * one.length, 0.0, _WHEEL - 0.5 * one.height
        source = told.source_reference.add(reference=REFERENCE, type=RECORDING)
        source.identifier.append(one.id)


def _set_base(base: Any, one: ExportedState) -> None:
    """Box, place and motion in the map's frame."""
    c, s = math.cos(one.heading), math.sin(one.heading)
    across = one.v * one.yaw_rate
    base.dimension.length, base.dimension.width, base.dimension.height = one.length, one.width, one.height
    base.position.x, base.position.y, base.position.z = one.x, one.y, one.z + 0.5 * one.height
    base.orientation.roll, base.orientation.pitch, base.orientation.yaw = 0.0, 0.0, one.heading
    base.velocity.x, base.velocity.y, base.velocity.z = one.v * c, one.v * s, 0.0
    base.acceleration.x, base.acceleration.y = one.a * c - across * s, one.a * s + across * c
    base.acceleration.z = 0.0
    rate = base.orientation_rate
    rate.roll, rate.pitch, rate.yaw = 0.0, 0.0, one.yaw_rate


def _detect(told: Any, one: ExportedState, own: ExportedState, back: float, number: int, true: bool) -> None:
    """What a sensor in the middle of the EGO's rear axle, `back` [m] behind its middle, says of an object; velocities
    are relative to the EGO's. true: whether it is one of the first source's."""
    told.header.tracking_id.value = number
    if true:
        told.header.ground_truth_id.add().value = number
    told.header.measurement_state = told.header.MEASUREMENT_STATE_MEASURED
    base = told.base
    c, s = math.cos(own.heading), math.sin(own.heading)
    x, y = _turned(one.x - own.x, one.y - own.y, c, s)
    base.position.x, base.position.y = x + back, y
    base.position.z = one.z - own.z + 0.5 * one.height - _WHEEL
    base.dimension.length, base.dimension.width, base.dimension.height = one.length, one.width, one.height
    base.orientation.roll, base.orientation.pitch = 0.0, 0.0
    base.orientation.yaw = math.remainder(one.heading - own.heading, math.tau)
    vx = one.v * math.cos(one.heading) - own.v * c
    vy = one.v * math.sin(one.heading) - own.v * s
    base.velocity.x, base.velocity.y = _turned(vx, vy, c, s)
    base.velocity.z = 0.0
    _set_kind(told.candidate.add(probability=1.0), one.kind)


def _set_kind(told: Any, kind: str) -> None:
    """The type of a moving object, or of what a detected one may be, and which vehicle it is."""
    if kind in VEHICLES:
        told.type = MovingObject.TYPE_VEHICLE
        told.vehicle_classification.type = VEHICLES[kind]
    else:
        told.type = MovingObject.TYPE_PEDESTRIAN if kind == "pedestrian" else MovingObject.TYPE_OTHER


def _turned(x: float, y: float, c: float, s: float) -> tuple[float, float]:
    """A vector in a frame whose x has this cosine and sine."""
    return c * x + s * y, c * y - s * x


def _bytes(told: Any) -> bytes:
    return bytes(told.SerializeToString(deterministic=True))
