"""OpenDRIVE 1.4 to 1.8: reads a map and answers where a place on a lane is, and on which lane a place is."""

from resim.road.opendrive.lending import lend_network
from resim.road.opendrive.model import (
    LANE_TYPES,
    VEHICLE_LANES,
    Connection,
    Controller,
    Cubic,
    Geometry,
    Header,
    Height,
    Junction,
    Lane,
    LaneSection,
    Link,
    Road,
    RoadMark,
    RoadType,
    Signal,
    SignalKind,
    SpeedSign,
    Unread,
)  # fmt: skip
from resim.road.opendrive.network import DrivingLanes, LanePlaces, RoadNetwork, RoadPositions, load
from resim.road.opendrive.shapes import LaneShape

__all__ = [
    "LANE_TYPES", "VEHICLE_LANES", "Connection", "Controller", "Cubic", "DrivingLanes", "Geometry", "Header", "Height",
    "Junction", "Lane", "LanePlaces", "LaneSection", "LaneShape", "Link", "Road", "RoadMark", "RoadNetwork",
    "RoadPositions", "RoadType", "Signal", "SignalKind", "SpeedSign", "Unread", "lend_network", "load",
]  # fmt: skip
