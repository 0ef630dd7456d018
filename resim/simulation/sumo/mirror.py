"""SUMO told at every step where everybody is; what it says back is only checked."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats, wrap_angle
from resim.road.opendrive import RoadNetwork
from resim.simulation.function.interface import EgoState
from resim.simulation.sumo.drivers import SumoDrivers
from resim.simulation.sumo.session import EGO, Session, VehiclePose, from_sumo, to_sumo
from resim.simulation.traffic import Phase, Stage

_FOLLOWED = 1e-6  # m, rad, m/s; how exactly SUMO has to be where it was told to


@dataclass(frozen=True)
class _MirrorPhase:
    """What SUMO is told in a phase: who comes, with length, width [m] and speed [m/s], who goes; and where all are."""

    come: tuple[tuple[str, float, float, float], ...]
    go: tuple[str, ...]
    places: tuple[tuple[VehiclePose, ...], ...]


class SumoMirror:
    """SUMO beside one drive (`resim.simulation.engine.Mirror`)."""

    def __init__(self, stage: Stage, network: RoadNetwork, session: Session) -> None:
        self._stage, self._network, self._session = stage, network, session
        self._phases = _mirror_phases(stage)
        self._now, self._length = _MirrorPhase((), (), ()), np.zeros(0)
        self._said = array("d")  # compact: what a step leaves behind slows the next ones
        ego = stage.members[0]
        session.add(EGO, ego.length, ego.width, abs(stage.plan.state(0, stage.plan.begin).v))

    def deciders(self) -> SumoDrivers:
        """Give SUMO's own models, as drivers of objects that react."""
        return SumoDrivers(self._stage, self._network, self._session)

    def enter(self, phase: Phase) -> None:
        """Let objects come and go."""
        self._now, self._length = self._phases[phase.first], phase.length
        for name in self._now.go:
            self._session.remove(name)
        for one in self._now.come:
            self._session.add(*one)

    def advance(self, step: int, ego: EgoState, traffic: Floats | None) -> None:
        """Put everybody where they are, at this step of the phase, and keep what SUMO says."""
        places = self._now.places[step]
        if traffic is not None:
            x, y, heading, v = traffic
            told = np.stack([*to_sumo(x, y, heading, self._length), np.abs(v)], axis=-1).tolist()
            places = tuple((place[0], *one) for place, one in zip(places, told, strict=True))
        self._said.extend(self._session.advance(places, ego))

    def off(self, motion: Floats, steps: int) -> float:
        """Give how far [m] SUMO had somebody from where it was told to. Raises ResimError where that is too far.

        motion: (6, N, T) x, y, heading, v, a, yaw rate of all, EGO first. steps: how many were taken.
        """
        length = self._stage.length[:, None]
        read = self._readings(motion.shape[2], steps)
        x, y, heading = from_sumo(read[0], read[1], read[2], length)
        return _followed(np.stack([x, y, heading, np.copysign(read[3], motion[3])]), motion[:4])

    def _readings(self, count: int, taken: int) -> Floats:
        """Give what SUMO said: (4, N, T) front bumper x, y, angle, speed, EGO first; NaN where nothing is."""
        out = np.full((4, len(self._stage.members), count), np.nan)
        said, used = np.array(self._said), 0
        for phase in self._stage.shown:
            rows = [0, *phase.rows.tolist()]
            steps = slice(phase.first, min(phase.after, taken))
            size = 4 * len(rows) * max(steps.stop - steps.start, 0)
            out[:, rows, steps] = said[used : used + size].reshape(-1, len(rows), 4).transpose(2, 1, 0)
            used += size
            if steps.stop == taken:
                break
        return out


@lru_cache(maxsize=8)
def _mirror_phases(stage: Stage) -> dict[int, _MirrorPhase]:
    """What SUMO is told in each phase that it is shown, by its first step; objects have numbers there."""
    out, before = dict[int, _MirrorPhase](), tuple[str, ...]()
    for phase in stage.shown:
        names = tuple(f"{n}" for n in phase.rows.tolist())
        x, y, heading, v = (
            c[phase.rows, phase.first : phase.after].T
            for c in (stage.plan.x, stage.plan.y, stage.plan.heading, stage.plan.v)
        )
        places = np.stack([*to_sumo(x, y, heading, phase.length), np.abs(v)], axis=-1).tolist()
        size = zip(names, phase.length.tolist(), phase.width.tolist(), np.abs(v[0]).tolist(), strict=True)
        out[phase.first] = _MirrorPhase(
            come=tuple(one for one in size if one[0] not in before),
            go=tuple(name for name in before if name not in names),
            places=tuple(tuple((n, *p) for n, p in zip(names, step, strict=True)) for step in places),
        )  # fmt: skip
        before = names
    return out


def _followed(read: Floats, meant: Floats) -> float:
    """Give the largest distance [m] between where vehicles were commanded to be and where SUMO had them.

    read, meant: (4, N, T) x, y, heading, v. Raises ResimError where SUMO did not follow.
    """
    off = read - meant
    distance, turn, pace = np.hypot(off[0], off[1]), np.abs(wrap_angle(off[2])), np.abs(off[3])
    worst = [float(np.max(value[np.isfinite(value)], initial=0.0)) for value in (distance, turn, pace)]
    if max(worst) > _FOLLOWED:
        raise ResimError(
            "SUMO did not put the vehicles where it was told to: off by "
            f"{worst[0]:g} m, {worst[1]:g} rad, {worst[2]:g} m/s"
        )
    return worst[0]
