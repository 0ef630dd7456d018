"""Scenarios cut out of recordings: whom an EGO has around it, and from when to when (Wagner 2021, 6.2.1.2 to 6.2.1.4).

Every object is the EGO once. Readings taken: a maneuver triggers if its vehicle holds a slot of the eight-vehicle model
at a sample of it; it is included wholly, even before and after the EGO's own life (Rule B); maneuvers that share a
sample are one window, those one step apart are two (Rule A); members are all who hold a slot at any sample of the
window; the EGO's own maneuvers trigger on request only. So what one EGO sees twice is said once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from resim.core.geometry import Bools
from resim.mining.features import Features
from resim.mining.maneuver import LabelledManeuver
from resim.mining.samples import VEHICLES, Ints
from resim.mining.settings import ExtractionSettings


class Bucket(NamedTuple):
    """Scenarios that can be compared (Wagner 2021, Table 6.1): road id, whether along s, lanes in that direction, and
    vehicles with the EGO.
    """

    road: str
    along: bool
    lanes: int
    vehicles: int


@dataclass(frozen=True)
class ExtractedScenario:
    """A window of a recording with an EGO.

    Attributes:
        ego: Row of the EGO in the tracks.
        start: First step of the window, a place in the tracks' times.
        end: Its last step.
        ego_start: First step of it at which the EGO is there.
        ego_end: Last such step.
        members: Rows of those that hold a slot in it, in order.
        triggers: The maneuvers that it is cut out for, in order of their start.
        bucket: What it may be compared with.
    """

    ego: int
    start: int
    end: int
    ego_start: int
    ego_end: int
    members: tuple[int, ...]
    triggers: tuple[LabelledManeuver, ...]
    bucket: Bucket


class _Holdings(NamedTuple):
    """Who holds a slot of whom at which step, a row each, in two orders: by who holds it, and by whose it is."""

    other: Ints
    step: Ints
    ego: Ints
    of_ego: Ints
    of_step: Ints
    of_other: Ints


class _Trigger(NamedTuple):
    """A maneuver of somebody around an EGO, with its window in steps."""

    ego: int
    start: int
    end: int
    maneuver: LabelledManeuver


def extract(
    features: Features, maneuvers: Sequence[LabelledManeuver], settings: ExtractionSettings
) -> list[ExtractedScenario]:
    """Give the scenarios of all EGOs, by EGO, then by time."""
    wanted = [m for m in maneuvers if m.label in settings.trigger]
    if not wanted:
        return []
    holdings = _holdings(features)
    triggers = sorted(
        _triggers(features, holdings, wanted, settings), key=lambda t: (t.ego, t.start, t.end, t.maneuver.object)
    )  # fmt: skip
    out, t = [], features.samples.tracks.t
    for window in _windows(triggers):
        ego, start, end = window[0].ego, window[0].start, max(t.end for t in window)
        if t[end] - t[start] >= settings.shortest - 1e-9:
            out.append(_scenario(features, holdings, (ego, start, end), [w.maneuver for w in window]))
    return out


def _holdings(features: Features) -> _Holdings:
    """Flatten who holds slots of whom."""
    samples = features.samples
    k, slot = np.nonzero(features.around.held >= 0)
    other, step, ego = samples.owner[features.around.held[k, slot]], samples.step[k], samples.owner[k]
    order = np.lexsort((ego, step, other))
    other, step, ego = other[order], step[order], ego[order]
    by = np.lexsort((other, step, ego))
    return _Holdings(other, step, ego, ego[by], step[by], other[by])


def _triggers(
    features: Features,
    holdings: _Holdings,
    maneuvers: Sequence[LabelledManeuver],
    settings: ExtractionSettings,
) -> Iterator[_Trigger]:
    """Each maneuver with each EGO around which its vehicle holds a slot during it."""
    samples = features.samples
    count = len(samples.tracks.t)
    key = holdings.other * count + holdings.step
    vehicles = np.isin(samples.tracks.kind, list(VEHICLES))
    for maneuver in maneuvers:
        start, end = int(samples.step[maneuver.start]), int(samples.step[maneuver.end])
        low, high = np.searchsorted(key, [maneuver.object * count + start, maneuver.object * count + end + 1])
        egos = set(holdings.ego[low:high].tolist())
        if settings.own and vehicles[maneuver.object]:
            egos.add(maneuver.object)
        window = _widened(samples.tracks.t, start, end, settings)
        yield from (_Trigger(ego, *window, maneuver) for ego in egos)


def _widened(t: np.ndarray, start: int, end: int, settings: ExtractionSettings) -> tuple[int, int]:
    if settings.before == 0.0 and settings.after == 0.0:
        return start, end
    low = int(np.searchsorted(t, t[start] - settings.before - 1e-9))
    return low, int(np.searchsorted(t, t[end] + settings.after + 1e-9)) - 1


def _windows(triggers: Sequence[_Trigger]) -> Iterator[list[_Trigger]]:
    """Triggers of one EGO that share samples, one after the other."""
    window: list[_Trigger] = []
    until = -1
    for trigger in triggers:
        if window and (trigger.ego != window[0].ego or trigger.start > until):
            yield window
            window = []
        until = max(until, trigger.end) if window else trigger.end
        window.append(trigger)
    if window:
        yield window


def _scenario(
    features: Features, holdings: _Holdings, window: tuple[int, int, int], triggers: list[LabelledManeuver]
) -> ExtractedScenario:
    ego, start, end = window
    samples = features.samples
    members = tuple(np.unique(holdings.of_other[_of_ego(holdings, ego, start, end)]).tolist())
    own = slice(int(samples.first[ego]), int(samples.first[ego + 1]))
    inside = (samples.step[own] >= start) & (samples.step[own] <= end)
    steps = samples.step[own][inside]
    bucket = _bucket(features, np.flatnonzero(inside) + own.start, len(members) + 1)
    return ExtractedScenario(ego, start, end, int(steps[0]), int(steps[-1]), members, tuple(triggers), bucket)


def window_of(
    features: Features, ego: int, samples: tuple[int, int], triggers: Sequence[LabelledManeuver]
) -> ExtractedScenario:
    """Give the scenario of an EGO from one of its samples to another, for whatever reason it is cut out."""
    steps = features.samples.step
    window = ego, int(steps[samples[0]]), int(steps[samples[1]])
    return _scenario(features, _holdings(features), window, list(triggers))


def _of_ego(holdings: _Holdings, ego: int, start: int, end: int) -> slice:
    """The holdings of one EGO in a window."""
    low, high = np.searchsorted(holdings.of_ego, [ego, ego + 1]).tolist()
    first, last = np.searchsorted(holdings.of_step[low:high], [start, end + 1]).tolist()
    return slice(low + first, low + last)


def _bucket(features: Features, samples: Ints, vehicles: int) -> Bucket:
    """Of the road on which the EGO is longest."""
    lanes = features.lanes
    on: Bools = features.row[samples] >= 0
    if not on.any():
        return Bucket("", True, 0, vehicles)
    rows = features.row[samples][on]
    table = lanes.network.lane_table
    where = Counter(zip(lanes.road[rows].tolist(), table.forward[rows].tolist(), strict=True))
    (road, along), _ = min(where.items(), key=lambda item: (-item[1], item[0]))
    here = (lanes.road[rows] == road) & (table.forward[rows] == along)
    count = Counter(lanes.lanes[rows[here]].tolist())
    most = min(count.items(), key=lambda item: (-item[1], item[0]))[0]
    return Bucket(list(lanes.network.roads)[road], bool(along), int(most), vehicles)


def tag(triggers: Sequence[LabelledManeuver]) -> str:
    """Give the tag of a scenario (Wagner 2021, Fig. 6.14): left, right, double left, double right, another label, or
    several where its triggers are of different kinds.
    """
    kinds = {_kind(maneuver) for maneuver in triggers}
    return kinds.pop() if len(kinds) == 1 else "several"


def _kind(maneuver: LabelledManeuver) -> str:
    if not maneuver.label.startswith("lane_change_"):
        return maneuver.label
    side = maneuver.label.removeprefix("lane_change_")
    return f"double {side}" if maneuver.figures.get("lanes", 1.0) > 1.0 else side
