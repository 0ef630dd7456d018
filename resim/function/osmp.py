"""What a unit of OSMP gets and gives, by osi3: what the function sees as a SensorView, its answer as a TrafficUpdate.

Source: ASAM OSI 3.8 and OSI Sensor Model Packaging 1.6, traffic participant models.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from osi3.osi_common_pb2 import Timestamp
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_lane_pb2 import Lane
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_sensorview_pb2 import SensorView
from osi3.osi_sensorviewconfiguration_pb2 import SensorViewConfiguration
from osi3.osi_trafficcommand_pb2 import TrafficCommand
from osi3.osi_trafficupdate_pb2 import TrafficUpdate
from osi3.osi_version_pb2 import InterfaceVersion, current_interface_version

HOST = 1
"""The EGO's id; objects are numbered from 2 in the order in which they are first seen, lanes and borders from 2^32."""
_FIRST_LANE = 1 << 32
VERSION = InterfaceVersion.DESCRIPTOR.file.GetOptions().Extensions[current_interface_version]
_CLASS = MovingObject.VehicleClassification
VEHICLES = {
    "car": _CLASS.TYPE_CAR, "van": _CLASS.TYPE_DELIVERY_VAN, "truck": _CLASS.TYPE_HEAVY_TRUCK,
    "bus": _CLASS.TYPE_BUS, "trailer": _CLASS.TYPE_TRAILER, "motorcycle": _CLASS.TYPE_MOTORBIKE,
    "bicycle": _CLASS.TYPE_BICYCLE,
}  # fmt: skip
"""What kinds are in OSI; an unknown one is none of them."""
_SHORTEST = 1e-3
"""m on which a heading that changes is no bend."""


