"""The traces that kernels are trained on: those of recordings, cut at the labels of `resim mine`."""

from __future__ import annotations

import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.recordings import read_tables, recording_of
from resim.recordings.content import content_hash
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.course import beyond_noise, position_noise
from resim.scenario.fit import fit_trace
from resim.variations.features import POINTS, feature_vector
from resim.variations.kernels import MANEUVERS
from resim.variations.lane_motion import motion_of

LONGEST = 15.0
"""s; longer stretches of a lane are cut into equal parts, so that 50 points still tell of them."""
AROUND = 1.0
"""s before and after a maneuver that its trace is fitted to as well, so that its ends are not ends of a spline."""
SHORTEST = 1.0
"""s; what lasts less is no trace."""
KEPT, CHANGED = 3.0, 15.0
"""m that somebody may move across the lane that he keeps to, or otherwise: beyond it the lane was not followed."""
EVERY = 4
"""One of so many vehicles is held out."""
MOST = 4000
"""Traces of a maneuver at most: more take long, and tell little more of 20 components."""


@dataclass(frozen=True, eq=False)
class RecordingTraces:
    """The traces of one recording.

    Attributes:
        recording: Its name.
        hash: Of its content.
        source: What its provenance says of where it comes from.
        made: Whether resim made it, so that nobody drove.
        label: (N,) maneuver of each trace.
        object: (N,) whose it is.
        features: (N, 3 points).
        left_out: How many maneuvers are left out, by reason.
    """

    recording: str
    hash: str
    source: str
    made: bool
    label: list[str]
    object: list[str]
    features: Floats
    left_out: Mapping[str, int]

    @property
    def held_out(self) -> np.ndarray:
        """Which traces (N,) are of vehicles that are held out."""
        return np.array([is_held_out(self.recording, one) for one in self.object], dtype=bool)


@dataclass(frozen=True)
class CuttingTask:
    """What `traces_of` needs: a recording's folder and name, and its maneuvers (rows of `maneuvers.parquet`).

    Attributes:
        folder: Of the recording.
        name: By which the study knows it.
        maneuvers: Label, object, start and end [s] of each.
        longest: s.
    """

    folder: Path
    name: str
    maneuvers: tuple[tuple[str, str, float, float], ...]
    longest: float = LONGEST


def is_held_out(recording: str, vehicle: str) -> bool:
    """Say whether a vehicle's traces are held out: all of them, or none; the same ones in every training."""
    return zlib.crc32(f"{recording}/{vehicle}".encode()) % EVERY == 0


def wanted_maneuvers(table: pd.DataFrame, recording: str) -> tuple[tuple[str, str, float, float], ...]:
    """Give label, object, start, end [s] of a recording's maneuvers that kernels are trained for."""
    own = table[(table["recording"] == recording) & table["label"].isin(MANEUVERS)]
    columns = (own["label"].astype(str), own["object"].astype(str), own["start"], own["end"])
    return tuple(zip(*(column.tolist() for column in columns), strict=True))


def chosen_maneuvers(
    found: Mapping[str, tuple[tuple[str, str, float, float], ...]], longest: float, most: int
) -> dict[str, tuple[tuple[str, str, float, float], ...]]:
    """Give, by recording, label, object, start and end [s] of traces: all parts of maneuvers, or `most` of a label.

    Which ones does not depend on their order: those with the least checksum.
    """
    parts: dict[str, list[tuple[int, str, tuple[str, str, float, float]]]] = defaultdict(list)
    for recording, maneuvers in found.items():
        for label, name, start, end in maneuvers:
            for first, last in equal_parts(start, end, longest):
                key = zlib.crc32(f"{recording}/{name}/{label}/{first:.3f}".encode())
                parts[label].append((key, recording, (label, name, first, last)))
    taken: dict[str, list[tuple[str, str, float, float]]] = {recording: [] for recording in found}
    for of_label in parts.values():
        for _, recording, one in sorted(of_label)[:most]:
            taken[recording].append(one)
    return {recording: tuple(sorted(own)) for recording, own in taken.items()}


