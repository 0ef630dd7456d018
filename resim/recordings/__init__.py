"""Recordings: the recording folder and one reader per foreign format."""

from resim.recordings.folder import read_recording, read_tables, write_recording, write_tables
from resim.recordings.formats.commonroad import read_commonroad
from resim.recordings.formats.highd import Alignment, read_highd
from resim.recordings.recording import Recording
from resim.recordings.source import RecordingTables, recording_of

__all__ = [
    "Alignment",
    "Recording",
    "RecordingTables",
    "read_commonroad",
    "read_highd",
    "read_recording",
    "read_tables",
    "recording_of",
    "write_recording",
    "write_tables",
]
