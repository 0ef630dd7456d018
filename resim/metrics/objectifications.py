"""Objectifications: what can be said of a drive in values, without any rating (Groh 2018, III.B).

Functional: what the function and its perception did. Quantitative: how near, how hard, how risky. Legal: what rules
say. A new one is a short function and a line in the table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from resim.core.geometry import Floats, boxes_overlap
from resim.core.tracks import Tracks
from resim.metrics import criticality, functional
from resim.metrics.criticality import Measure, Pairs, State, driven_pairs
from resim.metrics.criticality.evasion import longest
from resim.metrics.criticality.measure import Bad
from resim.metrics.drive import DriveScenes
from resim.metrics.functional import FunctionActivity
from resim.metrics.horizon import LookAhead, ahead, open_beyond
from resim.metrics.risk import DEFAULTS, Parameters, Risk
from resim.road.opendrive import RoadNetwork

NEAR = 1.0 + 1e-9
"""By what distances of centres are compared with the circles around boxes: rounding must not part who touch."""

_SAME = 1e-9
Kind = Literal["functional", "quantitative", "legal"]
ALONE = (
    "longitudinal acceleration", "lateral acceleration", "longitudinal jerk", "lateral jerk", "speed over limit",
    "lane overhang", "off the road", "function availability", "perception availability", "cycle time", "latency",
)  # fmt: skip
"""Those of the EGO alone."""
KINDS: tuple[Kind, ...] = ("quantitative", "legal", "functional")
"""In the order of tables."""


@dataclass(frozen=True, eq=False)
class MeasureInputs:
    """What objectifications are computed of: the drive, its road, and what function and perception did, if known.

    hits: when [s] the EGO's box touched whose (`contacts`), if that is known finer than by scenes.
    """

    drive: DriveScenes
    network: RoadNetwork
    parameters: Parameters = DEFAULTS
    functioning: FunctionActivity | None = None
    hits: tuple[tuple[float, str], ...] | None = None
    own: tuple[Objectification, ...] = ()
    _known: dict[str, Measure] = field(default_factory=dict)

    def measure(self, name: str) -> Measure:
        """Give an objectification by its name; computed once."""
        if name not in self._known:
            self._known[name] = next(o for o in (*OBJECTIFICATIONS, *self.own) if o.name == name).of(self)
        return self._known[name]

    def judged(self, name: str, side: str, limit: float) -> tuple[Measure, LookAhead]:
        """Give an objectification for a limit, looked for as far ahead as that needs, with what is open beyond."""
        measure = self.measure(name)
        seen = ahead(name, side, limit, measure.bad, self.pairs)
        if seen != LookAhead(self.pairs.span):
            key = f"{name}, {seen}"
            if key not in self._known:
                self._known[key] = FARTHER[name](self, seen)
            measure = self._known[key]
        return replace(measure, beyond=open_beyond(name, seen, self.pairs, self.parameters)), seen

    @cached_property
    def pairs(self) -> Pairs:
        """The EGO with each object, predicted."""
        return Pairs.of(self.drive.scenes, self.parameters.step)

    def farther(self, horizon: float) -> Pairs:
        """Give the EGO with each object, predicted for another horizon [s]; straight on after the plan's end."""
        return Pairs.of(self.drive.scenes, self.parameters.step, horizon)

    @cached_property
    def driven(self) -> Pairs:
        """The EGO with each object, on the paths that they drove."""
        drive, p = self.drive, self.parameters
        return driven_pairs(
            drive.tracks, str(drive.own.ids[0]), drive.t, horizon=p.horizon, step=p.step, driven=True
        )

    @cached_property
    def contacts(self) -> tuple[tuple[float, str], ...]:
        """When [s] the EGO's box touches whose."""
        if self.hits is not None:
            return self.hits
        return tuple(contacts(self.drive.tracks, str(self.drive.own.ids[0])))

    @cached_property
    def risk(self) -> Risk:
        """The accident risk of each scene."""
        return self.drive.risk(self.parameters)


@dataclass(frozen=True, eq=False)
class Objectification:
    """One objectification: `of` gives a measure (S,) of the EGO or the whole scene, or (S, K) of it and each object.

    alone: whether it is of the EGO alone, whoever else is there.
    """

    name: str
    kind: Kind
    of: Callable[[MeasureInputs], Measure]
    alone: bool = False


def names(every: Iterable[Objectification]) -> list[str]:
    """Give their names."""
    return [o.name for o in every]


