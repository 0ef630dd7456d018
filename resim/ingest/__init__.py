"""Recordings: the recording folder and one reader per foreign format."""

from resim.ingest.folder import read_recording, write_recording
from resim.ingest.recording import Recording

__all__ = ["Recording", "read_recording", "write_recording"]
