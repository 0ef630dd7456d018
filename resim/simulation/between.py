"""Where vehicles are between two steps, so that a long step hides no contact."""

from __future__ import annotations

import math

import numpy as np

from resim.core.geometry import Floats, wrap_angle

LONGEST = 0.1
"""s between two looks for a contact at most."""


def shares(step: float) -> list[float]:
    """Give the shares of a step of `step` [s] at which to look besides its end, none up to LONGEST."""
    parts = math.ceil(step / LONGEST - 1e-9)
    return [k / parts for k in range(1, parts)]


def pose_between(before: Floats, after: Floats, share: float) -> tuple[Floats, Floats, Floats]:
    """Give x, y [m] and heading [rad] at a share of the way, of one turn and one acceleration, between two states.

    before, after: (4, ...) x, y [m], heading [rad], v [m/s]. The way is the arc over the chord whose tangent turns by
    the difference of the headings.
    """
    v0, v1 = before[3], after[3]
    steady = v0 * v1 <= 0.0
    gone = share + np.where(steady, 0.0, (v0 - v1) / np.where(steady, 1.0, v0 + v1)) * share * (1.0 - share)
    turn = wrap_angle(after[2] - before[2])
    straight = np.abs(turn) < 1e-9
    half = np.where(straight, 1.0, 0.5 * turn)
    ratio = np.where(straight, gone, np.sin(gone * half) / np.sin(half))
    back = np.where(straight, 0.0, (gone - 1.0) * half)
    dx, dy = after[0] - before[0], after[1] - before[1]
    x = before[0] + ratio * (np.cos(back) * dx - np.sin(back) * dy)
    y = before[1] + ratio * (np.sin(back) * dx + np.cos(back) * dy)
    return x, y, before[2] + gone * turn
