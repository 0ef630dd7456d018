"""A drive as one MCAP file: sources as messages of OSI, scenes of Foxglove, and JSON, each on a topic of its own.

Source: ASAM OSI 3.8, "OSI trace file formats" (multi-channel traces); omega-prime's specification (map and truth).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import google.protobuf
from lxml import etree
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_sensordata_pb2 import SensorData
from osi3.osi_trafficupdate_pb2 import TrafficUpdate

from resim.core.osi import DERIVED, MAP, MAP_FIELDS, MAP_SCHEMA, SENSED, TRUTH
from resim.core.protobuf import TEXT, file_set, message_type
from resim.exports import osi
from resim.exports.mcap_file import Topic, scene_topics, write_topics
from resim.exports.states import TimedMessage, derived, first_second, first_time, topic_of
from resim.function.osmp import VERSION
from resim.report.player import PlayedDrive
from resim.report.player.drive import Layer

FILE = "drive.mcap"
MAP_MESSAGE = message_type(MAP_SCHEMA, dict.fromkeys(MAP_FIELDS, TEXT))


def write(drive: PlayedDrive, folder: Path) -> dict[str, str]:
    """Write all of a drive into one file; the same drive gives the same bytes. Gives the file of each source."""
    first = first_second(drive)
    topics = [*_osi_topics(drive, first), *scene_topics(drive, first)]
    version, protobuf = osi_version(), google.protobuf.__version__
    trace = {
        "version": version, "min_osi_version": version, "max_osi_version": version,
        "min_protobuf_version": protobuf, "max_protobuf_version": protobuf,
        "description": drive.name, "authors": "resim", "data_sources": drive.name,
    }  # fmt: skip
    with (folder / FILE).open("wb") as stream:
        write_topics(topics, stream, {"net.asam.osi.trace": trace})
    return dict.fromkeys((layer.name for layer in drive.layers), FILE)


def osi_version() -> str:
    """Give the version of OSI that messages are of."""
    return f"{VERSION.version_major}.{VERSION.version_minor}.{VERSION.version_patch}"


def _osi_topics(drive: PlayedDrive, first: int) -> Iterator[Topic]:
    """The map, measured truth, sensor data, and what was simulated or perceived."""
    begin, road = first_time(drive, first), drive.network.path
    told = MAP_MESSAGE(map_reference=road.name, open_drive_xml_content=_xml(road))
    yield _osi_topic(MAP, MAP_MESSAGE, (), [TimedMessage(begin, told.SerializeToString(deterministic=True))])
    for layer in drive.layers:
        name, kind, make = osi_form(layer)
        yield _osi_topic(name, kind, derived(layer), make(layer, drive, first))


def osi_form(layer: Layer) -> tuple[str, Any, Callable[..., Iterator[TimedMessage]]]:
    """Give topic, type of message and its maker of a source."""
    source = layer.name
    if layer.is_sensed:
        return SENSED if source == "SD" else topic_of(source), SensorData, osi.sensor_data
    if source in ("GT", "JSCEN"):
        return TRUTH, GroundTruth, osi.ground_truths
    return topic_of(source), TrafficUpdate, osi.traffic_updates


def _osi_topic(name: str, kind: Any, lacks: tuple[str, ...], messages: Iterable[TimedMessage]) -> Topic:
    told = {
        "net.asam.osi.trace.channel.osi_version": osi_version(),
        "net.asam.osi.trace.channel.protobuf_version": google.protobuf.__version__,
    }
    if lacks:
        told[DERIVED] = ", ".join(lacks)
    full = kind.DESCRIPTOR.full_name
    return Topic(name, full, file_set(kind.DESCRIPTOR.file), told, messages)


def _xml(road: Path) -> str:
    """The text of a map, whatever its encoding; a declaration that names another than UTF-8 is left out."""
    raw = road.read_bytes()
    tree = etree.fromstring(raw).getroottree()
    if (tree.docinfo.encoding or "UTF-8").upper() in ("UTF-8", "ASCII", "US-ASCII"):
        return raw.decode("utf-8-sig")
    return str(etree.tostring(tree, encoding="unicode"))
