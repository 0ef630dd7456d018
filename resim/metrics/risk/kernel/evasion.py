"""What the EGO could do instead of its plan, from any time on, and the last time at which some of it still helps.

w: see `work.Work`.
"""

# mypy: ignore-errors
from __future__ import annotations

from resim.core.compiled import inlined, inner
from resim.metrics.risk.kernel.contact import (
    corner_touches,
    surely_touch,
    touch_at_times,
    touch_swept,
    turned,
)
from resim.metrics.risk.kernel.motion import COS, SIN, SLOW, VX, VY, X, Y, ctra, finish, norm
from resim.metrics.risk.kernel.work import BRAKE, LEFT, OPTIONS


@inner
def _direction(speed, first):
    """Which way a plan goes at time `first`, 1 or -1, and the last time till which it goes that way.

    Who stands faces the way he came, else the way he goes next, else ahead.
    """
    last, j, until = len(speed) - 1, first, first
    while j > 0 and abs(speed[j]) <= SLOW:
        j -= 1
    while j < last and abs(speed[j]) <= SLOW:
        j += 1
    side = -1.0 if speed[j] < -SLOW else 1.0
    while until < last and side * speed[until + 1] >= -SLOW:
        until += 1
    return side, until


@inner
def _along(w, a, first, out):
    """Fill path out from time `first`: the plan's way from there at its pace, with acceleration a of the pace.

    Where the plan ends, or turns round, it goes straight on in the direction it had: who would stand may drive on.
    """
    paths, plan, s, speed, h = w.paths, w.plan, w.s, w.speed, w.h
    last, pace, i = paths.shape[2] - 1, abs(speed[first]), first
    ahead, turn = _direction(speed, first)
    for j in range(first, last + 1):
        t = (j - first) * h
        if a < 0.0 and pace + a * t < 0.0:
            at, v = s[first] - 0.5 * pace * pace / a, 0.0
        else:
            at, v = s[first] + pace * t + 0.5 * a * t * t, ahead * (pace + a * t)
        while i < turn and s[i + 1] < at:
            i += 1
        c, sn = paths[plan, COS, i], paths[plan, SIN, i]
        if i == turn:
            x, y = paths[plan, X, i] + ahead * (at - s[i]) * c, paths[plan, Y, i] + ahead * (at - s[i]) * sn
        else:
            step = s[i + 1] - s[i]
            f = (at - s[i]) / step if step > 1e-9 else 0.0
            if c != paths[plan, COS, i + 1] or sn != paths[plan, SIN, i + 1]:
                c, sn = turned(paths, plan, i, i + 1, f)
            x = paths[plan, X, i] + f * (paths[plan, X, i + 1] - paths[plan, X, i])
            y = paths[plan, Y, i] + f * (paths[plan, Y, i + 1] - paths[plan, Y, i])
        paths[out, X, j], paths[out, Y, j], paths[out, COS, j], paths[out, SIN, j] = x, y, c, sn
        paths[out, VX, j], paths[out, VY, j] = v * h * c, v * h * sn


@inner
def _turn(paths, plan, arc, first, side, out):
    """Fill path out from time `first`: the arc to the left (side 1) or right (-1) of the plan's pose there."""
    begin, end = max(first, 0), paths.shape[2]
    c, s = paths[plan, COS, begin], paths[plan, SIN, begin]
    for row in range(X, VY, 2):
        x, y = (paths[plan, X, begin], paths[plan, Y, begin]) if row == X else (0.0, 0.0)
        for j in range(end - begin):
            paths[out, row, begin + j] = x + c * paths[arc, row, j] - (s * side) * paths[arc, row + 1, j]
        for j in range(end - begin):
            paths[out, row + 1, begin + j] = y + s * paths[arc, row, j] + (c * side) * paths[arc, row + 1, j]


@inlined
def evade(w, j, option, out):
    """Fill path out with an evasion (LEFT, RIGHT, BRAKE, ACCELERATE) that begins at time j."""
    paths, arc, limits, h, v = w.paths, w.arc, w.limits, w.h, w.speed[j]
    if option >= BRAKE:
        _along(w, -limits[1] if option == BRAKE else limits[2], j, out)
        return
    if paths[arc, VX, 0] != v * h:
        pace = abs(v)
        rate = min(limits[0] / pace, limits[3] * pace) if pace > 1e-6 else 0.0
        ctra((0.0, 0.0, 1.0, 0.0, v), (0.0, rate), h, bool(1), paths, arc)
    _turn(paths, w.plan, arc, j, 1.0 if option == LEFT else -1.0, out)


@inlined
def _helps(w, path, j, option, half):
    """Whether an evasion from time j on, made as a path, stays free of the object's."""
    paths, one, hint, swept = w.paths, w.one, w.hint, w.swept
    last, corner = paths.shape[2] - 1, hint[option, 1]
    # where contact was found before it most often is still, or near there
    for n in range(4):
        step = hint[option, 0] + (n if n < 3 else -1)
        if step < j or step > last:
            continue
        if swept:
            if step < last and surely_touch(paths, path, one, step, half):
                hint[option, 0] = step
                return False
        elif corner_touches(paths, path, one, step, corner, half):
            hint[option, 0] = step
            return False
    if swept:
        step = touch_swept(paths, path, one, j, half)
    else:
        step, corner = touch_at_times(paths, path, one, j, half)
    hint[option, 0], hint[option, 1] = step, corner
    return step < 0


@inner
def last_evasion(w, contact, corner, half):
    """The last time at or before the contact from which an evasion stays free of the object's path, -1 if none does.

    The options are tried from the one on that helped before. contact: its step, and the corner that touches. half: see
    `contact`.
    """
    paths, made, hint, helped, swept = w.paths, w.made, w.hint, w.helped, w.swept
    radius = norm(half[0], half[1])
    for option in range(OPTIONS):
        hint[option, 0], hint[option, 1] = contact, corner
    begin = helped[0]
    # at the contact's own time every evasion stands where the plan does, which published is contact already
    for j in range(contact if swept else contact - 1, -1, -1):
        for n in range(OPTIONS):
            option = (begin + n) & 3
            path = OPTIONS * j + option
            if not made[path]:
                evade(w, j, option, path)
                if swept:
                    finish(paths, path, j, radius)
                made[path] = True
            if _helps(w, path, j, option, half):
                helped[0] = option
                return j
    return -1
