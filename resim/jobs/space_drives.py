"""Which simulated recordings are scenarios of a space, and which are of one drive."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from resim.jobs.space_members import Simulated
from resim.jobs.space_recordings import SimulatedRecording
from resim.mining.slots import slot_frame
from resim.recordings.content import tracks_hash
from resim.space.copies import equal_scenarios
from resim.space.draws import tracks_of
from resim.space.members import DrivenTraces
from resim.space.model import Space, bucket_names
from resim.space.repeated_drives import same_traffic
from resim.space.traces import SlotTraces, from_frame, joined


def driven_traces(space: Space, given: Iterable[Simulated]) -> DrivenTraces:
    """Give the slots of all recordings that were simulated.

    Args:
        space: The space that they are put into.
        given: What was simulated.

    Returns:
        Slots by recording, their buckets, and which scenarios of the space they are.
    """
    drives = {key: drive for one in given for key, drive in one.recordings.items()}
    keys, scenarios = sorted(drives), _scenarios(space, drives)
    names = bucket_names(pd.DataFrame([drives[key].place for key in keys]), space.settings) if keys else []
    frames = [drives[key].slots for key in keys] or [slot_frame([], [])]
    traces = from_frame(pd.concat(frames, ignore_index=True))
    drive = {key: one.drive for key, one in drives.items()}
    _find_copies(space, traces, scenarios, drive)
    _find_repeated(space, traces, [str(drives[str(key)].place["map"]) for key in traces.names], drive)
    return DrivenTraces(traces, dict(zip(keys, names, strict=True)), scenarios, drive)


def _find_copies(space: Space, traces: SlotTraces, scenario: dict[str, str], drive: dict[str, str]) -> None:
    """Enter in `scenario` and `drive`, both by key, which recordings see the same as a scenario or another recording.

    They are the same drive in another file, whatever its bytes are.
    """
    count, names = len(space.traces), [*space.traces.names.tolist(), *traces.names.tolist()]
    for pair in equal_scenarios(joined([space.traces, traces]), count).tolist():
        one, two = sorted(pair)
        key = names[two]
        if one < count:
            scenario[key] = scenario[key] or names[one]
        else:
            _join(drive, drive[key], drive[names[one]])


def _find_repeated(space: Space, traces: SlotTraces, place: Sequence[str], drive: dict[str, str]) -> None:
    """Enter in `drive`, by key, which recordings are the drive of a scenario, or of another recording, nearly.

    place (N,): map of each recording.
    """
    rows = space.rows
    names = (rows["source"].astype(str) + "/" + rows["recording"].astype(str)).tolist()
    own = [told or name for told, name in zip(tracks_of(space), names, strict=True)]
    maps, every = [*rows["map"].astype(str), *place], [*own, *(drive[str(key)] for key in traces.names)]
    for pair in same_traffic(joined([space.traces, traces]), every, maps, len(own)).tolist():
        one, two = (own[k] if k < len(own) else drive[str(traces.names[k - len(own)])] for k in pair)
        _join(drive, two, one)


def _join(drive: dict[str, str], old: str, new: str) -> None:
    """Take two drives, by key, for one."""
    drive.update({name: new for name, told in drive.items() if told == old})


def _scenarios(space: Space, drives: Mapping[str, SimulatedRecording]) -> dict[str, str]:
    """Which scenario of the space each recording is, by key, "" for none: by its folder, or as a copy of one."""
    own = {
        os.path.realpath(folder): str(name)
        for folder, name in zip(space.rows["folder"], space.rows["scenario"], strict=True) if folder
    }  # fmt: skip
    found = {key: own.get(os.path.realpath(drive.folder), "") for key, drive in drives.items()}
    if not all(found.values()):
        there = {tracks_hash(Path(folder)): name for folder, name in own.items() if Path(folder).is_dir()}
        found |= {key: there.get(key, "") for key, name in found.items() if not name}
    return found
