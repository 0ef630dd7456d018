"""All scenes: predict every object, find who touches the EGO, weigh the time to react, consolidate (4.1)."""

# mypy: ignore-errors
from __future__ import annotations

import math
from collections import namedtuple

import numpy as np

from resim.metrics.risk.kernel.compiled import borrowed, compiled, inlined
from resim.metrics.risk.kernel.consolidation import dependent, weights
from resim.metrics.risk.kernel.contact import FREE, NONE, first_at_times, first_swept
from resim.metrics.risk.kernel.evasion import OPTIONS, last_evasion
from resim.metrics.risk.kernel.motion import (
    COS,
    ROWS,
    SAMPLED,
    SIN,
    VX,
    VY,
    X,
    Y,
    ctra,
    ctra_samples,
    finish,
    norm,
    walk_samples,
)
from resim.metrics.risk.kernel.road import TIGHTEST, at_way, bend_samples

WALKING = 1  # as in `prediction`
ASTRAY = 1.3
"""How much faster than it drives an object may move where the edge of its road presses it aside."""
PAD = 7
"""Room behind the samples: columns a power of two apart would share few lines of the processor's cache."""

Road = namedtuple("Road", "points begin first count s d")
"""See `resim.metrics.risk.lane_paths.Ways`."""

Work = namedtuple("Work", "paths made s speed samples scratch a b share near hint helped table mass")
"""What is reused from scene to scene.

paths: of evasions by begin and option, as far as made; then of the plan, the object's sample and the EGO's turn.
s, speed: the plan's way [m] and speed [m/s]. samples: of an object, of inputs a and b (N,), with share (N,) of its
probability. near (N,): the first step in which a sample is near. table: Eq. 4.6 by time; mass (K, M + 2): an object's
probability by time to react.
"""


@compiled
def _work(steps, objects, samples, times, h, swept):
    points = steps + 1
    return Work(
        np.full((OPTIONS * points + 3, ROWS, points), np.nan), np.zeros(OPTIONS * points, dtype=np.bool_),
        np.zeros(points), np.empty(points), np.empty((SAMPLED, points, samples + PAD)), np.empty((6, samples + PAD)),
        np.empty(samples), np.empty(samples), np.empty(samples), np.empty(samples, dtype=np.int64),
        np.empty((OPTIONS, 2), dtype=np.int64), np.zeros(1, dtype=np.int64),
        weights(points, times, h, swept), np.empty((objects, points + 1)),
    )  # fmt: skip


@compiled
def _begin(w, plan_in, n, radius, h, swept):
    """Take the plan of scene n of (S, M + 1, 4), and forget the evasions of the one before."""
    paths, s, speed, plan = w.paths, w.s, w.speed, len(w.made)
    for j in range(plan_in.shape[1]):
        x, y, heading, v = plan_in[n, j, 0], plan_in[n, j, 1], plan_in[n, j, 2], plan_in[n, j, 3]
        cos, sin = math.cos(heading), math.sin(heading)
        if j > 0:
            s[j] = s[j - 1] + norm(x - paths[plan, X, j - 1], y - paths[plan, Y, j - 1])
        speed[j] = v
        paths[plan, X, j], paths[plan, Y, j], paths[plan, COS, j], paths[plan, SIN, j] = x, y, cos, sin
        paths[plan, VX, j], paths[plan, VY, j] = v * cos * h, v * sin * h
    if swept:
        finish(paths, plan, np.int64(0), radius)
    w.made[:] = False


@compiled
def _predict(w, state, walks, count, h, swept):
    """Fill the first `count` of w.samples, of inputs w.a and w.b."""
    x, y, heading, v = state[0], state[1], state[2], state[3]
    cos, sin = math.cos(heading), math.sin(heading)
    if walks:
        walk_samples(x, y, cos, sin, v, w.a, w.b, count, h, w.samples)
    else:
        ctra_samples(x, y, cos, sin, v, w.a, w.b, count, h, swept, w.scratch, w.samples)


