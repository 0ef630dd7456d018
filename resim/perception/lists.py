"""Lists of perceived objects: one that stands for a while, false objects on it, and what lies outside of a model."""

from __future__ import annotations

import cmath

import numpy as np

from resim.core.geometry import Bools, wrap_angle
from resim.perception.chance import BLOCK, Rows
from resim.perception.clutter import KIND, FalseObject
from resim.perception.model import FEATURES, FalseObjects, Validity
from resim.sim.adfunction import EgoState, Perceived


class Held:
    """A list until the next: its objects stay in the map where they were, as far as the EGO knew where it was."""

    def __init__(self, seen: Perceived) -> None:
        self.seen_last = seen
        ego = seen.ego
        self.places = complex(ego.x, ego.y) + (seen.x_ego + 1j * seen.y_ego) * cmath.rect(1.0, ego.heading)

    def seen(self, t: float, ego: EgoState) -> Perceived:
        """Give the list at t [s], in the frame of the EGO where it believes itself to be."""
        last = self.seen_last
        relative = (self.places - complex(ego.x, ego.y)) * cmath.rect(1.0, -ego.heading)
        turned = wrap_angle(last.heading_ego + (last.ego.heading - ego.heading))
        return Perceived(
            t, ego, last.ids, last.kind, relative.real, relative.imag, turned, last.v, last.length, last.width
        )


def with_false(seen: Perceived, false: list[FalseObject], model: FalseObjects, ego: EgoState) -> Perceived:
    """Give the list with false objects; ego: the true one."""
    if not false:
        return seen
    n = len(false)
    places = np.array([one.at(seen.t) for one in false]) - complex(ego.x, ego.y)
    places *= cmath.rect(1.0, -ego.heading)
    more = (
        (seen.ids, np.array([one.id for one in false])),
        (seen.kind, np.full(n, KIND)),
        (seen.x_ego, places.real),
        (seen.y_ego, places.imag),
        (seen.heading_ego, wrap_angle(np.array([one.heading for one in false]) - ego.heading)),
        (seen.v, np.array([one.v for one in false])),
        (seen.length, np.full(n, model.length)),
        (seen.width, np.full(n, model.width)),
    )
    return Perceived(seen.t, seen.ego, *(np.concatenate(parts) for parts in more))


class Limits:
    """Counts the samples outside of what a model was trained for, a block of rows at a time."""

    def __init__(self, validity: Validity) -> None:
        limits = [getattr(validity, name) for name in FEATURES]
        self.any = any(limits) or validity.ego_speed is not None
        wide = (-np.inf, np.inf)
        self.low, self.high = np.array([one or wide for one in limits]).T[..., None]
        self.ego = validity.ego_speed or wide
        self.clear()

    def clear(self) -> None:
        """Begin to count."""
        self.outside, self.first = 0, 0
        self.kept, self.ego_v = np.ones((BLOCK, 0), dtype=bool), np.zeros(BLOCK)

    def begin(self, rows: Rows) -> None:
        """Begin with other rows."""
        self.first, self.kept = rows.next, np.ones((BLOCK, rows.rows.shape[2]), dtype=bool)

    def add(self, row: int, keep: Bools | None, ego_v: float) -> None:
        """Take in a row: which objects are on the list (None: all), and the EGO's speed [m/s]."""
        self.ego_v[row] = ego_v
        if keep is not None:
            self.kept[row] = keep

    def count(self, rows: Rows) -> None:
        """Count the rows since the last count."""
        if not self.any:
            return
        done = slice(self.first, rows.next)
        values, speed = rows.rows[done, 1:5], self.ego_v[done]
        out = ((values < self.low) | (values > self.high)).any(axis=1)
        out |= ((speed < self.ego[0]) | (speed > self.ego[1]))[:, None]
        self.outside += int((out & self.kept[done]).sum())
        self.first = rows.next