def _all() -> tuple[Objectification, ...]:
    c, f = criticality, functional
    pairs: Mapping[str, Callable[[Pairs], Measure]] = {
        "TTC": c.ttc, "ETTC": c.ettc, "WTTC": c.wttc, "THW": c.thw,
    }  # fmt: skip
    also: Mapping[str, Callable[[MeasureInputs], Measure]] = {
        "TTB": lambda s: c.ttb(s.pairs, s.parameters),
        "TTK": lambda s: c.ttk(s.pairs, s.parameters),
        "TTS": lambda s: c.tts(s.pairs, s.parameters),
        "TTR": lambda s: longest(s.measure("TTB"), s.measure("TTK"), s.measure("TTS")),
        "WTTR": lambda s: c.wttr(s.drive.scenes, s.risk, s.parameters),
        "PMD": lambda s: c.pmd(s.pairs),
        "TPMD": lambda s: c.tpmd(s.pairs),
        "PET": lambda s: c.pet(s.driven),
        "DRAC": lambda s: c.drac(s.pairs),
        "gap ahead": lambda s: c.gap_ahead(s.pairs),
        "longitudinal acceleration": lambda s: _of_ego(c.longitudinal_acceleration(s.drive.own)),
        "lateral acceleration": lambda s: _of_ego(c.lateral_acceleration(s.drive.own)),
        "longitudinal jerk": lambda s: _of_ego(c.longitudinal_jerk(s.drive.own)),
        "lateral jerk": lambda s: _of_ego(c.lateral_jerk(s.drive.own)),
        "collision": _collision,
        "risk": lambda s: _whole("risk", s.risk.r_ind),
    }
    legal: Mapping[str, Callable[[MeasureInputs], Measure]] = {
        "speed over limit": lambda s: _of_ego(c.speed_over_limit(s.drive.own, s.network)),
        "half speedometer": lambda s: c.half_speedometer(s.pairs),
        "tailgating": lambda s: c.tailgating(
            s.drive.t, s.drive.scenes.plan[:, 0, 3], s.measure("half speedometer")
        ),
        "overtaking on the right": lambda s: c.overtaking_right(s.pairs),
        "lane overhang": lambda s: _of_ego(c.lane_overhang(s.drive.own, s.network)),
        "off the road": lambda s: _of_ego(c.off_road(s.drive.own, s.network)),
    }
    functional_ones: Mapping[str, Callable[[DriveScenes, FunctionActivity | None], Measure]] = {
        "function availability": f.function_availability, "perception availability": f.perception_availability,
        "detection": f.detection, "detection rate": f.detection_rate, "cycle time": f.cycle_time,
        "latency": f.latency,
    }  # fmt: skip
    out = [Objectification(name, "quantitative", _paired(of)) for name, of in pairs.items()]
    out += [Objectification(name, "quantitative", of, name in ALONE) for name, of in also.items()]
    out += [Objectification(name, "legal", of, name in ALONE) for name, of in legal.items()]
    out += [
        Objectification(name, "functional", _functional(of), name in ALONE)
        for name, of in functional_ones.items()
    ]
    return tuple(out)


def _paired(of: Callable[[Pairs], Measure]) -> Callable[[MeasureInputs], Measure]:
    return lambda subject: of(subject.pairs)


def _functional(
    of: Callable[[DriveScenes, FunctionActivity | None], Measure],
) -> Callable[[MeasureInputs], Measure]:
    return lambda subject: of(subject.drive, subject.functioning)


def _of_ego(measure: Measure) -> Measure:
    """A measure of one track, (1, S), as (S,)."""
    return Measure(measure.name, measure.unit, measure.value[0], measure.state[0], measure.bad)


def _whole(name: str, value: Floats, bad: Bad = "high") -> Measure:
    state = np.where(np.isfinite(value), State.VALUE, State.NOT_COMPUTED).astype(np.uint8)
    return Measure(name, "1", np.where(state == State.VALUE, value, np.nan), state, bad)


def _collision(subject: MeasureInputs) -> Measure:
    """1 where the EGO's box touches another between a scene and the next, else 0 (S,)."""
    drive = subject.drive
    value = np.where((subject.pairs.complete() | ~drive.present).all(axis=1), 0.0, np.nan)
    value[[scene_of(drive, t) for t, _ in subject.contacts]] = 1.0
    return _whole("collision", value)


def scene_of(drive: DriveScenes, t: float) -> int:
    """Give the scene that a time [s] belongs to: the last one that is not after it."""
    return max(int(np.searchsorted(drive.t, t + _SAME, side="right")) - 1, 0)


def contacts(tracks: Tracks, ego: str) -> list[tuple[float, str]]:
    """Give when [s] the EGO's box touches whose, for every sample."""
    row, radius = tracks.index(ego), 0.5 * np.hypot(tracks.length, tracks.width)
    apart = np.hypot(tracks.x - tracks.x[row], tracks.y - tracks.y[row])
    near = apart <= NEAR * (radius + radius[row])[:, None]  # else the circles around the boxes are apart
    near[row] = False
    n, i = np.nonzero(near)
    hit = boxes_overlap(
        tracks.x[row, i], tracks.y[row, i], tracks.heading[row, i], tracks.length[row], tracks.width[row],
        tracks.x[n, i], tracks.y[n, i], tracks.heading[n, i], tracks.length[n], tracks.width[n],
    )  # fmt: skip
    return sorted(zip(tracks.t[i[hit]].tolist(), tracks.ids[n[hit]].tolist(), strict=True))


FARTHER: Mapping[str, Callable[[MeasureInputs, LookAhead], Measure]] = {
    "TTC": lambda s, seen: criticality.ttc(s.farther(seen.horizon)),
    "THW": lambda s, seen: criticality.thw(s.farther(seen.horizon)),
    "WTTC": lambda s, seen: criticality.wttc(s.farther(seen.horizon)),
    "DRAC": lambda s, seen: criticality.drac(s.farther(seen.horizon)),
    "gap ahead": lambda s, seen: criticality.gap_ahead(s.pairs, reach=seen.reach),
    "half speedometer": lambda s, seen: criticality.half_speedometer(s.pairs, reach=seen.reach),
}
"""Those that can be looked for farther ahead than usual."""

OBJECTIFICATIONS = _all()
"""All that resim has, in the order of its tables."""
