"""Lane changes: Kaefer's closeness rule says whether, Wagner's speed across says from when to when.

Kaefer 2022, 4.5.6.2; Wagner 2021, 6.2.1.1. Readings taken: strictly below 1 m is close, noise apart; the nearest such
samples around the crossing count, and lanes there must differ, where a lane that goes on (over sections, through
junctions, by a fork or a merge) is one lane; where the track begins or ends before, or every border is crossed to the
side away from the new lane, as by a track that jumps, nothing is judged, which is a label of its own. The span goes out
to the first sample whose speed in the change's own direction is below the threshold, that is |v_across| with reversals
seen as well. Who is headed away from the lane by more than `TURNED_OFF` when crossing, and where the motion across
begins or has ended, turns off; who stops on the way is across its lanes there, and has not ended it. Doubles, in which
that speed never falls below it, are one label, whatever the middle lane.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from resim.core.geometry import Floats, wrap_angle
from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.settings import MiningSettings
from resim.mining.smoothing import averaged
from resim.scenario.maneuvers import TURNED_OFF, change_span, closest_to_centres

LEFT, RIGHT, OPEN = "lane_change_left", "lane_change_right", "lane_change_not_judged"
FINE = 0.02
"""m: deviation to which offsets are averaged that are held against that of being close (our choice: of 0.01 to 0.03 it
gives the fewest changes with an end that is none)."""


@dataclass(frozen=True)
class LaneChangeLabel(LabelledManeuver):
    """A lane change; `at` is the first sample in the new lane, of a double in the first new lane.

    Attributes:
        lanes: Lanes gained to the left; to the right negative.
        close_before: Kaefer's start: the last sample close to the old lane's centre.
        close_after: Kaefer's end: the first sample close to the new lane's centre.
    """

    lanes: int = 0
    close_before: int = -1
    close_after: int = -1


@dataclass(frozen=True)
class _Crossing:
    """A border crossed: the first sample beyond, lanes passed to the left, the span, and Kaefer's samples.

    first, last: where the motion across Kaefer's samples begins and ends; None where the track does not show it.
    """

    at: int
    side: int
    start: int
    end: int
    before: int | None
    after: int | None
    first: int | None
    last: int | None


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find the lane changes of vehicles."""
    samples = features.samples
    crossed = (features.passed != 0) & samples.kinds(frozenset(settings.kinds))
    at = np.flatnonzero(crossed)
    group = samples.piece_of[at] * (len(features.stretch) + 1) + features.stretch[at]
    for part in np.split(at, np.flatnonzero(np.diff(group)) + 1) if len(at) else ():
        yield from _of_stretch(features, settings, part.tolist())


def _of_stretch(
    features: Features, settings: MiningSettings, crossings: list[int]
) -> Iterator[LabelledManeuver]:
    """The lane changes of one object in a stretch without breaks, from the samples at which it crosses borders."""
    low, high = _bounds(features, crossings[0])
    offset = _offsets(features, low, high)
    own = [_crossing(features, settings, k, low, offset) for k in crossings]
    changes: list[LaneChangeLabel] = []
    for _, group in groupby(own, key=lambda c: (c.before, c.after)):
        change = _judged(features, list(group))
        if change is None:
            continue
        last = changes[-1] if changes else None
        if last is not None and _one(last, change):
            lanes = last.lanes + change.lanes
            changes[-1] = replace(
                last, end=max(last.end, change.end), lanes=lanes, close_after=change.close_after
            )
        else:
            changes.append(change)
    yield from (_told(features, change) for change in changes)


def _bounds(features: Features, k: int) -> tuple[int, int]:
    """The first sample and the one behind the last of the stretch and piece that sample k is of."""
    samples = features.samples
    piece = samples.piece_of[k]
    low, high = int(samples.piece[piece]), int(samples.piece[piece + 1])
    own = features.stretch[low:high] == features.stretch[k]
    return low + int(np.argmax(own)), high - int(np.argmax(own[::-1]))


