"""What the page looks at: which objects matter, where they are along the road, and how they are drawn."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats, to_frame, unwrap_angle
from resim.core.tracks import Tracks
from resim.report.plots import clock_words
from resim.resimulation import Resimulation, ResimulationAssessment
from resim.resimulation.report import RunReport
from resim.road.opendrive import LaneShape
from resim.road.path import Path, lane_path

MOST_IN_FOCUS = 3
"""Traffic objects drawn in colour; the others are grey."""

TURNED_OFF = 12.0
"""Offset [m] from the starting lane beyond which the EGO has taken another way than straight on."""

SAME_LANE = 1.75
"""Offset [m] between the EGO and a TO up to which that is ahead of it, not beside."""

OTHERS = "#9aa1aa"
SEEDS = "#7a3fb0"
"""Colour of the runs with a perception model."""
EGO_COLORS: Mapping[str, str] = {"GT": "#0072B2", "SD": "#CC79A7"}
TO_COLORS: Mapping[str, tuple[str, ...]] = {
    "GT": ("#009E73", "#6CB33F", "#00594A"),
    "SD": ("#D55E00", "#EDA23A", "#8C2D04"),
}
"""Blue and pink, green and red as in Fig. 5.4, in tones that colour-blind readers tell apart (Okabe-Ito)."""


@dataclass(frozen=True, eq=False)
class View:
    """A result as the page shows it.

    assessed: how all its drives were judged. tracks: by source GT, SD, rGT, rSD.
    focus: ids of the TOs drawn in colour, the most relevant first.
    lead: the TO ahead of the EGO in GT, if any, always in focus.
    path: what the offset across the road is measured from, the centre of the EGO's starting lane where it
    stays near it (on_lane), else its own way. turn: rad, the direction of travel,
    which the plan view lays to the right.
    """

    result: Resimulation
    assessed: ResimulationAssessment
    report: RunReport
    tracks: Mapping[str, Tracks]
    focus: tuple[str, ...]
    lead: str | None
    path: Path
    on_lane: bool
    origin: tuple[float, float]
    turn: float

    @property
    def ego(self) -> str:
        """The EGO's id."""
        return self.result.ego

    @property
    def shown(self) -> tuple[str, ...]:
        """The EGO and the TOs in focus."""
        return (self.ego, *self.focus)

    @cached_property
    def others(self) -> tuple[str, ...]:
        """The ids of all TOs of any source that are not in focus."""
        every = dict.fromkeys(i for tracks in self.tracks.values() for i in tracks.ids.tolist())
        return tuple(i for i in every if i not in self.shown)

    @cached_property
    def lanes(self) -> list[LaneShape]:
        """The lanes within 80 m of the EGO's bounding box in the map."""
        own = [tracks.select([self.ego]) for tracks in self.tracks.values()]
        x, y = (np.concatenate([getattr(o, axis)[o.valid] for o in own]) for axis in ("x", "y"))
        low = np.array([x.min(), y.min()]) - 80.0
        high = np.array([x.max(), y.max()]) + 80.0
        shapes = self.result.network.lane_shapes(2.0)
        return [s for s in shapes if ((s.centre >= low) & (s.centre <= high)).all(axis=1).any()]

    @cached_property
    def span(self) -> tuple[float, float]:
        """First and last time [s] of any source."""
        times = [t for tracks in self.tracks.values() for t in tracks.t[[0, -1]].tolist() if len(tracks.t)]
        return min(times), max(times)

    @property
    def start(self) -> float:
        """What times in figures are counted from [s]."""
        return self.span[0]

    def since(self, t: Floats) -> Floats:
        """Give times [s] from the start on."""
        return np.asarray(t - self.start)

    @property
    def clock(self) -> str:
        """The title of an axis of times."""
        return clock_words(self.start)

    def color(self, object_id: str, source: str) -> str:
        """Give the colour of an object as a source (GT, SD, rGT, rSD) has it."""
        basis = source.removeprefix("r")
        if object_id == self.ego:
            return EGO_COLORS[basis]
        return TO_COLORS[basis][self.focus.index(object_id)] if object_id in self.focus else OTHERS

    def label(self, object_id: str) -> str:
        """Give what an object is called."""
        if object_id == self.ego:
            return "EGO"
        return "TO" if self.only_one else f"TO {object_id}"

    @property
    def path_name(self) -> str:
        """What the path is called."""
        return "the centre of the EGO's starting lane" if self.on_lane else "the EGO's measured way"

    @property
    def path_short(self) -> str:
        """What the path is called on an axis."""
        return "lane centre" if self.on_lane else "EGO's way"

    @property
    def only_one(self) -> bool:
        """Whether there is one TO, which then needs no id."""
        return len(self.focus) == 1 and not self.others

    def plan(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Turn map positions [m] so that travel goes to the right, the EGO's start at 0, 0."""
        return to_frame(x, y, *self.origin, self.turn)

    def along(self, tracks: Tracks, object_id: str) -> tuple[Floats, Floats]:
        """Give s and d (T,) [m] of an object along and left of the path, NaN where it is not valid."""
        n = tracks.index(object_id)
        own = tracks.valid[n]
        out = np.full((2, len(own)), np.nan)
        if own.any():
            out[:, own] = self.path.project(tracks.x[n, own], tracks.y[n, own])
        return out[0], out[1]


def view(result: Resimulation, assessed: ResimulationAssessment) -> View:
    """Look at a result."""
    ego, tracks = result.ego, result.tracks()
    first = tracks["GT"]
    n = first.index(ego)
    x, y = first.x[n, first.valid[n]], first.y[n, first.valid[n]]
    heading = float(first.heading[n, first.valid[n]][0])
    travelled = np.hypot(x[-1] - x[0], y[-1] - y[0])
    report = result.report
    path, on_lane = _path(result, tracks, first)
    lead = _lead(first, ego, report.reaction.values(), path)
    return View(
        result=result,
        assessed=assessed,
        report=report,
        tracks=tracks,
        focus=_focus(result, tracks.values(), lead),
        lead=lead,
        path=path,
        on_lane=on_lane,
        origin=(float(x[0]), float(y[0])),
        turn=float(np.arctan2(y[-1] - y[0], x[-1] - x[0])) if travelled > 5.0 else heading,
    )


def _lead(tracks: Tracks, ego: str, reactions: Iterable[float | None], path: Path) -> str | None:
    """The TO nearest ahead of the EGO in its lane, around the reactions; else over the whole drive."""
    times = [t for t in reactions if t is not None]
    around = tracks.window(min(times) - 1.0, max(times) + 1.0) if times else tracks
    here = around if ego in around.ids else tracks
    s, d = np.full(here.x.shape, np.nan), np.full(here.x.shape, np.nan)
    s[here.valid], d[here.valid] = path.project(here.x[here.valid], here.y[here.valid])
    row = here.index(ego)
    ahead, beside = s - s[row], np.abs(d - d[row])
    gap = np.where((ahead > 0.0) & (beside < SAME_LANE), ahead, np.inf)
    nearest = gap.min(axis=1)
    best = int(np.argmin(nearest))
    return str(here.ids[best]) if np.isfinite(nearest[best]) else None


def _focus(result: Resimulation, sources: Iterable[Tracks], lead: str | None) -> tuple[str, ...]:
    """TOs that were hit, the one ahead, and those that came closest, sideways counted three times, behind twice."""
    closest: dict[str, float] = {}
    for tracks in sources:
        row = tracks.index(result.ego)
        ahead, left = to_frame(tracks.x, tracks.y, tracks.x[row], tracks.y[row], tracks.heading[row])
        apart = np.hypot(np.where(ahead < 0.0, 2.0 * ahead, ahead), 3.0 * left)
        least = np.where(np.isfinite(apart), apart, np.inf).min(axis=1, initial=np.inf)
        for name, value in zip(tracks.ids.tolist(), least.tolist(), strict=True):
            closest[name] = min(value, closest.get(name, np.inf))
    closest.pop(result.ego, None)
    struck = {c.id for drive in result.simulated().values() for c in drive.collisions}
    order = sorted(closest, key=lambda name: (name not in struck, name != lead, closest[name]))
    return tuple(order[:MOST_IN_FOCUS])


def _path(result: Resimulation, tracks: Mapping[str, Tracks], first: Tracks) -> tuple[Path, bool]:
    """The centre of the EGO's starting lane, or its own way where it turned off (False)."""
    n = first.index(result.ego)
    own = first.valid[n]
    x, y, heading = first.x[n, own], first.y[n, own], first.heading[n, own]
    far = max(_length(t, t.index(result.ego)) for t in tracks.values()) + 150.0
    z = None if first.z is None else first.z[n, own][:1]
    at = result.network.to_road(x[:1], y[:1], heading=heading[:1], z=z)
    try:
        path = lane_path(result.network, str(at.road[0]), int(at.lane[0]), float(at.s[0]), far, behind=150.0)
        if np.abs(path.project(x, y)[1]).max() <= TURNED_OFF:
            return path, True
    except ResimError:
        pass
    return _own_way(x, y, heading), False


def _length(tracks: Tracks, n: int) -> float:
    own = tracks.valid[n]
    return float(np.hypot(np.diff(tracks.x[n, own]), np.diff(tracks.y[n, own])).sum())


def _own_way(x: Floats, y: Floats, heading: Floats) -> Path:
    """A path through the EGO's positions, points at least 2 m apart, straight before and after."""
    keep = [0]
    for k in range(1, len(x)):
        if np.hypot(x[k] - x[keep[-1]], y[k] - y[keep[-1]]) >= 2.0:
            keep.append(k)
    px, py = x[keep], y[keep]
    way = unwrap_angle(heading[keep])
    before, after = (px[0] - 150.0 * np.cos(way[0]), py[0] - 150.0 * np.sin(way[0])), (
        px[-1] + 150.0 * np.cos(way[-1]), py[-1] + 150.0 * np.sin(way[-1]),
    )  # fmt: skip
    px, py = np.r_[before[0], px, after[0]], np.r_[before[1], py, after[1]]
    way = np.r_[way[0], way, way[-1]]
    s = np.r_[0.0, np.cumsum(np.hypot(np.diff(px), np.diff(py)))] - 150.0
    none = np.zeros(len(s))
    return Path(s, px, py, way, none, none, none, none, none, ends=True, end=float(s[-1]))
