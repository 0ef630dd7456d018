"""All scenes: predict every object, find who touches the EGO, weigh the time to react, consolidate (4.1)."""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np

from resim.core.compiled import inlined, inner, unfolded
from resim.metrics.risk.kernel.borrowed import borrowed
from resim.metrics.risk.kernel.consolidation import dependent
from resim.metrics.risk.kernel.contact import FREE, NONE, first_at_times, first_swept
from resim.metrics.risk.kernel.evasion import last_evasion
from resim.metrics.risk.kernel.motion import (
    COS,
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
from resim.metrics.risk.kernel.work import new_work

WALKING = 1  # as in `prediction`
ASTRAY = 1.3
"""How much faster than it drives an object may move where the edge of its road presses it aside."""


@inner
def _begin(w, plan_in, n, radius):
    """Take the plan of scene n of (S, M + 1, 4), and forget the evasions of the one before; radius of the EGO [m]."""
    paths, s, speed, plan, h = w.paths, w.s, w.speed, w.plan, w.h
    for j in range(plan_in.shape[1]):
        x, y, heading, v = plan_in[n, j, 0], plan_in[n, j, 1], plan_in[n, j, 2], plan_in[n, j, 3]
        cos, sin = math.cos(heading), math.sin(heading)
        if j > 0:
            s[j] = s[j - 1] + norm(x - paths[plan, X, j - 1], y - paths[plan, Y, j - 1])
        speed[j] = v
        paths[plan, X, j], paths[plan, Y, j], paths[plan, COS, j], paths[plan, SIN, j] = x, y, cos, sin
        paths[plan, VX, j], paths[plan, VY, j] = v * cos * h, v * sin * h
    if w.swept:
        finish(paths, plan, np.int64(0), radius)
    w.made[:] = False


@inlined
def _start(state):
    """Where predictions begin, as `motion` has it."""
    return state[0], state[1], math.cos(state[2]), math.sin(state[2]), state[3]


@inner
def _predict(w, state, walks, count):
    """Fill the first `count` of w.samples, of inputs w.a and w.b."""
    if walks:
        walk_samples(_start(state), w, count)
    else:
        ctra_samples(_start(state), w, count)


@inner
def _predict_on(w, road, who, state, half):
    """Fill w.samples for an object that has ways; who: scene and column of the object; half: its half width [m]."""
    first, s, d, count = road.first[who], road.s[who], road.d[who], len(w.weight)
    _, _, c, sn, bend, _, _ = at_way(road.points, road.begin[first], road.begin[first + 1], s)
    heading, v = state[2] - math.atan2(sn, c), state[3]
    for i in range(count):
        w.b[i] -= bend * v / max(1.0 - bend * d, TIGHTEST)  # what the lane turns at this speed
    ctra_samples((0.0, 0.0, math.cos(heading), math.sin(heading), v), w, count)
    bend_samples(road, who, half, count, w.samples)


@inner
def _share(weight, ways, out):
    """Fill out with the weights (N,) of the samples of an object, such that each of its ways has the same share."""
    count, begin = len(weight), 0
    for way in range(ways):
        end = count if way == ways - 1 else -(-(way + 1) * count // ways)
        share = 1.0 if ways == 1 else 1.0 / (ways * weight[begin:end].sum())
        for i in range(begin, end):
            out[i] = share * weight[i]
        begin = end


@inner
def _far_off(w, state, reach, fastest):
    """Whether an object stays out of reach however it goes."""
    paths, s, plan, h = w.paths, w.s, w.plan, w.h
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


@inner
def _out_of_reach(w, state, inputs, walks, reach, fastest):
    """Whether no sample can touch: the mean path is farther off than samples stray from it and boxes reach."""
    paths, s, plan, mean, h = w.paths, w.s, w.plan, w.one, w.h
    if walks:
        w.a[0], w.b[0] = inputs[0], inputs[2]
        _predict(w, state, walks, np.int64(1))  # as a literal it would be compiled once more
        _pick(w.samples, 0, np.int64(VX), paths, mean)
    else:
        ctra(_start(state), (inputs[0], inputs[2]), h, w.swept, paths, mean)
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


@inner
def _find_near(w, reach, fastest):
    """Fill w.near: the first step in which a sample's box may be in reach of the EGO's, NONE if it never is."""
    samples, near, paths, plan, s, speed, h = w.samples, w.near, w.paths, w.plan, w.s, w.speed, w.h
    last = len(s) - 1
    near[:] = NONE
    for j in range(last + 1):
        far = reach
        if w.swept:  # they come nearer within the step, and not on straight lines
            far += 1.3 * (max(abs(speed[j]) * h, s[j + 1] - s[j] if j < last else 0.0) + fastest * h)
        px, py = paths[plan, X, j], paths[plan, Y, j]
        for i in range(len(near)):
            dx, dy = samples[X, j, i] - px, samples[Y, j, i] - py
            near[i] = min(near[i], j if dx * dx + dy * dy <= far * far else NONE)


@inner
def _pick(samples, i, rows, paths, p):
    """Make sample i path p."""
    for row in range(rows):
        for j in range(paths.shape[2]):
            paths[p, row, j] = samples[row, j, i]


@inlined
def _first_contact(w, near, half):
    """When the plan and the sample first touch, in steps, -1 if never, and the corner that does."""
    if w.swept:
        finish(w.paths, w.one, np.int64(0), norm(half[2], half[3]))
        return first_swept(w.paths, w.plan, w.one, near, half), -1
    first, corner = first_at_times(w.paths, w.plan, w.one, near, half)
    return float(first), corner


@unfolded
def _object(w, road, scenes, n, k):
    """Risk, probability of contact, shortest TTC and TTR [s] of object k of scene n; fill its row of w.mass."""
    risk = hits = 0.0
    ttc = ttr = FREE
    ego_size, state, size, inputs = (
        scenes.ego_size[n],
        scenes.state[n, k],
        scenes.size[n, k],
        scenes.inputs[n, k],
    )
    walks = scenes.motion[n, k] == WALKING
    half = (0.5 * ego_size[0], 0.5 * ego_size[1], 0.5 * size[0], 0.5 * size[1])
    reach = norm(half[0], half[1]) + norm(half[2], half[3])
    fastest = _fastest(state[3], inputs, walks, w.h * (len(w.s) - 1))
    on_way = road.count[n, k] > 0 and not walks
    if on_way:
        fastest *= ASTRAY
        rejected = _far_off(w, state, reach, fastest)
    else:
        rejected = _out_of_reach(w, state, inputs, walks, reach, fastest)
    if rejected:
        return risk, hits, ttc, ttr
    sample, near, share, h = w.sample, w.near, w.share, w.h
    for i in range(len(near)):
        w.a[i] = inputs[0] + 3.0 * inputs[1] * sample[i, 0]
        w.b[i] = inputs[2] + 3.0 * inputs[3] * sample[i, 1]
    if on_way:
        _predict_on(w, road, (n, k), state, half[3])
    else:
        _predict(w, state, walks, len(near))
    _share(w.weight, road.count[n, k] if on_way else 1, share)
    _find_near(w, reach, fastest)
    for i in range(len(near)):
        if near[i] == NONE:
            continue
        _pick(w.samples, i, SAMPLED if w.swept else VX, w.paths, w.one)
        contact, corner = _first_contact(w, near[i], half)
        if contact < 0.0:
            continue
        found = last_evasion(w, int(contact), corner, half)
        hits += share[i]
        ttc, ttr = min(ttc, contact * h), min(ttr, max(found, 0) * h)
        risk += share[i] * w.table[found + 1]
        w.mass[k, found + 1] += share[i]
    return risk, hits, ttc, ttr


@unfolded
def assess(scenes, road, sampling, out):
    """Fill the results of all scenes; see `accident_risk`."""
    size, ego_size, r_to = scenes.size, scenes.ego_size, out.r_to
    number, objects = size.shape[0], size.shape[1]
    owner = new_work(sampling, scenes.plan.shape[1] - 1, objects)
    w = borrowed(owner)
    for n in range(number):
        ready = False
        product, dangerous = 1.0, 0
        w.mass[:, :] = 0.0
        for k in range(objects):
            if not size[n, k, 0] > 0.0:
                r_to[n, k] = out.collision[n, k] = np.nan
                out.ttc[n, k] = out.ttr[n, k] = FREE
                continue
            if not ready:
                _begin(w, scenes.plan, n, 0.5 * norm(ego_size[n, 0], ego_size[n, 1]))
                ready = True
            r_to[n, k], out.collision[n, k], out.ttc[n, k], out.ttr[n, k] = _object(w, road, scenes, n, k)
            dangerous += r_to[n, k] > 0.0
            product *= 1.0 - min(r_to[n, k], 1.0)
        out.r_ind[n] = 1.0 - product
        out.r_dep[n] = out.r_ind[n] if dangerous < 2 else min(dependent(w.mass, w.table), out.r_ind[n])
    return len(owner.paths)  # alive till here
