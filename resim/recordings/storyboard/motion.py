"""Where an entity is over time, of what is done with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from resim.core.geometry import Floats, wrap_angle
from resim.recordings.storyboard.actions import Deed, Removal
from resim.recordings.storyboard.curves import ScenarioCurve
from resim.recordings.storyboard.document import ScenarioElement
from resim.recordings.storyboard.lane_drive import LaneDrive
from resim.recordings.storyboard.places import ScenarioPlace, ScenarioPlaces
from resim.recordings.storyboard.speeds import SpeedChange, SpeedCourse

MOST_DEEDS = 2000
"""Actions of an entity."""
_STANDS = 0.01
"""m/s at a trajectory's end below which its entity stands there."""
_EDGE = 1e-9
"""s by which a time may be outside of a stretch and still belong to it."""
_NEAR = 1e-3
"""m within which who waits for its trajectory is on it."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of an entity's time in which its motion is known.

    Attributes:
        begin: s.
        end: s.
        states: Gives x, y [m], heading [rad] and v [m/s] (4, T) of its reference point at times (T,) [s] within; v is
            NaN where the places alone are known.
        stations: Times [s] of vertices.
    """

    begin: float
    end: float
    states: Callable[[Floats], Floats]
    stations: Floats = field(default_factory=lambda: np.zeros(0))


class EntityMotion:
    """The stretches of an entity, of its deeds.

    Attributes:
        stretches: In order of time.
        left: Why and when the file says no more of it, in words.
    """

    def __init__(self, deeds: list[Deed], places: ScenarioPlaces, end: float) -> None:
        """Work them out till the end [s]. Raises InputError where the player decides."""
        self._places, self._end = places, end
        self._course = SpeedCourse()
        self._place: ScenarioPlace | None = None
        self._of: ScenarioElement | None = None
        self._since = 0.0
        self._curve: tuple[ScenarioCurve, Deed] | None = None
        self._over = False
        self._stop = np.inf
        self.stretches: list[Stretch] = []
        self.left: list[str] = []
        if len(deeds) > MOST_DEEDS:
            raise deeds[0].element.refused(
                f"is one of {len(deeds)} actions of its entity, expected up to {MOST_DEEDS}",
                "Write its drive as one trajectory.",
            )
        for deed in deeds:
            self._settle(deed.at)
            self._apply(deed)
        self._settle(end)
        self._close(end)

    def _apply(self, deed: Deed) -> None:
        what = deed.what
        if isinstance(what, SpeedChange):
            self._change_speed(deed, what)
        elif isinstance(what, ScenarioCurve):
            self._begin_curve(deed, what)
        else:
            self._close(deed.at)
            self._place, self._of, self._since, self._over = None, deed.element, deed.at, False
            if not isinstance(what, Removal):
                self._place = what

    def _change_speed(self, deed: Deed, what: SpeedChange) -> None:
        if self._curve is not None and self._curve[0].timed:
            if deed.at < min(self._curve[0].end, self._curve[1].until) - _EDGE:
                raise deed.element.refused(
                    "changes the speed of who follows a trajectory over time", "Keep one of the two."
                )
            self._close(deed.at)
        if self._over:
            raise deed.element.refused(
                f"is at {deed.at:g} s: the player decides how it drives after its trajectory",
                "Let the trajectory last longer.",
            )
        self._course.change(deed.at, what)
        self._stop = deed.until

    def _settle(self, t: float) -> None:
        """The speed stays as it is where its action was stopped before t [s]."""
        if self._stop < t:
            self._course.keep(self._stop)
            self._stop = np.inf

    def _begin_curve(self, deed: Deed, curve: ScenarioCurve) -> None:
        begin = max(deed.at, curve.begin) if curve.timed else deed.at
        if curve.timed and curve.begin > deed.at + _EDGE:
            self._refuse_unless_waiting(deed, curve)
        if curve.timed and curve.end <= deed.at:
            problem = f"ends at {curve.end:g} s, when its action begins, at {deed.at:g} s"
            raise deed.element.refused(f"has a trajectory that {problem}")
        self._close(min(begin, self._end))
        self._curve, self._since, self._over = (curve, deed), begin, False

    def _refuse_unless_waiting(self, deed: Deed, curve: ScenarioCurve) -> None:
        first = curve.at(np.array([curve.begin]))[:, 0]
        speed = self._course.speed(np.array([deed.at]))[0]
        there = (
            self._place is not None and np.hypot(first[0] - self._place.x, first[1] - self._place.y) < _NEAR
        )
        if not there or speed > 0.0:
            raise deed.element.refused(
                f"begins at {deed.at:g} s, its first vertex is at {curve.begin:g} s: where it is between, the "
                "player decides", "Let it stand at the first vertex, or begin there.",
            )  # fmt: skip

    def _close(self, t: float) -> None:
        """Keep what was till t [s], if it was anything."""
        if self._curve is not None:
            self._close_curve(t)
        if self._place is not None and t > self._since:
            self._close_free(self._place, t)
        self._since = t

    def _close_free(self, place: ScenarioPlace, t: float) -> None:
        """Who does nothing else stands, or drives along its lane."""
        since, course = self._since, self._course
        before = float(course.way(np.array([since]))[0])
        until = float(course.way(np.array([t]))[0])
        if until - before <= 0.0:
            self.stretches.append(_standing(place, since, t))
            return
        assert self._of is not None  # whoever has a place was put there by an element
        drive = LaneDrive(self._places, place, until - before, self._of)
        end = t if drive.length >= until - before else _when(course, before + drive.length, since, t)

        def states(times: Floats) -> Floats:
            return np.vstack([drive.at(course.way(times) - before), course.speed(times)])

        self.stretches.append(Stretch(since, end, states))
        if end < t:
            self._leave(f"its lane ends at {end:.3f} s")

    def _close_curve(self, t: float) -> None:
        assert self._curve is not None  # asked by _close alone
        (curve, deed), self._curve, course = self._curve, None, self._course
        since, last = self._since, min(t, deed.until)
        if since >= last:
            self._place, self._over = None, True
            return
        if curve.timed:
            over, at = curve.end, curve.at
        else:
            before = float(course.way(np.array([since]))[0])
            reached = float(course.way(np.array([last]))[0]) - before
            over = np.inf if reached < curve.end else _when(course, before + curve.end, since, last)

            def at(times: Floats) -> Floats:
                return curve.at(course.way(times) - before)

        end = min(over, last)

        def states(times: Floats) -> Floats:
            v = np.full(len(times), np.nan) if curve.timed else course.speed(times)
            return np.vstack([at(times), v])

        stations = curve.stations if curve.timed else np.zeros(0)
        self.stretches.append(Stretch(since, end, states, stations[(stations >= since) & (stations <= end)]))
        self._place, self._since = None, end
        if end >= t - _EDGE:
            self._over = True
            return
        x, y, heading = at(np.array([end]))[:, 0]
        back = min(0.02, end - since)
        moved = np.hypot(*(at(np.array([end - back]))[:2, 0] - (x, y)))
        if curve.timed and end == over and moved <= _STANDS * back:
            course.change(end, SpeedChange(0.0, "step", "time", 0.0))
            self._place, self._of = ScenarioPlace(x, y, heading, heading), deed.element
        else:
            self._leave(f"its trajectory ends at {end:.3f} s")

    def _leave(self, why: str) -> None:
        self.left.append(why)
        self._place, self._over = None, True


