"""What braking and a lane change are: the one definition, and every threshold by its name.

A whole drive is told by where it went, on the road (`events`); what is seen of an object in one moment by its motion
alone (`momentary`), as a sensor has no more. So a lane change is the crossing of a border in the one and speed
across in the other, and each has thresholds of its own.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resim.core.geometry import Floats, wrap_angle
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork, RoadPositions
from resim.road.path import Path, lane_path

REACTED = -0.5
"""Acceleration [m/s²] of the EGO below which it has reacted (Wagner 2021, Section 5.3.2): that of splines, with little
noise, so that the beginning of braking counts.
"""
SEEN_BRAKING = -1.0
"""Acceleration [m/s²] of an object below which it brakes to a sensor: speed errors of a few 0.1 m/s over a second are
not taken for braking (our choice; the models that ship were trained with it).
"""
SEEN_ACROSS = 0.3
"""Speed [m/s] across the EGO's heading above which an object changes lane to a sensor: a lane of 3.5 m in 12 s (our
choice; the models that ship were trained with it).
"""
VARIED_BRAKING = 0.5
"""m/s²; an object that brakes less has no braking to be changed: as much as counts as the EGO's reaction."""
VARIED_ACROSS = 1.0
"""m; an object that moves less across its lane has no lane change to be moved in time (our choice: less than it takes
to leave a lane, as some lane changes begin or end outside of the recording).
"""
TURNED_OFF = 0.3
"""Heading [rad] against the lane from which on leaving it is turning off and not changing lane (our choice)."""

CLOSE_TO_CENTRE = 1.0
"""Distance [m] from the centre of a lane below which an object is close to it: a lane change leads from close to one
centre to close to another (Kaefer 2022, 4.5.6.2).
"""
NEUTRAL_ACROSS = 0.03
"""Speed [m/s] across the lane below which an object keeps to its lane; out to it a lane change lasts from where the
border is crossed (Wagner 2021, 6.2.1.1, printed as m/s²).
"""
CUT_TTC = 2.0
"""Time to collision [s] below which a lane change is a cut-in or a cut-out (Kaefer 2022, 4.5.6.3)."""
STRONG_BRAKING = -3.5
"""m/s² below which braking is strong: the most that an adaptive cruise control may do at speed (ISO 15622:2018)."""
STRONG_ACCELERATION = 2.5
"""m/s² above which acceleration is strong (our choice: ISO 15622:2018 has 2 m/s² at speed, 4 m/s² up to 5 m/s)."""

BEGINS, ENDS = 20.0, 100.0
"""Steps [m] along the road in which a path begins on which a drive is looked at, and in which its length grows."""

MANEUVERS = ("follow_lane", "lane_change_left", "lane_change_right", "braking")
"""What an object can be seen to do, in the order of `momentary`."""
_FOLLOW, _LEFT, _RIGHT, _BRAKES = range(4)


def change_span(across: Floats, crossing: int, side: int, neutral: float = NEUTRAL_ACROSS) -> tuple[int, int]:
    """Give the first and last sample of a lane change (Wagner 2021, 6.2.1.1): out to the first ones below a threshold.

    across (K,): speed [m/s] to the left against the lane, of one object without gaps. crossing: the first sample beyond
    the border. side: 1 to the left, -1 to the right; speed the other way ends it as well. Ends of the samples end it.
    """
    slow = ~(side * across >= neutral)
    before, after = np.flatnonzero(slow[:crossing]), np.flatnonzero(slow[crossing:])
    start = int(before[-1]) if len(before) else 0
    return start, crossing + int(after[0]) if len(after) else len(across) - 1


def closest_to_centres(
    offset: Floats, first: int, last: int, close: float = CLOSE_TO_CENTRE
) -> tuple[int | None, int | None]:
    """Give the nearest samples before `first` and from `last` on that are close to a lane's centre, None for none.

    offset (K,) [m]: from the centre of the lane that each sample is on. first, last: the first samples beyond the first
    and the last border that a maneuver crosses. It is a lane change where the lanes there differ (Kaefer 2022,
    4.5.6.2); strictly below `close` is close. A track that begins or ends between has none, and cannot be judged.
    """
    near = np.abs(offset) < close
    before, after = np.flatnonzero(near[:first]), np.flatnonzero(near[last:])
    return int(before[-1]) if len(before) else None, last + int(after[0]) if len(after) else None