@compiled
def _predict_on(w, road, n, k, state, half, count, h, swept):
    """The same for object k of scene n, which has ways; half: its half width [m]."""
    first, s, d = road.first[n, k], road.s[n, k], road.d[n, k]
    _, _, c, sn, bend, _, _ = at_way(road.points, road.begin[first], road.begin[first + 1], s)
    heading, v = state[2] - math.atan2(sn, c), state[3]
    for i in range(count):
        w.b[i] -= bend * v / max(1.0 - bend * d, TIGHTEST)  # what the lane turns at this speed
    ctra_samples(
        0.0, 0.0, math.cos(heading), math.sin(heading), v, w.a, w.b, count, h, swept, w.scratch, w.samples
    )  # fmt: skip
    bend_samples(road.points, road.begin, first, road.count[n, k], s, d, half, count, w.samples)


@compiled
def _share(weight, ways, out):
    """Fill out with the weights (N,) of the samples of an object, such that each of its ways has the same share."""
    count, begin = len(weight), 0
    for way in range(ways):
        end = count if way == ways - 1 else -(-(way + 1) * count // ways)
        share = 1.0 if ways == 1 else 1.0 / (ways * weight[begin:end].sum())
        for i in range(begin, end):
            out[i] = share * weight[i]
        begin = end


@compiled
def _far_off(w, state, h, reach, fastest):
    """Whether an object stays out of reach however it goes."""
    paths, s, plan = w.paths, w.s, len(w.made)
    for j in range(len(s)):
        sway = s[j] - s[j - 1] if j > 0 else 0.0
        if (
            norm(paths[plan, X, j] - state[0], paths[plan, Y, j] - state[1])
            < reach + sway + fastest * (j + 1) * h
        ):
            return False
    return True


@inlined
def _fastest(v, inputs, walks, horizon):
    """A speed [m/s] that no sample exceeds."""
    most = abs(v) + (abs(inputs[0]) + 3.0 * inputs[1]) * horizon
    return most + (abs(inputs[2]) + 3.0 * inputs[3]) * horizon if walks else most


@compiled
def _out_of_reach(w, state, inputs, walks, h, swept, reach, fastest):
    """Whether no sample can touch: the mean path is farther off than samples stray from it and boxes reach."""
    paths, s, plan = w.paths, w.s, len(w.made)
    mean = plan + 1
    if walks:
        w.a[0], w.b[0] = inputs[0], inputs[2]
        _predict(w, state, walks, np.int64(1), h, swept)  # as a literal it would be compiled once more
        _pick(w.samples, 0, np.int64(VX), paths, mean)
    else:
        x, y, heading, v = state[0], state[1], state[2], state[3]
        ctra(x, y, math.cos(heading), math.sin(heading), v, inputs[0], inputs[2], h, swept, paths, mean)
    spread = 1.5 * (inputs[1] + (inputs[3] if walks else fastest * inputs[3]))
    sway = 0.0
    for j in range(len(s)):
        dx, dy = paths[plan, X, j] - paths[mean, X, j], paths[plan, Y, j] - paths[mean, Y, j]
        if j > 0:  # how far both may have come nearer within the step
            sway = s[j] - s[j - 1] + fastest * h
        far = reach + spread * (j * h) ** 2 + sway
        if dx * dx + dy * dy < far * far:
            return False
    return True


@compiled
def _find_near(samples, near, paths, plan, s, speed, h, swept, reach, fastest):
    """Fill near (N,): the first step in which a sample's box may be in reach of the EGO's, NONE if it never is."""
    last = len(s) - 1
    near[:] = NONE
    for j in range(last + 1):
        far = reach
        if swept:  # they come nearer within the step, and not on straight lines
            far += 1.3 * (max(abs(speed[j]) * h, s[j + 1] - s[j] if j < last else 0.0) + fastest * h)
        px, py = paths[plan, X, j], paths[plan, Y, j]
        for i in range(len(near)):
            dx, dy = samples[X, j, i] - px, samples[Y, j, i] - py
            near[i] = min(near[i], j if dx * dx + dy * dy <= far * far else NONE)


@compiled
def _pick(samples, i, rows, paths, p):
    """Make sample i path p."""
    for row in range(rows):
        for j in range(paths.shape[2]):
            paths[p, row, j] = samples[row, j, i]


@inlined
def _first_contact(paths, plan, one, near, radius, half, swept):
    """When the plan and a sample first touch, in steps, -1 if never, and the corner that does."""
    if swept:
        finish(paths, one, np.int64(0), radius)
        return first_swept(paths, plan, one, near, half), -1
    first, corner = first_at_times(paths, plan, one, near, half)
    return float(first), corner


@compiled
def _object(w, road, n, k, state, size, ego_size, inputs, walks, sample, weight, limits, h, swept):
    """Risk, probability of contact, shortest TTC and TTR [s] of object k; its mass by time to react into w.mass."""
    risk = hits = 0.0
    ttc = ttr = FREE
    half = (0.5 * ego_size[0], 0.5 * ego_size[1], 0.5 * size[0], 0.5 * size[1])
    own, radius = norm(half[0], half[1]), norm(half[2], half[3])
    fastest = _fastest(state[3], inputs, walks, h * (len(w.s) - 1))
    on_way = road.count[n, k] > 0 and not walks
    if on_way:
        fastest *= ASTRAY
        rejected = _far_off(w, state, h, own + radius, fastest)
    else:
        rejected = _out_of_reach(w, state, inputs, walks, h, swept, own + radius, fastest)
    if rejected:
        return risk, hits, ttc, ttr
    for i in range(len(weight)):
        w.a[i] = inputs[0] + 3.0 * inputs[1] * sample[i, 0]
        w.b[i] = inputs[2] + 3.0 * inputs[3] * sample[i, 1]
    if on_way:
        _predict_on(w, road, n, k, state, half[3], len(weight), h, swept)
    else:
        _predict(w, state, walks, len(weight), h, swept)
    paths, made, samples, near, hint, helped, s, speed = (
        w.paths, w.made, w.samples, w.near, w.hint, w.helped, w.s, w.speed
    )  # fmt: skip
    plan, one = len(made), len(made) + 1
    _share(weight, road.count[n, k] if on_way else 1, w.share)
    share = w.share
    _find_near(samples, near, paths, plan, s, speed, h, swept, own + radius, fastest)
    for i in range(len(weight)):
        if near[i] == NONE:
            continue
        _pick(samples, i, SAMPLED if swept else VX, paths, one)
        contact, corner = _first_contact(paths, plan, one, near[i], radius, half, swept)
        if contact < 0.0:
            continue
        found = last_evasion(
            paths, made, hint, helped, s, speed, int(contact), corner, own, half, limits, h, swept
        )
        hits += share[i]
        ttc, ttr = min(ttc, contact * h), min(ttr, max(found, 0) * h)
        risk += share[i] * w.table[found + 1]
        w.mass[k, found + 1] += share[i]
    return risk, hits, ttc, ttr


@compiled
def _shared(w):
    """The same arrays, which only `w` keeps alive."""
    return Work(
        borrowed(w.paths), borrowed(w.made), borrowed(w.s), borrowed(w.speed), borrowed(w.samples),
        borrowed(w.scratch), borrowed(w.a), borrowed(w.b), borrowed(w.share), borrowed(w.near),
        borrowed(w.hint), borrowed(w.helped),
        borrowed(w.table), borrowed(w.mass),
    )  # fmt: skip


@compiled
def assess(plan, ego_size, state, size, inputs, motion, road, sample, weight, limits, times, h, swept,
           r_to, r_ind, r_dep, hits, ttc, ttr):  # fmt: skip
    """Fill the results of all scenes; see `accident_risk`."""
    scenes, objects = state.shape[0], state.shape[1]
    owner = _work(plan.shape[1] - 1, objects, len(weight), times, h, swept)
    w = _shared(owner)
    for n in range(scenes):
        ready = False
        product, dangerous = 1.0, 0
        w.mass[:, :] = 0.0
        for k in range(objects):
            if not size[n, k, 0] > 0.0:
                r_to[n, k] = hits[n, k] = np.nan
                ttc[n, k] = ttr[n, k] = FREE
                continue
            if not ready:
                _begin(w, plan, n, 0.5 * norm(ego_size[n, 0], ego_size[n, 1]), h, swept)
                ready = True
            r_to[n, k], hits[n, k], ttc[n, k], ttr[n, k] = _object(
                w, road, n, k, state[n, k], size[n, k], ego_size[n], inputs[n, k], motion[n, k] == WALKING,
                sample, weight, limits, h, swept,
            )  # fmt: skip
            dangerous += r_to[n, k] > 0.0
            product *= 1.0 - min(r_to[n, k], 1.0)
        r_ind[n] = 1.0 - product
        r_dep[n] = r_ind[n] if dangerous < 2 else min(dependent(w.mass, w.table), r_ind[n])
    return len(owner.paths)  # alive till here