def _standing(place: ScenarioPlace, begin: float, end: float) -> Stretch:
    state = np.array([place.x, place.y, place.faced, 0.0])
    return Stretch(begin, end, lambda t: np.repeat(state[:, None], len(t), axis=1))


def _when(course: SpeedCourse, way: float, low: float, high: float) -> float:
    """When [s] between low and high a way [m] is reached, by bisection."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        if course.way(np.array([middle]))[0] < way:
            low = middle
        else:
            high = middle
    return high


def sampled(motion: EntityMotion, t: Floats) -> Floats:
    """Give x, y [m], heading [rad], v [m/s] (4, T) of an entity's reference point at times t (T,) [s], NaN elsewhere.

    Where the places alone are known, v is their derivative over the times, along the heading.
    """
    out = np.full((4, len(t)), np.nan)
    later = [*(stretch.begin for stretch in motion.stretches[1:]), np.inf]
    for stretch, follows in zip(motion.stretches, later, strict=False):
        inside = (t >= stretch.begin - _EDGE) & (t <= stretch.end + _EDGE)
        rows = np.flatnonzero(inside & (t < follows - _EDGE))
        if not len(rows):
            continue
        times = np.clip(t[rows], stretch.begin, stretch.end)
        states = stretch.states(times)
        if not np.isfinite(states[3]).all():
            states[3] = _speeds(stretch, times, states)
        out[:, rows] = states
    out[2] = wrap_angle(out[2])
    return out


def _speeds(stretch: Stretch, times: Floats, states: Floats) -> Floats:
    """Speeds (T,) [m/s] along the heading, by differences of second order, at the ends as well."""
    if len(times) > 2 and np.diff(times).min() > 0.0:
        vx, vy = np.gradient(states[:2], times, axis=1, edge_order=2)
    else:
        ends = np.clip([times - 0.01, times + 0.01], stretch.begin, stretch.end)
        before, after = stretch.states(ends[0]), stretch.states(ends[1])
        vx, vy = (after[:2] - before[:2]) / np.maximum(ends[1] - ends[0], 1e-12)
    return np.asarray(vx * np.cos(states[2]) + vy * np.sin(states[2]))


def station_times(motion: EntityMotion) -> Iterator[Floats]:
    """Give the times [s] of vertices, and of beginnings and ends, of an entity's stretches."""
    for stretch in motion.stretches:
        yield np.r_[stretch.begin, stretch.stations, stretch.end]
