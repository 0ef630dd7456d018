"""A drive as scenes: who is where at each time, and what the EGO is about to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from resim.core.clock import TICK
from resim.core.errors import ResimError
from resim.core.geometry import Bools, Floats, unwrap_angle
from resim.core.levels import apart_from
from resim.core.tracks import Tracks
from resim.metrics.risk import DEFAULTS, Risk, RiskParameters, Scenes, accident_risk
from resim.metrics.risk.lane_paths import lane_paths
from resim.metrics.risk.prediction import Prediction, prediction
from resim.road.opendrive import RoadNetwork

PathSource = Literal["plan", "state", "driven"]
"""Where the EGO's path comes from: its recorded plan, its state kept (CTRA), or where it drove later."""

Plans = Sequence[tuple[float, Floats]]
"""When each plan was made [s], increasing, and the plan (K, 4): t [s] on the same clock, x, y [m], v [m/s].

A plan's rows may stand in any order; of those of one time the first counts.
"""

FRESH = 0.5
"""Age [s] up to which a plan is the plan of a scene."""

UNDRIVABLE = 8.0
"""Distance [m] from where its speed takes the EGO within a second beyond which no vehicle gets to by then: 12 m/s²
either way, and 2 m/s for what is wrong in its speed."""
SLOW = 0.05
"""Speed [m/s] below which the points of a plan do not tell a heading."""


@dataclass(frozen=True, eq=False)
class DriveScenes:
    """A drive scene by scene. t: (S,) s; ids: (K,) of the traffic objects; present: (S, K) where they are there.

    Who is there but not known whole (NaN, no size) has size 0 in `scenes`; so has who is on another level than the EGO
    (`core.heights`), and counts as not there: apart (S, K) says who, None where no height is known. tracks:
    everybody's, at t. own: the EGO's. path: (S,) where the EGO's path of each scene comes from. covered: (S, K) the
    object's state lies in the range that the prediction was fitted to.
    """

    t: Floats
    ids: tuple[str, ...]
    tracks: Tracks
    own: Tracks
    scenes: Scenes
    present: Bools
    path: tuple[PathSource, ...]
    covered: Bools
    prediction: str
    apart: Bools | None = None

    def risk(self, parameters: RiskParameters = DEFAULTS) -> Risk:
        """Give the accident risk of every scene (S) and object (K).

        NaN for an object that is there but of which something is unknown, and of the scenes in which it is.
        """
        found = accident_risk(self.scenes, parameters)
        known = np.isfinite(self.scenes.plan).all(axis=(1, 2)) & (self.scenes.ego_size > 0.0).all(axis=1)
        known &= ~(self.present & ~(self.scenes.size[..., 0] > 0.0)).any(axis=1)
        of_scene = {name: np.where(known, getattr(found, name), np.nan) for name in ("r_ind", "r_dep")}
        return replace(found, **of_scene)


def drive(
    tracks: Tracks,
    *,
    ego: str,
    plans: Plans = (),
    path: PathSource = "plan",
    parameters: RiskParameters = DEFAULTS,
    predicted: Prediction | None = None,
    road: RoadNetwork | None = None,
) -> DriveScenes:
    """Make the scenes of tracks with acceleration and yaw rate, at all their times at which the EGO is there.

    The EGO's path is its plan where one was made within 0.5 s before the scene and can be driven, put to where the EGO
    is, else what follows of its state (constant turn rate and acceleration); path="driven" takes where it went, after
    the end its last state, path="state" never a plan. predicted: how the objects may go on, by default the published
    set. road: they drive along its lanes and stay on them. Raises ResimError where the EGO is missing or tracks have no
    accelerations.
    """
    if tracks.a is None or tracks.yaw_rate is None:
        raise ResimError(
            "assess: the tracks have no acceleration and yaw rate; take those of a fitted scenario"
        )
    row = tracks.index(ego)
    there = np.flatnonzero(tracks.valid[row])
    if not len(there):
        raise ResimError(f"assess: EGO {ego!r} has no sample")
    states = _states(tracks)[:, there]
    others = [n for n in range(len(tracks)) if n != row]
    state = np.moveaxis(states[others], 0, 1)
    present: Bools = np.asarray(tracks.valid[others][:, there].T)
    sizes = np.stack([tracks.length, tracks.width], axis=1)
    sized: Bools = np.all(np.isfinite(sizes) & (sizes > 0.0), axis=1)
    complete = np.isfinite(state).all(axis=2) & sized[others]
    everybody = tracks.at(t := tracks.t[there])
    apart = apart_from(everybody, row)
    if apart is not None:
        apart = np.asarray(apart[others].T)
        present, complete = present & ~apart, complete & ~apart
    size = np.where(complete[..., None], sizes[others][None], 0.0)
    state = np.where(complete[..., None], state, 0.0)
    poses, chosen = _paths(t, states[row], plans, path, parameters)
    expected, kinds = predicted or prediction(), tracks.kind[others]
    inputs = expected.inputs(kinds, state[..., 3], state[..., 4], state[..., 5])
    motion = np.tile(expected.motion(kinds), (len(t), 1))
    size = np.ascontiguousarray(size)
    z = None if everybody.z is None else everybody.z[others].T
    lanes = None if road is None else lane_paths(road, state, size, horizon=parameters.horizon, z=z)
    scenes = Scenes(poses, np.tile(sizes[row], (len(t), 1)), state, size, inputs, motion, lanes)
    covered = expected.covers(kinds, state[..., 3], state[..., 4], state[..., 5]) & present
    ids = tuple(tracks.ids[others].tolist())
    return DriveScenes(
        t, ids, everybody, everybody.select([ego]), scenes, present, chosen, covered, expected.name, apart
    )