def momentary(relative_heading: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[np.intp]:
    """Give what objects are seen to do, as index into `MANEUVERS`: they brake, else change lane, else follow theirs.

    relative_heading [rad]: against the EGO's. v [m/s], a [m/s²]: over ground, along the object's heading.
    """
    across = np.asarray(v) * np.sin(relative_heading)
    sideways = np.where(across > SEEN_ACROSS, _LEFT, np.where(across < -SEEN_ACROSS, _RIGHT, _FOLLOW))
    return np.where(np.asarray(a) < SEEN_BRAKING, _BRAKES, sideways)


def reaction_time(tracks: Tracks, *, ego: str) -> float | None:
    """Give the first time [s] at which the EGO's acceleration is below REACTED, None where it never is.

    tracks must have `a`: a scenario's, whose splines give it without noise, or a run's.
    """
    if tracks.a is None:
        raise ValueError("reaction needs the acceleration: take a scenario's or a run's tracks")
    braking = np.flatnonzero(tracks.a[tracks.index(ego)] < REACTED)
    return float(tracks.t[braking[0]]) if len(braking) else None


def decision(tracks: Tracks, network: RoadNetwork, *, ego: str) -> list[str]:
    """Give what the EGO did, in order of time, out of brake, lane_change_left and lane_change_right."""
    return [name for _, name in events(tracks, network, ego=ego)]


def events(tracks: Tracks, network: RoadNetwork, *, ego: str) -> list[tuple[float, str]]:
    """Give when [s] the EGO did what (see `decision`), in order of time."""
    found = lane_changes(tracks, network, ego=ego)
    if (t := reaction_time(tracks, ego=ego)) is not None:
        found.append((t, "brake"))
    return sorted(found)


def lane_changes(tracks: Tracks, network: RoadNetwork, *, ego: str) -> list[tuple[float, str]]:
    """Give when [s] the EGO's centre entered another lane, and to which side."""
    row = tracks.index(ego)
    there = tracks.valid[row]
    t, x, y, heading = (c[there] for c in (tracks.t, tracks.x[row], tracks.y[row], tracks.heading[row]))
    z = None if tracks.z is None else tracks.z[row, there]
    out: list[tuple[float, str]] = []
    k = 0
    while k < len(t):
        left = _leaves_lane(network, x[k:], y[k:], heading[k:], None if z is None else z[k:])
        if left is None:
            break
        step, side = left
        if step and side:  # else it turned off, or starts beyond its lane's border, as where lanes overlap
            out.append((float(t[k + step]), side))
        k += max(step, 1)
    return out


def _leaves_lane(
    network: RoadNetwork, x: Floats, y: Floats, heading: Floats, z: Floats | None
) -> tuple[int, str] | None:
    """The first sample beyond the border of the first sample's lane, and the side; "" where it turns off.

    A lane change ends in another lane, oncoming or not, and runs along the one it leaves.
    """
    at = network.to_road(x[:1], y[:1], heading=heading[:1], z=None if z is None else z[:1])
    path = _lane_ahead(network, at, float(np.hypot(np.diff(x), np.diff(y)).sum()))
    s, d = path.project(x, y)
    beyond = np.flatnonzero(np.abs(d) > np.interp(s, path.s, path.half_width))
    if not len(beyond):
        return None
    across = wrap_angle(heading[beyond] - np.interp(s[beyond], path.s, path.heading))
    turned = np.abs(across) > TURNED_OFF
    counts = beyond[turned | network.to_road(x[beyond], y[beyond]).on_road]
    if not len(counts):
        return None
    first = int(counts[0])
    if turned[np.searchsorted(beyond, first)]:
        return first, ""
    return first, "lane_change_left" if d[first] > 0.0 else "lane_change_right"


def _lane_ahead(network: RoadNetwork, at: RoadPositions, driven: float) -> Path:
    """The lane of a position from a bit before it to a bit beyond a drive of so many metres.

    It begins and ends in steps, so that drives of one scenario share it.
    """
    road, s = str(at.road[0]), float(at.s[0])
    section = network.roads[road].sections[network.roads[road].section_index(s)]
    begin = min(max(BEGINS * math.floor(s / BEGINS), section.start), section.end)
    length = ENDS * math.ceil((driven + BEGINS) / ENDS + 0.2)
    return lane_path(network, road, int(at.lane[0]), begin, length, behind=2.0 * BEGINS)