class TrafficParticipant:
    """Speaks OSI to a unit, for one run.

    setup: as a function gets it before a run.
    """

    def __init__(self, setup: Any) -> None:
        self._setup = setup
        self._numbers: dict[str, int] = {}

    def static(self) -> bytes:
        """Give the lanes of the map and their borders, as a GroundTruth."""
        truth = GroundTruth(version=VERSION, map_reference=self._setup.road.file)
        truth.host_vehicle_id.value = HOST
        lanes = self._setup.road.lanes
        before: list[list[int]] = [[] for _ in lanes]
        for k, one in enumerate(lanes):
            for after in one.after:
                before[after].append(k)
        place = {(one.road, one.section, one.lane): k for k, one in enumerate(lanes)}
        for k, one in enumerate(lanes):
            lane = truth.lane.add()
            lane.id.value = _lane_id(k)
            told = lane.classification
            told.type = (
                Lane.Classification.TYPE_DRIVING
                if one.type == "driving"
                else Lane.Classification.TYPE_NONDRIVING
            )
            told.centerline_is_driving_direction = one.along
            _put_points(told.centerline, one.centre)
            _pair(told, one.after if one.along else before[k], before[k] if one.along else one.after)
            for step, field in ((1, told.left_adjacent_lane_id), (-1, told.right_adjacent_lane_id)):
                beside = one.lane + step or step  # lane 0 has no width
                if (there := place.get((one.road, one.section, beside))) is not None:
                    field.add().value = _lane_id(there)
            for side, border, field in (
                (1, one.left, told.left_lane_boundary_id), (2, one.right, told.right_lane_boundary_id)
            ):  # fmt: skip
                boundary = truth.lane_boundary.add()
                boundary.id.value = _lane_id(k) + side
                field.add().value = boundary.id.value
                for x, y in border.tolist():
                    position = boundary.boundary_line.add().position
                    position.x, position.y, position.z = x, y, 0.0
        return bytes(truth.SerializeToString(deterministic=True))

    def command(self) -> bytes:
        """Give where to go, as a TrafficCommand."""
        told = TrafficCommand(version=VERSION, timestamp=Timestamp(seconds=0, nanos=0))
        told.traffic_participant_id.value = HOST
        action = told.action.add().acquire_global_position_action
        action.action_header.action_id.value = 1
        action.position.x, action.position.y = self._setup.goal
        return bytes(told.SerializeToString(deterministic=True))

    def view(self, p: Any, time: float) -> bytes:
        """Give what the function sees as a SensorView, without lanes. time: s of the unit."""
        view = SensorView(version=VERSION, timestamp=_stamp(time))
        view.sensor_id.value = view.host_vehicle_id.value = HOST
        view.mounting_position.position.SetInParent()
        view.mounting_position.orientation.SetInParent()
        truth = view.global_ground_truth
        truth.version.CopyFrom(VERSION)
        truth.timestamp.CopyFrom(view.timestamp)
        truth.host_vehicle_id.value = HOST
        ego = p.ego
        told = truth.moving_object.add()
        _put_object(told, HOST, (ego.x, ego.y, ego.heading, ego.v), (self._setup.length, self._setup.width))
        told.type = MovingObject.TYPE_VEHICLE
        told.vehicle_classification.type = _CLASS.TYPE_CAR
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        across = ego.v * ego.yaw_rate
        told.base.acceleration.x, told.base.acceleration.y = ego.a * c - across * s, ego.a * s + across * c
        told.base.acceleration.z = 0.0
        told.base.orientation_rate.yaw = ego.yaw_rate
        columns = (p.x_ego, p.y_ego, p.heading_ego, p.v, p.z_ego, p.length, p.width)
        for name, kind, x, y, heading, v, z, *size in zip(  # noqa: B905
            p.ids, p.kind, *(column.tolist() for column in columns)
        ):
            told = truth.moving_object.add()
            place = (ego.x + x * c - y * s, ego.y + x * s + y * c, _wrapped(ego.heading + heading), v)
            _put_object(told, self._number(str(name)), place, size, 0.0 if math.isnan(z) else z)
            if kind == "pedestrian":
                told.type = MovingObject.TYPE_PEDESTRIAN
            elif kind in VEHICLES:
                told.type = MovingObject.TYPE_VEHICLE
                told.vehicle_classification.type = VEHICLES[kind]
            source = told.source_reference.add()
            source.type = "recording"
            source.identifier.append(str(name))
        return bytes(view.SerializeToString(deterministic=True))

    def answer(self, given: bytes, p: Any, time: float) -> tuple[float, float, Any]:
        """Give acceleration [m/s²], curvature [1/m] and plan (rows of t [s], x, y [m], v [m/s], or None).

        They are what brings the EGO from its state now to that which a TrafficUpdate gives for the end of the step; the
        plan is its future trajectory. given: the message. time: s of the unit now.
        """
        update = TrafficUpdate()
        update.ParseFromString(given)
        own = [one for one in update.update if one.id.value == HOST]
        if len(own) != 1:
            raise ValueError(f"{len(own)} updates of the host vehicle, whose id is {HOST}; expected one")
        plan = self._plan(own[0].future_trajectory, p, time)
        v, heading = self._end(own[0], plan, p.t + self._setup.cycle)
        acceleration = (v - p.ego.v) / self._setup.cycle
        driven = 0.5 * (p.ego.v + v) * self._setup.cycle
        turned = _wrapped(heading - p.ego.heading)
        return acceleration, turned / driven if abs(driven) > _SHORTEST else 0.0, plan

    def configuration(self, request: bytes) -> bytes:
        """Give the SensorViewConfiguration to a request: without raw data of sensors, which nobody has."""
        told = SensorViewConfiguration()
        told.ParseFromString(request)
        told.version.CopyFrom(VERSION)
        for kind in ("generic", "radar", "lidar", "camera", "ultrasonic"):
            told.ClearField(f"{kind}_sensor_view_configuration")
        return bytes(told.SerializeToString(deterministic=True))

    def _number(self, name: str) -> int:
        return self._numbers.setdefault(name, HOST + 1 + len(self._numbers))

    def _end(self, update: Any, plan: Any, t: float) -> tuple[float, float]:
        """Speed and heading of the EGO at time t, by its state or, where it has none, by its trajectory."""
        base = update.base
        if base.HasField("velocity") and base.HasField("orientation"):
            heading = base.orientation.yaw
            return base.velocity.x * math.cos(heading) + base.velocity.y * math.sin(heading), heading
        if plan is None:
            raise ValueError(
                "the update of the host vehicle has neither velocity and orientation nor a trajectory"
            )
        yaws = np.unwrap([one.orientation.yaw for one in update.future_trajectory])
        return float(np.interp(t, plan[:, 0], plan[:, 3])), float(np.interp(t, plan[:, 0], yaws))

    def _plan(self, trajectory: Any, p: Any, time: float) -> Any:
        """A trajectory as rows of t, x, y, v; None where there are not two points of it."""
        if len(trajectory) < 2:
            return None
        t = np.array([one.timestamp.seconds + 1e-9 * one.timestamp.nanos for one in trajectory]) - time + p.t
        x, y = (np.array([getattr(one.position, axis) for one in trajectory]) for axis in "xy")
        if (np.diff(t) <= 0.0).any():
            raise ValueError("the times of the future trajectory do not increase")
        return np.column_stack([t, x, y, np.hypot(np.gradient(x, t), np.gradient(y, t))])


def within_view(static: bytes) -> bytes:
    """Give the lanes as the part of a SensorView that, put before another, is merged with it."""
    return bytes(
        SensorView(global_ground_truth=GroundTruth.FromString(static)).SerializeToString(deterministic=True)
    )


def _stamp(time: float) -> Timestamp:
    nanos = round(time * 1e9)
    return Timestamp(seconds=nanos // 1_000_000_000, nanos=nanos % 1_000_000_000)


def _put_object(
    told: Any, number: int, place: tuple[float, ...], size: Iterable[float], z: float = 0.0
) -> None:
    told.id.value = number
    base, (x, y, heading, v) = told.base, place
    base.dimension.length, base.dimension.width = size
    base.position.x, base.position.y, base.position.z = x, y, z
    base.orientation.yaw = heading
    base.velocity.x, base.velocity.y, base.velocity.z = v * math.cos(heading), v * math.sin(heading), 0.0


def _put_points(field: Any, points: Any) -> None:
    for x, y in points.tolist():
        field.add(x=x, y=y, z=0.0)


def _pair(told: Any, after: Iterable[int], before: Iterable[int]) -> None:
    for k in after:
        told.lane_pairing.add().successor_lane_id.value = _lane_id(k)
    for k in before:
        told.lane_pairing.add().antecessor_lane_id.value = _lane_id(k)


def _lane_id(k: int) -> int:
    """The id of lane k; those of its left and right border follow."""
    return _FIRST_LANE + 3 * k


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)