def joined(drives: Sequence[DriveScenes]) -> DriveScenes:
    """Give the scenes of drives of the same objects, none of which keeps to lanes, one drive after the other.

    It is for what follows from scenes alone: there is no time from one drive to the next, and the tracks are those of
    the first.
    """

    def rows(name: str) -> Any:
        return np.concatenate([getattr(one.scenes, name) for one in drives])

    scenes = Scenes(*map(rows, ("plan", "ego_size", "state", "size", "inputs", "motion")))
    present, covered, t = (
        np.concatenate([getattr(one, name) for one in drives]) for name in ("present", "covered", "t")
    )
    path = tuple(of for one in drives for of in one.path)
    return replace(drives[0], t=t, scenes=scenes, present=present, covered=covered, path=path, apart=None)


def _states(tracks: Tracks) -> Floats:
    """States (N, T, 6): x, y, heading, v, a, yaw rate."""
    columns = (tracks.x, tracks.y, tracks.heading, tracks.v, tracks.a, tracks.yaw_rate)
    return np.stack([np.asarray(column) for column in columns], axis=2)


def _paths(
    t: Floats, ego: Floats, plans: Plans, path: PathSource, parameters: RiskParameters
) -> tuple[Floats, tuple[PathSource, ...]]:
    """The EGO's path (S, M + 1, 4) in each scene, and where it comes from."""
    from resim.metrics.risk.kernel import ctra_plans

    steps = round(parameters.horizon / parameters.step)
    out = np.asarray(ctra_plans(np.ascontiguousarray(ego), parameters.step, steps))
    chosen: list[PathSource] = ["state"] * len(t)
    ahead = np.asarray(np.arange(steps + 1) * parameters.step, dtype=np.float64)
    if path == "driven":
        times, way = np.concatenate([t, t[-1] + ahead[1:]]), np.concatenate([ego[:, :4], out[-1, 1:]])
        for n, start in enumerate(t):
            out[n] = _sampled(times, way, start + ahead)
            chosen[n] = "driven"
    elif path == "plan":
        scenes, of = _fresh(t, plans)
        if scenes:
            lane_paths = _planned_ways(of, ego[scenes], t[scenes, None] + ahead)
            lane_paths[..., :2] += ego[scenes, None, :2] - lane_paths[:, :1, :2]
            lane_paths[:, 0] = ego[scenes, :4]
            good = _drivable(lane_paths, parameters.step)
            scenes = [n for n, drives in zip(scenes, good, strict=True) if drives]
            out[scenes] = lane_paths[good]
        for n in scenes:
            chosen[n] = "plan"
    return out, tuple(chosen)


def _fresh(t: Floats, plans: Plans) -> tuple[list[int], list[Floats]]:
    """The scenes that have a plan of at most FRESH, and their plans."""
    latest = np.searchsorted(np.array([when for when, _ in plans]), t + TICK, side="right") - 1
    found = ((n, *plans[k]) for n, k in enumerate(latest.tolist()) if k >= 0)
    fresh = ((n, _in_order(plan)) for n, when, plan in found if t[n] - when <= FRESH)
    ahead = [(n, plan) for n, plan in fresh if plan[-1, 0] > t[n] + TICK]
    return [n for n, _ in ahead], [plan for _, plan in ahead]


def _drivable(ways: Floats, step: float) -> Bools:
    """Whether ways (B, M + 1, 4) from the EGO's state on can be driven: not in another frame, nor at a stop at once."""
    k = min(max(1, round(1.0 / step)), ways.shape[1] - 1)
    x, y, heading, v = ways[:, 0].T
    gone = v * k * step
    off = np.hypot(ways[:, k, 0] - x - gone * np.cos(heading), ways[:, k, 1] - y - gone * np.sin(heading))
    return np.asarray(off <= UNDRIVABLE)


