"""What a unit of OSMP gets and gives, by osi3: what the function sees as a SensorView, its answer as a TrafficUpdate.

Source: ASAM OSI 3.8 and OSI Sensor Model Packaging 1.6, traffic participant models.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Literal

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
_SLOWEST = 1e-3
"""m/s below which a velocity has no direction."""
_AT_ONCE = 1e-6
"""s between times that are the same one."""


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
        plan is its future trajectory. given: the message. time: s of the unit now. Raises ValueError, with the field's
        name, where state and trajectory together do not say how fast the EGO is and where it heads.
        """
        update = TrafficUpdate()
        update.ParseFromString(given)
        if update.HasField("timestamp"):
            stamp = update.timestamp.seconds + 1e-9 * update.timestamp.nanos
            if stamp < time - _AT_ONCE:
                raise ValueError(
                    f"timestamp is {stamp:.9g} s, older than this step, which begins at {time:.9g} s"
                )
        own = [one for one in update.update if one.id.value == HOST]
        if len(own) != 1:
            raise ValueError(f"{len(own)} updates of the host vehicle, whose id is {HOST}; expected one")
        points = own[0].future_trajectory
        path = _Path(points, p, time) if len(points) > 1 else None
        v, heading = self._end(own[0], path, p)
        acceleration = (v - p.ego.v) / self._setup.cycle
        driven = 0.5 * (p.ego.v + v) * self._setup.cycle
        turned = _wrapped(heading - p.ego.heading)
        plan = None if path is None else np.column_stack([path.t, path.x, path.y, path.v])
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

    def _end(self, update: Any, path: _Path | None, p: Any) -> tuple[float, float]:
        """Speed [m/s] and heading [rad] of the EGO at the end of the step.

        They are those of its state. What that lacks is taken from its trajectory, and a heading that neither has from
        the direction of its velocity.
        """
        base = update.base
        t = p.t + self._setup.cycle
        has_velocity = base.velocity.HasField("x") and base.velocity.HasField("y")
        heading = base.orientation.yaw if base.orientation.HasField("yaw") else None
        if has_velocity and heading is None and path is None:
            heading = _direction(base.velocity.x, base.velocity.y, p.ego.heading)
        if has_velocity and heading is not None:
            return base.velocity.x * math.cos(heading) + base.velocity.y * math.sin(heading), heading
        if path is None:
            lacks = "base.orientation.yaw" if has_velocity else "base.velocity.x and y"
            raise ValueError(f"the update of the host vehicle has neither {lacks} nor a future_trajectory")
        if not path.t[0] - _AT_ONCE <= t <= path.t[-1] + _AT_ONCE:
            lasts = f"from {path.t[0] - p.t:.9g} to {path.t[-1] - p.t:.9g} s after now"
            raise ValueError(
                f"future_trajectory lasts {lasts}, without the end of the step at {self._setup.cycle:g} s"
            )
        if heading is None:
            heading = float(np.interp(t, path.t, path.heading))
        if has_velocity:
            return base.velocity.x * math.cos(heading) + base.velocity.y * math.sin(heading), heading
        return float(np.interp(t, path.t, path.v)), heading


class _Path:
    """A future trajectory: t [s] of the scenario, x, y [m], heading [rad, unwrapped] and v [m/s, negative in reverse].

    Headings are those of the points; where one of them has none, the directions of the positions. Raises ValueError,
    with the field's name, for points without time or position, and where all are past.
    """

    def __init__(self, points: Any, p: Any, time: float) -> None:
        for k, one in enumerate(points):
            for field, names in (("timestamp", ("seconds",)), ("position", ("x", "y"))):
                for name in names:
                    if not getattr(one, field).HasField(name):
                        raise ValueError(f"future_trajectory[{k}].{field}.{name} is missing")
        self.t = np.array([one.timestamp.seconds + 1e-9 * one.timestamp.nanos for one in points]) - time + p.t
        if (np.diff(self.t) <= 0.0).any():
            raise ValueError("the times of the future trajectory do not increase")
        if self.t[-1] < p.t - _AT_ONCE:
            raise ValueError(
                f"future_trajectory ends {p.t - self.t[-1]:.9g} s before now, which is {time:.9g} s"
            )
        self.x, self.y = (np.array([getattr(one.position, axis) for one in points]) for axis in "xy")
        dx, dy = np.gradient(self.x, self.t), np.gradient(self.y, self.t)
        if all(one.orientation.HasField("yaw") for one in points):
            self.heading = np.unwrap([one.orientation.yaw for one in points])
        else:
            self.heading = _headings(self.x, self.y, self.t, p.ego.heading)
        backwards = dx * np.cos(self.heading) + dy * np.sin(self.heading) < 0.0
        self.v = np.where(backwards, -1.0, 1.0) * np.hypot(dx, dy)


def _headings(x: Any, y: Any, t: Any, now: float) -> Any:
    """Headings [rad, unwrapped] of who is at x, y [m] at times t [s], and had the heading `now` before."""
    order: Literal[1, 2] = 2 if len(t) > 2 else 1
    vx, vy = np.gradient(x, t, edge_order=order), np.gradient(y, t, edge_order=order)
    found = []
    for one in zip(vx.tolist(), vy.tolist()):  # noqa: B905
        now = _direction(*one, now)
        found.append(now)
    return np.unwrap(found)


def _direction(vx: float, vy: float, before: float) -> float:
    """Heading [rad] of who moves at vx, vy [m/s], and had the heading `before`.

    It drives backwards where that is nearer; who stands does not turn.
    """
    if math.hypot(vx, vy) < _SLOWEST:
        return before
    turned = _wrapped(math.atan2(vy, vx) - before)
    if abs(turned) > 0.5 * math.pi:
        turned = _wrapped(turned + math.pi)
    return before + turned


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
