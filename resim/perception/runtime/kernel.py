"""A cycle of the perception models of B runs for N objects, compiled by numba: what is remembered, looked up late, and
perceived.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
"""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np

from resim.core.compiled import entry, inner

Q = 6
"""Quantities with errors, in the order of QUANTITIES."""

X, Y, V, HEADING, UNWRAPPED, PAST_ROWS = range(6)
"""What is remembered of objects, beside their maneuvers: place in the map [m], speed [m/s], heading [rad] as it was
told and without jumps; how many rows that is."""
PLACE, SPEED, ACCELERATION, DIRECTION = range(4)
"""What is looked up, each by weights of its own."""
FOLLOW, LEFT, RIGHT, BRAKES = range(4)
"""MANEUVERS."""

NOISE, SIGHT, WIDTH = Q, 2 * Q, 2 * Q + 1
"""Random numbers of an object in a cycle: Q standard normals that drive the drifts, Q for the noises; a uniform one for
detection."""

BIAS, DRIFT_SPREAD, NOISE_SPREAD, DRIVE, KEEP, ERROR_ROWS = 0, Q, 2 * Q, 3 * Q, 4 * Q, 4 * Q + 1
"""Rows of a table of errors (4 Q + 1, Q). Of each quantity: its bias and the logarithms of its spreads, as constant and
slopes by the four features; how normals drive its standardised drift, coupled. Last: what is kept of each drift."""
ALONG, ACROSS, PACE, TURN, LENGTH, WIDE = range(Q)

LOST, DETECTED, FRESH = range(3)
"""States of the chain of detection."""

_FULL = 2.0 * math.pi


@entry()
def remember(past, maneuver, k, position, heading, v, ego_heading, braked, lane_change):
    """Write sample k of past (PAST_ROWS, T, N) and of maneuver (B, T, N), one after the last.

    position (N,) x + iy [m], heading [rad], v [m/s]: in the map. ego_heading (B,) rad. braked: gain of speed [m/s]
    below which an object brakes. lane_change: speed [m/s] across the EGO's heading above which it changes lane.
    """
    for n in range(v.size):
        for b in range(ego_heading.size):
            across = v[n] * math.sin(heading[n] - ego_heading[b])
            maneuver[b, k, n] = _maneuver(across, v[n] - past[V, k - 1, n], braked, lane_change)
        turns = np.rint((past[UNWRAPPED, k - 1, n] - heading[n]) / _FULL)
        past[HEADING, k, n], past[UNWRAPPED, k, n] = heading[n], heading[n] + turns * _FULL
        past[X, k, n], past[Y, k, n], past[V, k, n] = position[n].real, position[n].imag, v[n]


@inner
def _maneuver(across, gained, braked, lane_change):
    """`resim.scenario.maneuvers.momentary` of one object."""
    if gained < braked:
        return BRAKES
    if across > lane_change:
        return LEFT
    return RIGHT if across < -lane_change else FOLLOW


