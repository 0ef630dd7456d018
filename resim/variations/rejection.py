"""Why a variation is left out: what no vehicle can do, who would be in whom, who leaves the road, what a check finds.

What the original does as well is no reason: where it brakes at 10 m/s², so may its variations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from resim.core.geometry import Bools, Boxes, Floats, box_corners, boxes_overlap
from resim.core.tracks import Tracks
from resim.recordings import Recording, RecordingTables
from resim.recordings.checks import examine
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario
from resim.variations.settings import MotionLimits, VariationSettings

LOOK = 0.1
"""s between the moments in which it is looked whether somebody is on the road."""
MORE = 1.02
"""Times the original's own largest value that a variation's may be where that is beyond a limit."""
FIT = 0.1
"""m that a varied trace may be off the variation that it was fitted to."""
REASONS = ("time", "fit", "acceleration", "braking", "lateral", "yaw_rate", "backwards", "off_road", "overlap",
           "check")  # fmt: skip
"""Names of all reasons, in the order in which they are looked for; the first that holds is told."""


@dataclass(frozen=True, eq=False)
class VariedAgainst:
    """What variations of a drive are held against.

    Attributes:
        recording: The original's.
        network: Its map.
        scenario: The original, as described on GT.
        varied: Ids of the objects that are varied.
        settings: What is allowed.
    """

    recording: Recording
    network: RoadNetwork
    scenario: Scenario
    varied: tuple[str, ...]
    settings: VariationSettings

    @cached_property
    def motion(self) -> dict[str, dict[str, float]]:
        """By object the original's largest values of what is limited."""
        tracks = self.scenario.tracks(self.network, self.recording.gt.t)
        return {name: extremes(tracks, name) for name in self.varied}

    @cached_property
    def overlapping(self) -> set[tuple[str, str]]:
        """Who overlaps a varied object in the original."""
        return overlapping(self.scenario.tracks(self.network, self.recording.gt.t), self.varied)

    @cached_property
    def beside(self) -> dict[str, Bools]:
        """By object when (K,) it is off the road in the original."""
        t = self.looks
        tracks = self.scenario.tracks(self.network, t)
        return {name: off_road(tracks, name, self.network) for name in self.varied}

    @cached_property
    def looks(self) -> Floats:
        """The moments (K,) [s] in which it is looked where somebody is."""
        t = self.recording.gt.t
        return t[:: max(round(LOOK / float(np.median(np.diff(t)))), 1)]

    @cached_property
    def known(self) -> set[tuple[str, str]]:
        """What `resim check` finds in the original: codes and objects."""
        found = examine(RecordingTables.of(self._of(self.scenario)), self.network)
        return {(one.code, one.object) for one in found}

    def _of(self, scenario: Scenario) -> Recording:
        """A recording of what the varied objects do in a scenario, all others as they were recorded."""
        return varied_recording(self.recording, scenario, self.network, self.varied)


def reason(found: Scenario, off: float, against: VariedAgainst) -> str:
    """Give the reason why a scenario is no variation, "" for none. off: m, of the fit."""
    if off > FIT:
        return "fit"
    limits = against.settings.limits
    tracks = found.tracks(against.network, against.recording.gt.t)
    for name in against.varied:
        if exceeded := next(_beyond(extremes(tracks, name), against.motion[name], limits), ""):
            return exceeded
    looked = found.tracks(against.network, against.looks)
    for name in against.varied:
        if (off_road(looked, name, against.network) & ~against.beside[name]).any():
            return "off_road"
    if not against.settings.overlap and overlapping(tracks, against.varied) - against.overlapping:
        return "overlap"
    checked = examine(RecordingTables.of(against._of(found)), against.network)
    return "check" if any((one.code, one.object) not in against.known for one in checked) else ""


