"""Recordings: the recording folder and one reader per foreign format.

What is exported is loaded at its first use: the settings of a recording are read before tables and maps can be.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from resim.recordings.folder import read_recording as read_recording
    from resim.recordings.folder import read_tables as read_tables
    from resim.recordings.folder import write_recording as write_recording
    from resim.recordings.folder import write_tables as write_tables
    from resim.recordings.formats.commonroad import read_commonroad as read_commonroad
    from resim.recordings.formats.highd import Alignment as Alignment
    from resim.recordings.formats.highd import read_highd as read_highd
    from resim.recordings.recording import Recording as Recording
    from resim.recordings.source import RecordingTables as RecordingTables
    from resim.recordings.source import recording_of as recording_of

_WHERE = {
    "Alignment": "formats.highd",
    "Recording": "recording",
    "RecordingTables": "source",
    "read_commonroad": "formats.commonroad",
    "read_highd": "formats.highd",
    "read_recording": "folder",
    "read_tables": "folder",
    "recording_of": "source",
    "write_recording": "folder",
    "write_tables": "folder",
}
"""What is exported, and the module below that has it."""

__all__ = list(_WHERE)


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'resim.recordings' has no attribute {name!r}")
    return getattr(importlib.import_module(f"resim.recordings.{_WHERE[name]}"), name)