@entry()
def perceive(past, maneuver, end, weights, span, settled, direction, set_of, ego, listed, length, width, rows,
             row, errors, least_size, drift, edges, detected, bins, state, reach, opening, limits, seen, who,
             counts):  # fmt: skip
    """For each of B runs whose list is due (`listed`) fill seen (B, Q, N) with x, y, v, heading, length, width of the
    objects that are seen, who (B, N) with their columns, and counts (2, B) with how many these are, and how many of
    them lie outside of the limits; give how many are seen in all. Drifts and states of detection go on by a step.

    past, maneuver, end, weights, span, settled, direction (B,), set_of (B, 4): what is known of the past
    (`_look_back`). ego (B, 6): x, y [m], heading [rad], v [m/s] in the map, and more. length, width (N,) [m]. rows (K,
    B, WIDTH, N) of random numbers, and which row (B,) each takes. errors (S, ERROR_ROWS, Q); least_size (B,) [m]; drift
    (B, Q, N), standardised. edges (B, 3, E): inner edges of range [m], |bearing| [rad] and occlusion; detected: the
    probability (B, 3, R, B, O) to be detected next, by state and bins; bins (B,): of occlusion; state (B, N). reach
    [m], opening [rad] (B,): of the field of view. limits (B, 5, 2): least and largest of the features, and of the EGO's
    speed.
    """
    total = 0
    for b in range(ego.shape[0]):
        if not listed[b]:
            continue
        count, beyond = 0, 0
        ego_x, ego_y, ego_heading, ego_v = ego[b, 0], ego[b, 1], ego[b, 2], ego[b, 3]
        random = rows[row[b], b]
        chosen, places, late = _look_back(
            past, maneuver[b], end, weights, span, settled[b], direction[b], set_of[b]
        )
        relative = (places - complex(ego_x, ego_y)) * complex(math.cos(ego_heading), -math.sin(ego_heading))
        hidden = _hidden(relative, late[2], ego_heading, length, width, bins[b])
        for n in range(chosen.size):
            turned = (math.pi + ego_heading) - late[2, n]
            distance = math.hypot(relative[n].real, relative[n].imag)
            bearing = math.atan2(relative[n].imag, relative[n].real)
            features = (distance, bearing, -ego_v - late[0, n] * math.cos(turned), late[1, n])
            table = errors[chosen[n]]
            _go_on(drift[b], n, table, random)
            i, j = _bin(edges[b], 0, distance), _bin(edges[b], 1, abs(bearing))
            k = _bin(edges[b], 2, hidden[n])
            found = random[SIGHT, n] < detected[b, state[b, n], i, j, k]
            if distance > reach[b] or abs(bearing) > opening[b]:
                state[b, n] = FRESH
                continue
            state[b, n] = DETECTED if found else LOST
            if not found:
                continue
            true = (relative[n].real, relative[n].imag, late[0, n], turned, length[n], width[n])
            for q in range(Q):
                error = _error(q, features, table, drift[b, q, n], random[NOISE + q, n])
                seen[b, q, count] = true[q] + error
            seen[b, TURN, count] = math.pi - seen[b, TURN, count] % _FULL
            seen[b, LENGTH, count] = max(seen[b, LENGTH, count], least_size[b])
            seen[b, WIDE, count] = max(seen[b, WIDE, count], least_size[b])
            beyond += _beyond(features, ego_v, limits[b])
            who[b, count] = n
            count += 1
        counts[0, b], counts[1, b] = count, beyond
        total += count
    return total


@inner
def _look_back(past, maneuver, end, weights, span, settled, direction, set_of):
    """Give which set of parameters objects have (N,), and what they were by that: places (N,) x + iy [m] in the map,
    and (3, N) speeds [m/s], accelerations [m/s²] and headings [rad] without jumps of a turn.

    past (PAST_ROWS, T, N), maneuver (T, N), of which end - 1 is the newest, and `settled` counts back to the one that
    says what the maneuver is; direction: HEADING or UNWRAPPED; set_of (4,): the set of each maneuver. weights (S, 4, K)
    of the last K samples, not 0 from span (S, 4, 2) on, and to there.
    """
    count, first = past.shape[2], end - weights.shape[2]
    samples, window = (past, first), (weights, span)
    chosen, places, late = np.empty(count, np.intp), np.empty(count, np.complex128), np.empty((3, count))
    for n in range(count):
        one = set_of[maneuver[end - settled, n]]
        x = _weighted(samples, window, X, n, one, PLACE)
        y = _weighted(samples, window, Y, n, one, PLACE)
        chosen[n], places[n] = one, complex(x, y)
        late[0, n] = _weighted(samples, window, V, n, one, SPEED)
        late[1, n] = _weighted(samples, window, V, n, one, ACCELERATION)
        late[2, n] = _weighted(samples, window, direction, n, one, DIRECTION)
    return chosen, places, late


@inner
def _weighted(samples, window, row, n, one, what):
    """The weighted sum of the last samples of an object.

    samples: the past, and the first that is weighed; window: weights and span (`_look_back`). row: X to UNWRAPPED. one:
    the object's set of parameters; what: PLACE to DIRECTION.
    """
    (past, first), (weights, span) = samples, window
    total = 0.0
    for k in range(span[one, what, 0], span[one, what, 1]):
        total += weights[one, what, k] * past[row, first + k, n]
    return total


@inner
def _go_on(drift, n, table, random):
    """The standardised drifts of an object, a step later."""
    for q in range(Q):
        push = 0.0
        for k in range(q + 1):
            push += table[DRIVE + q, k] * random[k, n]
        drift[q, n] = table[KEEP, q] * drift[q, n] + push


@inner
def _error(q, features, table, drift, noise):
    """The error of quantity q: its bias, its drift and its noise, whose spreads grow with the features."""
    distance, bearing, pace, a = features
    error = (
        table[BIAS + q, 0] + table[BIAS + q, 1] * distance + table[BIAS + q, 2] * bearing
        + table[BIAS + q, 3] * pace + table[BIAS + q, 4] * a
    )  # fmt: skip
    error += drift * _spread(features, table, DRIFT_SPREAD + q)
    return error + noise * _spread(features, table, NOISE_SPREAD + q)


