"""Recordings: the recording folder and one reader per foreign format."""

from resim.ingest.commonroad import read_commonroad
from resim.ingest.folder import read_recording, read_tables, write_recording, write_tables
from resim.ingest.highd import Alignment, read_highd
from resim.ingest.recording import Recording
from resim.ingest.source import Tables, recording_of

__all__ = [
    "Alignment",
    "Recording",
    "Tables",
    "read_commonroad",
    "read_highd",
    "read_recording",
    "read_tables",
    "recording_of",
    "write_recording",
    "write_tables",
]
