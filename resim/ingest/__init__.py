"""Recordings: the recording folder and one reader per foreign format."""

from resim.ingest.commonroad import read_commonroad
from resim.ingest.folder import read_recording, write_recording
from resim.ingest.highd import Alignment, read_highd
from resim.ingest.recording import Recording

__all__ = [
    "Alignment",
    "Recording",
    "read_commonroad",
    "read_highd",
    "read_recording",
    "write_recording",
]
