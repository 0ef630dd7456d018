"""What resim's own traces of OSI hold besides OSI, for those who write and those who read them."""

from __future__ import annotations

TRUTH, MAP, SENSED = "ground_truth", "ground_truth_map", "sensor_data"
"""Topics of measured truth and of the map, by omega-prime's names, and of sensor data."""
DERIVED = "resim.derived"
"""Entry of a topic's metadata: which columns of tracks no source says, but the messages do."""
REFERENCE, RECORDING = "resim", "recording"
"""Reference and type of a `source_reference` that says an object's id in the recording."""
MAP_SCHEMA = "osi3.MapAsamOpenDrive"
MAP_FIELDS = ("map_reference", "open_drive_xml_content")
"""The message that holds a map, by omega-prime: its texts in their order."""