def equal_parts(start: float, end: float, longest: float) -> Iterator[tuple[float, float]]:
    """Give a stretch [s] in as few equal parts as are not longer than `longest` [s]."""
    count = max(int(np.ceil((end - start) / longest - 1e-9)), 1)
    ends = np.linspace(start, end, count + 1).tolist()
    yield from pairwise(ends)


def traces_of(task: CuttingTask) -> RecordingTraces:
    """Give the traces of a recording. Raises InputError where it cannot be read any more."""
    recording = recording_of(read_tables(task.folder), lenient=True)  # it was checked when it was mined
    network, left_out = load(recording.map), Counter[str]()
    labels, objects, rows = [], [], []
    for label, name, start, end in task.maneuvers:
        for first, last in equal_parts(start, end, task.longest):
            try:
                if name == recording.ego and recording.build:
                    raise ResimError("a build drove it")
                features = _features(recording.gt, name, (first, last), label, network)
            except ResimError as e:
                left_out[str(e)] += 1
                continue
            labels.append(label)
            objects.append(name)
            rows.append(features)
    provenance = recording.provenance
    source = provenance.get("source", "")
    told = f"{source} ({provenance['data']})" if "data" in provenance else source
    return RecordingTraces(
        task.name, content_hash(task.folder), told, _is_made(provenance), labels, objects,
        np.array(rows).reshape(-1, 3 * POINTS), dict(left_out),
    )  # fmt: skip


def _is_made(provenance: Mapping[str, str]) -> bool:
    """Whether a recording's provenance says that a program drove."""
    source = provenance.get("source", "")
    return source.startswith(("virtual", "resim "))


def _features(
    tracks: Tracks, name: str, span: tuple[float, float], label: str, network: RoadNetwork
) -> Floats:
    """The features of one maneuver. Raises ResimError with the reason why it has none."""
    n, (start, end) = tracks.index(name), span
    if end - start < SHORTEST:
        raise ResimError(f"shorter than {SHORTEST:g} s")
    own = tracks.valid[n] & (tracks.t >= start - AROUND - 1e-6) & (tracks.t <= end + AROUND + 1e-6)
    t = tracks.t[own]
    if len(t) < 8 or t[0] > start + 1e-6 or t[-1] < end - 1e-6 or np.diff(t).max() > 0.5:
        raise ResimError("has gaps")
    x, y = tracks.x[n, own], tracks.y[n, own]
    fit = fit_trace(t, x, y, tracks.heading[n, own], tracks.v[n, own])
    if fit.distance.max() > 3.0 * beyond_noise(position_noise(t, x + 1j * y)):
        raise ResimError("the fit does not follow it")
    z = None if tracks.z is None else tracks.z[n, own][:1]
    motion = motion_of(fit.trace, network, None if z is None or not np.isfinite(z).all() else z)
    found = feature_vector(motion, start, end)
    across = np.ptp(found[2 * POINTS :])
    if across > (KEPT if label in ("follow_lane", "strong_braking") else CHANGED):
        raise ResimError("leaves the lane that is followed")
    return found


def pooled(
    found: Sequence[RecordingTraces],
) -> dict[str, tuple[Floats, Floats]]:
    """Give by maneuver the features (N, F) to train on, and those (M, F) held out; equal traces count once."""
    train, held = defaultdict[str, list[Floats]](list), defaultdict[str, list[Floats]](list)
    seen = set[bytes]()
    for one in found:
        for label, row, out in zip(one.label, one.features, one.held_out.tolist(), strict=True):
            key = label.encode() + np.round(row, 6).tobytes()
            if key in seen:
                continue
            seen.add(key)
            (held if out else train)[label].append(row)
    empty = np.zeros((0, 3 * POINTS))
    return {
        label: tuple(np.array(part[label]) if part[label] else empty for part in (train, held))  # type: ignore[misc]
        for label in MANEUVERS
        if train[label] or held[label]
    }