@inner
def _spread(features, table, row):
    """A standard deviation (`resim.perception.model.Spread`)."""
    distance, bearing, pace, a = features
    return math.exp(
        table[row, 0] + table[row, 1] * distance + table[row, 2] * abs(bearing)
        + table[row, 3] * abs(pace) + table[row, 4] * abs(a)
    )  # fmt: skip


@inner
def _bin(edges, row, value):
    """How many of the inner edges are not above the value."""
    found = 0
    while found < edges.shape[1] and edges[row, found] <= value:
        found += 1
    return found


@inner
def _beyond(features, ego_v, limits):
    """1 where a feature or the EGO's speed is outside of its limits."""
    for k in range(4):
        if features[k] < limits[k, 0] or features[k] > limits[k, 1]:
            return 1
    return 1 if ego_v < limits[4, 0] or ego_v > limits[4, 1] else 0


@inner
def _hidden(places, heading, ego_heading, length, width, bins):
    """`occlusion`, if there are bins of it to tell apart."""
    if bins > 1:
        return occlusion(places, heading, ego_heading, length, width)
    return np.zeros(places.size)


@entry()
def localise(ego, rows, errors):
    """Add errors (R, 4) ahead, to the left [m], of heading [rad], of speed [m/s] to rows (R,) of ego (B, 6)."""
    for k in range(rows.size):
        b = rows[k]
        forward, left, turn, faster = errors[k, 0], errors[k, 1], errors[k, 2], errors[k, 3]
        c, s = math.cos(ego[b, 2]), math.sin(ego[b, 2])
        ego[b, 0] = ego[b, 0] + c * forward - s * left
        ego[b, 1] = ego[b, 1] + s * forward + c * left
        ego[b, 2] += turn
        ego[b, 3] += faster


@entry()
def drifts(drift, keep, push, normals):
    """Fill rows of drift (K + 1, P) from the first on: keep (P,) times the one before, and push (P,) times normals
    (K, P or more).
    """
    for k in range(len(drift) - 1):
        for p in range(keep.size):
            drift[k + 1, p] = keep[p] * drift[k, p] + push[p] * normals[k, p]


@entry()
def occlusion(places, heading, ego_heading, length, width):
    """Give (N,) the share of each box's angle, seen from the EGO's centre, that nearer boxes cover.

    places (N,): x + iy [m] in the EGO's frame. heading (N,), ego_heading [rad]. length, width (N,) [m].
    """
    count = places.size
    distance, middle, half = np.empty(count), np.empty(count), np.empty(count)
    for n in range(count):
        distance[n], middle[n], half[n] = _arc(places[n], heading[n] - ego_heading, length[n], width[n])
    hidden, low, high = np.zeros(count), np.empty(count), np.empty(count)
    for n in range(count):
        covers = 0
        for other in range(count):
            if distance[other] < distance[n]:
                apart = middle[other] - middle[n]
                apart -= _FULL * np.rint(apart / _FULL)
                reach = half[other] if half[other] < math.pi else _FULL  # who stands on the EGO covers all
                if abs(apart) < half[n] + reach:
                    _insert(low, high, covers, apart - reach, apart + reach)
                    covers += 1
        hidden[n] = _covered(low, high, covers, half[n])
    return hidden


@inner
def _arc(place, turn, length, width):
    """Distance [m] of a box, and the middle and the half [rad] of the angle that it takes; pi with the EGO inside."""
    distance, bearing = math.hypot(place.real, place.imag), math.atan2(place.imag, place.real)
    c, s = math.cos(turn - bearing), math.sin(turn - bearing)
    low, high = math.inf, -math.inf
    for ahead in (0.5 * length, -0.5 * length):
        for left in (0.5 * width, -0.5 * width):  # a corner, against the line of sight
            angle = math.atan2(ahead * s + left * c, distance + (ahead * c - left * s))
            low, high = min(low, angle), max(high, angle)
    half = 0.5 * (high - low)
    if half >= 0.5 * math.pi:
        return distance, bearing, math.pi
    return distance, bearing + 0.5 * (low + high), half


@inner
def _insert(low, high, count, begin, end):
    """Put an interval among `count` others that are in order."""
    k = count
    while k > 0 and low[k - 1] > begin:
        low[k], high[k] = low[k - 1], high[k - 1]
        k -= 1
    low[k], high[k] = begin, end


@inner
def _covered(low, high, count, half):
    """The share of -half..half that intervals cover together, which are in order."""
    covered, reached = 0.0, -half
    for k in range(count):
        if high[k] > reached:
            begin = max(low[k], reached)
            reached = min(high[k], half)
            covered += max(reached - begin, 0.0)
    return min(0.5 * covered / half, 1.0)