def _in_order(plan: Floats) -> Floats:
    """A plan by its times, each once."""
    if (plan[1:, 0] > plan[:-1, 0]).all():
        return plan
    return np.asarray(plan[np.unique(plan[:, 0], return_index=True)[1]])


def _planned_ways(plans: list[Floats], ego: Floats, at: Floats) -> Floats:
    """The ways (B, K, 4) of plans at times (B, K), as `_planned`; all at once those that are alike."""
    out = np.empty((*at.shape, 4))
    length = len(plans[0])
    alike = np.array([len(p) == length > 1 and p[0, 0] <= at[n, 0] + TICK for n, p in enumerate(plans)])
    if alike.any():
        t, x, y, v = np.moveaxis(np.stack([p for p, same in zip(plans, alike, strict=True) if same]), 2, 0)
        dx, dy = _slope(x, t), _slope(y, t)
        heading = np.unwrap(np.arctan2(dy, dx) + np.where(_reverses(v), np.pi, 0.0), axis=1)
        out[alike] = _sampled_all(t, np.stack([x, y, heading, v], axis=2), at[alike])
        alike[alike] = (np.hypot(dx, dy) > SLOW).all(axis=1)
    for n in np.flatnonzero(~alike).tolist():
        out[n] = _planned(plans[n], ego[n], at[n])
    return out


def _reverses(v: Floats) -> Bools:
    """Whether a plan goes backwards where its speeds (..., M) are; who comes to a halt does as just before."""
    around = np.concatenate([v[..., :1], v, v[..., -1:]], axis=-1)
    return np.asarray(around[..., :-2] + v + around[..., 2:] < 0.0)


def _slope(f: Floats, t: Floats) -> Floats:
    """Derivatives (B, M) of f by t, both (B, M), as `numpy.gradient` has them for each row."""
    step, rise = np.diff(t), np.diff(f) / np.diff(t)
    inner = (step[:, 1:] * rise[:, :-1] + step[:, :-1] * rise[:, 1:]) / (step[:, :-1] + step[:, 1:])
    return np.concatenate([rise[:, :1], inner, rise[:, -1:]], axis=1)


def _sampled_all(t: Floats, rows: Floats, at: Floats) -> Floats:
    """Poses (B, K, 4) at times (B, K), as `_sampled` for each of B ways (B, M, 4) at t (B, M)."""
    j = np.clip((t[:, None, :] <= at[..., None]).sum(axis=2) - 1, 0, t.shape[1] - 2)
    t0, t1 = (np.take_along_axis(t, j + k, axis=1) for k in (0, 1))
    one, two = (np.take_along_axis(rows, (j + k)[..., None], axis=1) for k in (0, 1))
    out: Floats = one + (np.clip((at - t0) / (t1 - t0), 0.0, 1.0))[..., None] * (two - one)
    beyond = np.maximum(at - t[:, -1:], 0.0) * rows[:, -1:, 3]
    out[..., 0] += beyond * np.cos(rows[:, -1:, 2])
    out[..., 1] += beyond * np.sin(rows[:, -1:, 2])
    return out


def _planned(plan: Floats, ego: Floats, at: Floats) -> Floats:
    """A plan's way (x, y, heading, v) at times, from the EGO's state on where it begins later.

    Its heading is that of the way; the EGO's where it does not move.
    """
    if plan[0, 0] > at[0] + TICK:
        plan = np.concatenate([[[at[0], ego[0], ego[1], ego[3]]], plan])
    t, x, y, v = plan.T
    heading = ego[2]
    if len(t) == 1:
        return _sampled(t, np.array([[x[0], y[0], heading, v[0]]]), at)
    dx, dy = np.gradient(x, t), np.gradient(y, t)
    moves = np.flatnonzero(np.hypot(dx, dy) > SLOW)
    turn = np.full(len(t), heading)
    if len(moves):
        way = np.arctan2(dy[moves], dx[moves]) + np.where(_reverses(v)[moves], np.pi, 0.0)
        turn = np.interp(t, t[moves], np.unwrap(way))
    return _sampled(t, np.column_stack([x, y, turn, v]), at)


def _sampled(t: Floats, rows: Floats, at: Floats) -> Floats:
    """Poses (K, 4) x, y, heading, v at times, linear between rows; after the last straight on at its speed."""
    heading = unwrap_angle(rows[:, 2])
    out = np.column_stack([np.interp(at, t, rows[:, 0]), np.interp(at, t, rows[:, 1]), np.interp(at, t, heading),
                           np.interp(at, t, rows[:, 3])])  # fmt: skip
    beyond = np.maximum(at - t[-1], 0.0) * rows[-1, 3]
    out[:, 0] += beyond * np.cos(heading[-1])
    out[:, 1] += beyond * np.sin(heading[-1])
    return out
