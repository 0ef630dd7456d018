"""Recordings that were simulated, each read once: who drove it, how it ended, and the slots around its EGO."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from resim.mining.extraction import window_of
from resim.mining.features import features
from resim.mining.slots import map_folder, slot_frame, slot_traces
from resim.recordings import Recording, read_recording
from resim.recordings.content import refuse_changed, tracks_hash
from resim.resimulation import AssessmentOptions, assess_recording
from resim.road.opendrive import load
from resim.space.sources import UNKNOWN_BUILD


@dataclass(frozen=True, eq=False)
class SimulatedRecording:
    """What a space asks of a recording that was simulated.

    Attributes:
        folder: Where it is.
        key: Hash of its GT, EGO and map: copies under other names are one drive.
        drive: Key of the drive that it was cut out of, its own if it is a whole one.
        window: When it begins and ends in that drive [s].
        build: Hash of the build that drove it, UNKNOWN_BUILD for one without a hash, "" for a person or where nobody
            says.
        collided: Whether its EGO collides in the measured drive; None where somebody may have been hit unseen.
        broke_off: Whether the drive ended before its time.
        slots: Table of the slots of the whole recording around its EGO, named by its key.
        place: What its bucket follows from.
    """

    folder: Path
    key: str
    drive: str
    window: tuple[float, float]
    build: str
    collided: bool | None
    broke_off: bool
    slots: pd.DataFrame
    place: Mapping[str, object]

    def is_accident(self, build: str) -> bool:
        """Say whether a build drove it, and collides, or breaks off, or nobody says that it does not.

        Args:
            build: Hash of the build.

        Returns:
            Whether it counts as an accident of that build.
        """
        own = bool(build) and self.build in (build, UNKNOWN_BUILD)
        return own and (self.broke_off or self.collided is not False)


def draws(recordings: Mapping[str, SimulatedRecording]) -> dict[str, str]:
    """Give what several recordings are one draw of: windows of one drive that overlap tell of the same traffic.

    Args:
        recordings: By key.

    Returns:
        The key of the first of them in time.
    """
    order = sorted(recordings, key=lambda key: (recordings[key].drive, recordings[key].window, key))
    found, first, end = dict[str, str](), "", 0.0
    for key in order:
        one = recordings[key]
        if not (first and recordings[first].drive == one.drive and one.window[0] < end):
            first, end = key, one.window[1]
        found[key], end = first, max(end, one.window[1])
    return found


class RecordingReader:
    """Reads recordings; what several folders simulated is read once."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str], SimulatedRecording] = {}

    def read(self, folder: Path, content: str) -> SimulatedRecording:
        """Give what a space asks of a recording.

        Args:
            folder: Where it is.
            content: Hash of what it held when it was simulated.

        Returns:
            Who drove it, how it ended, and its slots.

        Raises:
            InputError: It cannot be read, or was changed.
        """
        key = os.path.realpath(folder), content
        if key not in self._known:
            refuse_changed(folder, content)
            self._known[key] = _simulated(folder, read_recording(folder), tracks_hash(folder))
        return self._known[key]


def _simulated(folder: Path, recording: Recording, key: str) -> SimulatedRecording:
    found = features(recording.gt, load(recording.map))
    row = recording.gt.index(recording.ego)
    first, last = (int(found.samples.first[row + k]) - k for k in (0, 1))
    window = window_of(found, row, (first, last), [])
    road, along, lanes, vehicles = window.bucket
    place = {
        "map": map_folder(recording.map), "road": road, "along_s": along, "lanes": lanes, "vehicles": vehicles,
    }  # fmt: skip
    told = recording.provenance
    begin = float(told.get("original_start_s", 0.0)) if "mined_from_tracks" in told else 0.0
    return SimulatedRecording(
        folder, key, told.get("mined_from_tracks", key), (begin, begin + float(np.ptp(recording.gt.t))),
        recording.build_hash or (UNKNOWN_BUILD if recording.build else ""), _measured_collision(recording),
        bool(recording.provenance.get("ended")), slot_frame([key], slot_traces(found, [window])), place,
    )  # fmt: skip


def _measured_collision(recording: Recording) -> bool | None:
    """Whether the EGO collides in the measured drive; None where somebody may have been hit unseen."""
    found = assess_recording(recording, AssessmentOptions(only=("collision",))).blocks["GT"]
    return True if found.contacts else False if found.clear else None