def extremes(tracks: Tracks, name: str) -> dict[str, float]:
    """Give the largest value of each limit that an object reaches."""
    n = tracks.index(name)
    own = tracks.valid[n]
    assert tracks.a is not None
    assert tracks.yaw_rate is not None
    v, a, turn = tracks.v[n, own], tracks.a[n, own], tracks.yaw_rate[n, own]
    values = {"acceleration": a * np.sign(v), "braking": -a * np.sign(v), "lateral": np.abs(v * turn),
              "yaw_rate": np.abs(turn), "backwards": -v}  # fmt: skip
    return {which: float(series.max(initial=0.0)) for which, series in values.items()}


def _beyond(found: dict[str, float], was: dict[str, float], limits: MotionLimits) -> Iterator[str]:
    """Which limits are exceeded, and by more than the original does."""
    for name, value in found.items():
        if value > max(getattr(limits, name), MORE * was[name]):
            yield name


def off_road(tracks: Tracks, name: str, network: RoadNetwork) -> Bools:
    """Say when (K,) an object's centre is on no driving lane, or a corner of its box on no lane at all."""
    n = tracks.index(name)
    own = np.flatnonzero(tracks.valid[n])
    out = np.zeros(len(tracks.t), dtype=bool)
    x, y, heading = tracks.x[n, own], tracks.y[n, own], tracks.heading[n, own]
    z = None if tracks.z is None else tracks.z[n, own]
    out[own] = ~network.to_road(x, y, heading=heading, z=z).on_road
    size = (np.full(len(own), tracks.length[n]), np.full(len(own), tracks.width[n]))
    corners = box_corners(x, y, heading, *size)
    held = np.zeros(corners.shape[:2], dtype=bool).ravel()
    held[network.lanes_at(*corners.reshape(-1, 2).T).point] = True
    out[own] |= ~held.reshape(corners.shape[:2]).all(axis=1)
    return out


def overlapping(tracks: Tracks, varied: tuple[str, ...]) -> set[tuple[str, str]]:
    """Give the pairs of a varied object and another one whose boxes ever overlap."""
    out = set[tuple[str, str]]()
    reach = 0.5 * np.hypot(tracks.length, tracks.width)
    for name in varied:
        n = tracks.index(name)
        with np.errstate(invalid="ignore"):
            apart = np.hypot(tracks.x - tracks.x[n], tracks.y - tracks.y[n])
            rows, steps = np.nonzero(apart < (reach + reach[n])[:, None])
        keep = rows != n
        rows, steps = rows[keep], steps[keep]
        one, other = (
            Boxes(tracks.x[r, steps], tracks.y[r, steps], tracks.heading[r, steps], tracks.length[r], tracks.width[r])
            for r in (np.full_like(rows, n), rows)
        )  # fmt: skip
        out |= {(name, str(tracks.ids[m])) for m in rows[boxes_overlap(one, other)].tolist()}
    return out


def varied_recording(
    recording: Recording, scenario: Scenario, network: RoadNetwork, varied: tuple[str, ...]
) -> Recording:
    """Give a recording in which the varied objects do as in a scenario, and all others as they were recorded.

    Sensor data and plans are those of another drive then, and are left out.
    """
    gt = recording.gt
    moved = scenario.tracks(network, gt.t)
    columns = {name: getattr(gt, name).copy() for name in ("x", "y", "heading", "v")}
    valid, kind, length, width = gt.valid.copy(), gt.kind.tolist(), gt.length.copy(), gt.width.copy()
    for name in varied:
        n, m = gt.index(name), moved.index(name)
        for column, values in columns.items():
            values[n] = getattr(moved, column)[m]
        valid[n] = moved.valid[m]
        kind[n], length[n], width[n] = str(moved.kind[m]), moved.length[m], moved.width[m]
    tracks = replace(
        gt, **columns, valid=valid, kind=np.array(kind, dtype=str), length=length, width=width,
        a=None, yaw_rate=None, z=None,
    )  # fmt: skip
    return Recording(
        name=recording.name, map=recording.map, ego=recording.ego, gt=tracks, gt_rate=recording.gt_rate,
        environment={**recording.environment, **scenario.environment}, provenance=dict(recording.provenance),
    )  # fmt: skip