def _offsets(features: Features, low: int, high: int) -> Floats:
    """The offsets [m] of samples low to high, of one stretch, less their noise.

    Borders leave a step in offsets, but none in the way across, of which the noise is the same.
    """
    on = low + np.flatnonzero(features.row[low:high] >= 0)
    aside = features.aside[on]
    less = averaged(features.samples.t[on], aside, np.zeros(len(on), dtype=np.intp), FINE) - aside
    out = features.offset[low:high].copy()
    out[on - low] += np.where(features.with_lane[on], less, -less)
    return out


def _crossing(features: Features, settings: MiningSettings, k: int, low: int, offset: Floats) -> _Crossing:
    rules, side = settings.lane_change, int(np.sign(features.passed[k]))
    across = features.v_across[low : low + len(offset)]
    start, end = change_span(across, k - low, side, rules.lateral_speed)
    before, after = closest_to_centres(offset, k - low, k - low, rules.close)
    first = None if before is None else change_span(across, min(before, start), side, rules.lateral_speed)[0]
    last = None if after is None else change_span(across, max(after, end), side, rules.lateral_speed)[1]
    shifted = (None if a is None else low + a for a in (before, after, first, last))
    return _Crossing(k, side, low + start, low + end, *shifted)


def _judged(features: Features, group: list[_Crossing]) -> LaneChangeLabel | None:
    """The lane change that crossings with the same close samples around make, None for swaying over the border."""
    group = [c for c in group if not _turns_off(features, c)]
    if not group:
        return None
    one = group[0]
    row = int(features.samples.owner[one.at])
    not_judged = LaneChangeLabel(OPEN, row, one.start, max(c.end for c in group), one.at)
    if one.before is None or one.after is None:
        return not_judged
    lanes = int(features.strand[one.after] - features.strand[one.before])
    if lanes == 0:
        return None
    along = [c for c in group if c.side * lanes > 0]
    if not along:
        return not_judged
    return LaneChangeLabel(
        LEFT if lanes > 0 else RIGHT, row, min(c.start for c in along), max(c.end for c in along), along[0].at,
        lanes=lanes, close_before=one.before, close_after=one.after,
    )  # fmt: skip


def _turns_off(features: Features, crossing: _Crossing) -> bool:
    """Whether a crossing is that of who turns off, or in: headed away from the lane there, and before or after as well.

    Who changes lane at walking speed crosses as steeply, but goes along with its lanes before and after.
    """
    ends = [k for k in (crossing.first, crossing.last) if k is not None]
    return _headed_away(features, crossing.at) and any(_headed_away(features, k) for k in ends)


def _headed_away(features: Features, k: int) -> bool:
    """Whether a vehicle goes across its lane, as everywhere in resim."""
    own = features.samples.heading[k]
    off = float(wrap_angle(own - features.lane_heading[k]))
    return min(abs(off), np.pi - abs(off)) > TURNED_OFF


def _one(last: LaneChangeLabel, change: LaneChangeLabel) -> bool:
    """Whether two changes are a double: to one side, and no slow sample between their crossings."""
    return OPEN not in (last.label, change.label) and last.label == change.label and last.end >= change.at


def _told(features: Features, change: LaneChangeLabel) -> LaneChangeLabel:
    if change.label == OPEN:
        return change
    span = slice(change.start, change.end + 1)
    t = features.samples.t
    figures = {
        "lanes": float(abs(change.lanes)),
        "duration_s": float(t[change.end] - t[change.start]),
        "most_across_mps": float(np.nanmax(np.abs(features.v_across[span]))),
        "v_mps": float(features.samples.v[change.at]),
    }
    return replace(change, figures=figures)


FAMILIES.add(
    LabelFamily(
        "lane change", (LEFT, RIGHT, OPEN), find,
        "from close to one lane's centre to close to another's; not judged where the track shows one of them only",
        "Kaefer 2022, 4.5.6.2; Wagner 2021, 6.2.1.1",
    )
)  # fmt: skip
